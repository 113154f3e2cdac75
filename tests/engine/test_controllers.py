"""Controllers in the cycle: they hold, are recorded, end safely, and outlive no program."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from support.engine.bench import ListSink

from rigd.config.loader import parse_rig
from rigd.config.rig import RigConfig
from rigd.dry_run import dry_run
from rigd.dry_run.holding import HoldingHost
from rigd.engine.clock import VirtualClock
from rigd.engine.cycle.wiring import wire
from rigd.engine.play.control import Control
from rigd.engine.process.in_process import InProcessHost
from rigd.engine.sink import Rows
from rigd.model import ConfigError
from rigd.model.channels import STALE, STATUS_FIELD
from rigd.model.severity import Severity
from rigd.procedure.compile import compile_procedure
from rigd.procedure.loader import parse_procedure
from rigd.procedure.program import CompiledProcedure, CycleProgram, Recorded
from rigd.sdk.shipped_files import shipped_folder

CONTROLLERS = """\
derived:
  rim.speed: {is: derivative(wheel_encoder.angle) * rig.wheel_radius, lowpass: 50 Hz}

controllers:
  rim_hold:
    measured: rim.speed
    output: wheel_servo.current
    kp: 5 A s/m
    ki: 300 A/m
    output_limits: [-1 A, 1.2 A]
    limits: {low: -0.5 m/s, high: 0.5 m/s, rate: 1 m/s^2}
    stale_after: 10 ms
    stuck_after: 0.5 s
"""
PROCEDURE = """\
procedure: hold
title: Hold the speed of the rim
doc: For tests.
trial:
  steps:
    - step: still
      set: {wheel_servo.current: 0.2 A, longitudinal_belt.speed: 0.1 m/s}
      for: 0.2 s
    - step: hold
      set: {rim_hold: 0.12 m/s}
      for: 1 s
    - step: back
      set: {wheel_servo.current: {ramp: {to: 0 A, over: 0.1 s}}}
      for: 0.2 s
"""
FILE = Path("p.yaml")


class KeptRows(ListSink):
    """Keeps the rows of every stream."""

    def __init__(self) -> None:
        super().__init__()
        self.kept: dict[str, list[Rows]] = {}

    def write(self, stream: str, rows: Rows) -> None:
        self.kept.setdefault(stream, []).append(rows.copy())

    def of(self, stream: str) -> Rows:
        return np.concatenate(self.kept[stream])


def rig_with(*changes: tuple[str, str]) -> RigConfig:
    path = shipped_folder("configs") / "sim_lugre.yaml"
    controllers = CONTROLLERS
    for old, new in changes:
        assert old in controllers
        controllers = controllers.replace(old, new)
    text = path.read_text().replace("interlocks:\n", f"{controllers}\ninterlocks:\n", 1)
    head, _, tail = text.partition("  - name: wheel_encoder_silent")  # it would act as well
    text = head + "  - name" + tail.partition("  - name")[2]
    return parse_rig(text.replace("floor: stone", "floor: pvc"), path)


def compiled(rig: RigConfig, text: str = PROCEDURE) -> CompiledProcedure:
    return compile_procedure(parse_procedure(text, FILE), rig)


class Played:
    """The rig of the first paper with a controller, playing the steps of ``text``."""

    def __init__(self, rig: RigConfig, text: str = PROCEDURE) -> None:
        clock = VirtualClock(rig.period_ns, 1_790_000_000_000_000_000)
        self.sink = KeptRows()
        self.cycle = wire(rig, clock, Control(), 1).cycle
        record = {stream.name: Recorded() for stream in self.cycle.rig.streams}
        self.host = InProcessHost(self.cycle, clock, virtual=True, sink=self.sink, record=record)
        assert not self.host.open()
        assert self.host.arm() is None
        (program,) = compiled(rig, text).trials[0].steps
        assert isinstance(program, CycleProgram)
        self.program = program

    def spoil(self, device: str, change: Callable[[int, Sequence[float]], object]) -> None:
        """Let ``change(call, row)`` replace each row that ``device`` returns."""
        (driver,) = (m.driver for m in self.cycle.rig.mounts if m.name == device)
        read, calls = driver.read, []

        def spoilt(t_ns: int) -> object:
            calls.append(t_ns)
            return change(len(calls), read(t_ns) or ())

        driver.read = spoilt  # type: ignore[method-assign, assignment]

    def play_held(self, step: str) -> tuple[Severity, str]:
        """Play the program, and hold ``step`` after 1.5 s of it as a person would."""
        record = {stream.name: Recorded() for stream in self.cycle.rig.streams}
        self.host = HoldingHost(
            self.cycle, self.cycle.clock, sink=self.sink, record=record,
            spans_ns={(self.host.trial, step): 3_000_000_000},
        )  # fmt: skip
        return self.play()

    def play(self) -> tuple[Severity, str]:
        outcome = self.host.play(self.program)
        self.host.drain()
        return outcome.severity, outcome.reason


def test_controller_holds_and_its_terms_are_recorded() -> None:
    played = Played(rig_with())
    assert played.play() == (Severity.DONE, "")
    hold, servo = played.sink.of("rim_hold"), played.sink.of("wheel_servo")
    rim = played.sink.of("rim")
    on = hold["active"] == 1.0
    assert 995 <= on.sum() <= 1005
    late = np.flatnonzero(on)[700:]
    assert np.sqrt(np.mean(hold["error"][late] ** 2)) < 0.02 * 0.12
    assert np.array_equal(hold["speed"], rim["speed"])
    assert np.array_equal(servo["current_setpoint"][on], hold["output"][on])
    assert np.allclose(hold["speed_setpoint"][on] - hold["speed"][on], hold["error"][on])
    total = hold["proportional"] + hold["integral"] + hold["derivative"] + hold["forward"]
    assert np.allclose(total[on], hold["output"][on])


def test_output_passes_both_ways_without_bump() -> None:
    played = Played(rig_with())
    played.play()
    hold, current = played.sink.of("rim_hold"), played.sink.of("wheel_servo")["current_setpoint"]
    on = np.flatnonzero(hold["active"])
    first, last = on[0], on[-1]
    assert current[first - 1] == 0.2
    assert abs(current[first] - 0.2) < 0.01
    assert abs(current[last + 1] - current[last]) < 0.005
    goal = hold["speed_setpoint"]
    assert np.all(np.abs(np.diff(goal[first : last + 1])) <= 1e-3 + 1e-12)
    assert abs(goal[first] - hold["speed"][first]) <= 1e-3 + 1e-12


def test_controller_ends_with_its_program() -> None:
    played = Played(rig_with(), PROCEDURE.split("    - step: back")[0])
    played.play()
    held = played.cycle.limiter.applied[played.cycle.rig.setpoints["wheel_servo.current"]]
    played.host.rest_while(lambda: played.cycle.counters.cycles < 2000)
    played.host.drain()
    hold, current = played.sink.of("rim_hold"), played.sink.of("wheel_servo")["current_setpoint"]
    on = np.flatnonzero(hold["active"])
    assert current[on[-1] + 1] == held == current[on[-1]]
    assert not np.any(hold["active"][on[-1] + 1 :])
    assert current[-1] == 0.0


def test_nan_goes_to_rest_in_the_same_cycle() -> None:
    played = Played(rig_with())
    played.spoil("wheel_encoder", lambda n, row: (math.nan, *row[1:]) if n == 600 else row)
    severity, reason = played.play()
    assert severity is Severity.END_TRIAL
    assert reason == "controller rim_hold: rim.speed is not a number"
    hold, current = played.sink.of("rim_hold"), played.sink.of("wheel_servo")["current_setpoint"]
    on = np.flatnonzero(hold["active"])
    assert on[-1] == 599
    assert current[598] > 0.0
    assert current[599] == 0.0  # 2000 A/s: in one cycle


def test_stale_reading_goes_to_rest_after_its_time() -> None:
    played = Played(rig_with())
    played.spoil("wheel_encoder", lambda n, row: row if n < 600 else None)
    severity, reason = played.play()
    assert (severity, "rim.speed is stale" in reason) == (Severity.END_TRIAL, True)
    on = np.flatnonzero(played.sink.of("rim_hold")["active"])
    assert on[-1] == 598 + 11


@pytest.mark.parametrize("frozen", ["moving", "always"])
def test_frozen_reading_ends_step_of_steady_output(frozen: str) -> None:
    """With kp alone and a constant setpoint the output stands still once the value does."""
    keys = f"frozen_after: 0.1 s\n    frozen: {frozen}\n"
    alone = ("    ki: 300 A/m\n", ""), ("    stuck_after: 0.5 s\n", f"    {keys}")
    played = Played(rig_with(("measured: rim.speed", "measured: rim.seen"), *alone, (
        "50 Hz}\n", "50 Hz}\n  rim.seen: {is: carriage.position / 1 s}\n",
    )))  # fmt: skip
    played.spoil("carriage", lambda n, row: (0.1, *row[1:]) if n >= 600 else row)
    found = played.play()
    if frozen == "moving":
        assert found == (Severity.DONE, "")
        return
    assert found == (
        Severity.END_TRIAL,
        "controller rim_hold: rim.seen is frozen: it has not changed at all for 0.1 s",
    )
    assert np.flatnonzero(played.sink.of("rim_hold")["active"])[-1] == 599 + 101


def test_interlock_acts_before_controller() -> None:
    rig = rig_with(
        ("stuck_after: 0.5 s", "stuck_after: 60 s"),
        ("limits: {low: -0.5", "frozen_after: 60 s\n    limits: {low: -0.5"),
    )
    played = Played(rig)
    played.spoil("carriage", lambda n, row: (2.0, *row[1:]) if n >= 600 else row)
    assert played.play()[0] is Severity.ABORT
    hold, current = played.sink.of("rim_hold"), played.sink.of("wheel_servo")["current_setpoint"]
    assert np.flatnonzero(hold["active"])[-1] == 598
    assert current[599] == 0.0


def test_dry_run_refuses_gains_of_wrong_sign() -> None:
    rig = rig_with(("kp: 5", "kp: -5"), ("ki: 300", "ki: -300"))
    found = dry_run(compiled(rig), rig, seed=1)
    (refusal,) = found.refusals
    assert "controller rim_hold: wheel_servo.current has been at its limit of -1 A" in refusal
    assert "wrong sign" in refusal
    right = rig_with()
    assert dry_run(compiled(right), right, seed=1).refusals == ()


@pytest.mark.parametrize("step", ["for: 1 s", "for: 0.3 s", "for: 1.9 s"])
def test_dry_run_refuses_wrong_sign_with_defaults(step: str) -> None:
    wrong = ("kp: 5", "kp: -5"), ("ki: 300", "ki: -300"), ("    stuck_after: 0.5 s\n", "")
    rig = rig_with(*wrong)
    (refusal,) = dry_run(compiled(rig, PROCEDURE.replace("for: 1 s", step)), rig, seed=1).refusals
    assert "controller rim_hold: wheel_servo.current was at its limit of -1 A" in refusal
    assert "the gains have the wrong sign" in refusal


#: The wheel slips, so that a small change of its current shows in its speed.
SLIPPING = PROCEDURE.replace("current: 0.2 A", "current: 0.8 A").replace("0.12 m/s", "0.15 m/s")
BELT_STOPS = "{rim_hold: 0.15 m/s, longitudinal_belt.speed: {ramp: {to: 0 m/s, over: 0.5 s}}}"
STEPS = {
    "constant": "{rim_hold: 0.15 m/s}",
    "ramp": "{rim_hold: {ramp: {to: 0.3 m/s, over: 1 s}}}",
    "load that changes": BELT_STOPS,
}


def low_gains(sign: int, kp: float, ki: float) -> RigConfig:
    changes = [("kp: 5 ", f"kp: {sign * kp} "), ("ki: 300", f"ki: {sign * ki}")]
    return rig_with(*(changes if kp else [("    kp: 5 A s/m\n", ""), changes[1]]))


@pytest.mark.parametrize("step", STEPS)
@pytest.mark.parametrize(("kp", "ki"), [(0.5, 3.0), (0.0, 1.0)])
def test_dry_run_refuses_low_gains_by_sign(step: str, kp: float, ki: float) -> None:
    text = SLIPPING.replace(STEPS["constant"], STEPS[step])
    wrong, right = low_gains(-1, kp, ki), low_gains(1, kp, ki)
    assert dry_run(compiled(right, text), right, seed=1).refusals == ()
    found = dry_run(compiled(wrong, text), wrong, seed=1)
    (refusal,) = found.refusals
    assert found.peaks[0].lowest > -1.0  # the output is at no limit
    assert re.search(r"rim_hold: rim.speed goes .* m/s away from its setpoint in 0.99\d s", refusal)
    assert "the gains have the wrong sign" in refusal


def test_wrong_sign_shows_where_right_gains_give_up() -> None:
    """With the gains turned around, the output is at its limit for longer than `stuck_after`."""
    text = SLIPPING.replace(STEPS["constant"], STEPS["ramp"])
    wrong = low_gains(-1, 0.5, 30.0)
    (refusal,) = dry_run(compiled(wrong, text), wrong, seed=1).refusals
    assert "the gains have the wrong sign" in refusal
    right = low_gains(1, 0.5, 30.0)
    (refusal,) = dry_run(compiled(right, text), right, seed=1).refusals
    assert "been at its limit of 1.2 A for 0.5 s" in refusal


def test_dry_run_refuses_wrong_sign_in_second_attempt() -> None:
    still = "    - step: stay\n      set: {rim_hold: 0.1246 m/s}\n      for: 20 ms\n"
    text = SLIPPING.replace("    - step: hold\n", f"{still}    - step: hold\n")
    wrong = low_gains(-1, 0.5, 3.0)
    (refusal,) = dry_run(compiled(wrong, text), wrong, seed=1).refusals
    assert "the gains have the wrong sign" in refusal


def test_wrong_sign_is_said_of_commanded_controller() -> None:
    outer = (
        "controllers:\n",
        "controllers:\n  turn:\n    measured: wheel_encoder.angle\n    output: rim_hold\n"
        "    kp: 0.05 m/(s rad)\n    limits: {low: -100 rad, high: 100 rad}\n",
    )
    text = SLIPPING.replace("{rim_hold: 0.15 m/s}", "{turn: 4 rad}")
    rig = rig_with(outer, ("kp: 5 ", "kp: -0.5 "), ("ki: 300", "ki: -3"))
    (refusal,) = dry_run(compiled(rig, text), rig, seed=1).refusals
    assert refusal.startswith("controller rim_hold: rim.speed goes")


def test_dry_run_accepts_output_limited_while_approaching() -> None:
    near = ("output_limits: [-1 A, 1.2 A]", "output_limits: [-1 A, 1 A]")
    rig = rig_with(near, ("0.5 m/s, rate", "2 m/s, rate"), ("1 m/s^2", "50 m/s^2"))
    for goal in ("2 m/s", "{ramp: {to: 2 m/s, over: 0.3 s}}"):
        text = PROCEDURE.replace("rim_hold: 0.12 m/s", f"rim_hold: {goal}")
        played = Played(rig, text.replace("for: 1 s", "for: 0.3 s"))
        assert played.play()[0] is Severity.DONE
        hold = played.sink.of("rim_hold")
        assert hold["saturated"][hold["active"] == 1.0][-200:].all()
        short = compiled(rig, text.replace("for: 1 s", "for: 0.3 s"))
        assert dry_run(short, rig, seed=1).refusals == ()


def test_dry_run_refuses_gains_far_too_high() -> None:
    rig = rig_with(("ki: 300", "ki: 300000"))
    (refusal,) = dry_run(compiled(rig), rig, seed=1).refusals
    assert re.search(r"rim_hold: wheel_servo.current swings .* \d\d+ times while", refusal)
    assert "lower the gains" in refusal


@pytest.mark.parametrize(
    ("old", "new", "token", "part"),
    [
        ("set: {rim_hold: 0.12 m/s}", "set: {rim_hold: 0.12 m/s, wheel_servo.current: 0 A}",
         "wheel_servo.current: 0 A}", "rim_hold, which commands it"),
        ("rim_hold: 0.12 m/s", "rim_hold: 0.6 m/s", "0.6", "above the rig's limit of 0.5 m/s"),
        ("rim_hold: 0.12 m/s", "rim_hold: {ramp: {from: 0 m/s, to: 0.2 m/s, over: 0.1 s}}",
         "{from", "faster than the rig's limit of 1 m/s^2"),
        ("rim_hold: 0.12 m/s", "rim_hold: 0.12 N", "0.12 N", "expected m/s"),
        ("rim_hold: 0.12 m/s", "rim_hld: 0.12 m/s", "rim_hld", "did you mean 'rim_hold'?"),
        ("rim_hold: 0.12 m/s", "rim_hold.speed: 0.12 m/s", "rim_hold.speed", "write 'rim_hold'"),
    ],
)  # fmt: skip
def test_wrong_setpoint_of_controller_names_its_place(
    old: str, new: str, token: str, part: str
) -> None:
    text = PROCEDURE.replace(old, new)
    with pytest.raises(ConfigError) as caught:
        compiled(rig_with(), text)
    assert part in str(caught.value)
    assert not caught.value.others
    place, at = caught.value.place, text.index(new) + new.index(token)
    assert place is not None
    assert (place.line, place.column) == (text[:at].count("\n") + 1, at - text[:at].rfind("\n"))


@pytest.mark.parametrize("count", [10, 100])
def test_end_at_friction_acts_in_cycle_seeing_it(count: int) -> None:
    mu = (
        "controllers:\n",
        "  friction.mu: {is: -longitudinal_belt.force / 38.84 N}\n\ncontrollers:\n",
    )
    pairs = "".join(
        f"    - step: raise {n}\n      set: {{rim_hold: {{ramp: {{to: 0.2 m/s, over: 0.2 s}}}}}}\n"
        f"      until: friction.mu > {0.05 + 0.0007 * n:g}\n      timeout: 1 s\n"
        f"    - step: fall {n}\n      set: {{wheel_servo.current: 0 A}}\n      for: 15 ms\n"
        for n in range(count)
    )
    head = PROCEDURE.partition("    - step: still")[0]
    played = Played(rig_with(mu), head + pairs)
    assert played.play() == (Severity.DONE, "")
    found = played.sink.of("friction")["mu"]
    on = played.sink.of("rim_hold")["active"] == 1.0
    current = played.sink.of("wheel_servo")["current_setpoint"]
    begins = np.flatnonzero(on & ~np.roll(on, 1))
    ends = np.flatnonzero(~on & np.roll(on, 1))
    assert (len(begins), len(ends)) == (count, count)
    for n, (begin, end) in enumerate(zip(begins, ends, strict=True)):
        limit = 0.05 + 0.0007 * n
        assert np.all(found[begin + 1 : end] <= limit)
        assert found[end] > limit
        assert current[end - 1] > 0.0
        assert current[end] == 0.0  # written in the cycle that read it


@pytest.mark.parametrize("held", ["0.4 A", "rest"])
def test_hold_hands_over_without_bump_on_plant(held: str) -> None:
    """The hold sets the current itself, 0.4 or 0.8 A from where the controller had it."""
    hold = f"      hold: {{set: {{wheel_servo.current: {held}}}, timeout: 2 s}}\n"
    played = Played(rig_with(), PROCEDURE.replace("for: 1 s\n", f"for: 3 s\n{hold}"))
    assert played.play_held("hold") == (Severity.DONE, "")
    rows, current = played.sink.of("rim_hold"), played.sink.of("wheel_servo")["current_setpoint"]
    active, speed = rows["active"], rows["speed"]
    ends = np.flatnonzero(np.diff(active) == -1)[0] + 1
    begins = np.flatnonzero(np.diff(active) == 1)[1] + 1
    asked = 0.4 if held == "0.4 A" else 0.0
    assert np.all(current[ends + 1 : begins] == asked)
    # What the setpoint (1 m/s^2) and the noise of the speed change in a cycle, by kp and ki.
    noise = float(np.abs(np.diff(speed[ends - 500 : ends])).max())
    change = 5 * (1e-3 + noise) + 300 * 1e-3 * 1e-3
    assert abs(current[begins] - asked) < change
    assert np.abs(np.diff(current[begins - 1 : begins + 3])).max() < 3 * change
    # The speed goes to where it was, and beyond it no farther than its noise, twice.
    spread = float(np.abs(speed[ends - 500 : ends] - 0.12).max())
    after = speed[begins : begins + 1500]
    assert speed[begins] - 2 * spread < after.min()
    assert after.max() < 0.12 + 2 * spread
    assert np.abs(after[500:] - 0.12).max() < 2 * spread


def test_dry_run_refuses_what_a_hold_does() -> None:
    hold = "      hold: {set: {wheel_servo.current: 1.1 A}, timeout: 2 s}\n"
    limits = "trial:\n  limits:\n    rim.speed: {low: -0.1 m/s, high: 0.13 m/s}\n"
    rig, text = rig_with(), PROCEDURE.replace("trial:\n", limits)
    assert dry_run(compiled(rig, text), rig, seed=1).refusals == ()
    held = compiled(rig, text.replace("for: 1 s\n", f"for: 1 s\n{hold}"))
    (refusal,) = dry_run(held, rig, seed=1).refusals
    assert refusal.startswith(
        "with each step held once: trial 1 would end early: rim.speed is 0.13"
    )
    mild = text.replace("for: 1 s\n", f"for: 1 s\n{hold.replace('1.1', '0.4')}")
    found = dry_run(compiled(rig, mild), rig, seed=1)
    assert found.refusals == ()
    assert found.duration_s == dry_run(compiled(rig, text), rig, seed=1).duration_s


def test_channel_of_a_controller_is_not_stale() -> None:
    base = rig_with()
    derived = "derived:\n  own.off: {is: abs(rim_hold.error)}\ntrial:\n"
    played = Played(compiled(base, PROCEDURE.replace("trial:\n", derived)).on(base))
    played.play()
    own, error = played.sink.of("own"), played.sink.of("rim_hold")["error"]
    assert np.array_equal(own["off"][1:], np.abs(error[:-1]))  # it acts after they are computed
    assert not np.any(own[STATUS_FIELD] & STALE)


def test_channel_of_controller_outlives_missed_slots() -> None:
    """No cycle ran in them: what the controller did last is still the newest there is."""
    base = rig_with()
    derived = "derived:\n  own.off: {is: abs(rim_hold.error)}\ntrial:\n"
    played = Played(compiled(base, PROCEDURE.replace("trial:\n", derived)).on(base))
    clock = played.cycle.clock
    following = clock.next_slot

    def skipping() -> int:
        slot = following()
        return following() if slot in (400, 600, 602) else slot

    clock.next_slot = skipping  # type: ignore[method-assign]
    assert played.play() == (Severity.DONE, "")
    assert played.cycle.counters.missed == 3
    own, error = played.sink.of("own"), played.sink.of("rim_hold")["error"]
    assert np.array_equal(own["off"][1:], np.abs(error[:-1]))
    assert not np.any(own[STATUS_FIELD] & STALE)


#: The accelerometer gives a row in every 40th cycle only.
EVERY = 40


def with_slow_sensor(derived: str, stale: str, *changes: tuple[str, str]) -> Played:
    also = (("\n\ncontrollers:", f"\n  {derived}\n\ncontrollers:"), ("10 ms", stale))
    played = Played(rig_with(*also, *changes))
    played.spoil("accelerometer", lambda call, row: None if call % EVERY else row)
    return played


def test_slow_channel_of_group_delays_no_controller() -> None:
    played = with_slow_sensor("rim.push: {is: 2 * accelerometer.acceleration}", "10 ms")
    assert played.play() == (Severity.DONE, "")
    quick = Played(rig_with())
    quick.play()
    output = played.sink.of("rim_hold")["output"]
    assert np.array_equal(output, quick.sink.of("rim_hold")["output"])


def test_controller_steps_at_each_reading_in_its_channel() -> None:
    """Its age is that of the slow reading in it, its pace that of the quick one."""
    mixed = "rim.mixed: {is: rim.speed + 0 s * accelerometer.acceleration}"
    played = with_slow_sensor(mixed, "60 ms", ("measured: rim.speed", "measured: rim.mixed"))
    assert played.play() == (Severity.DONE, "")
    hold = played.sink.of("rim_hold")
    output = hold["output"][hold["active"] == 1.0]
    assert np.mean(np.diff(output) != 0.0) > 0.9
