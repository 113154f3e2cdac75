"""Controllers beside a slow form of the same equations, and what they do about bad readings."""

from __future__ import annotations

import math
from dataclasses import dataclass

import control
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.engine.held import OUTPUT, PERIOD_NS, TARGET, Held, config

from rigd.computed.controllers.chain import acting, sequence
from rigd.model.limits import SetpointLimit

anything = st.one_of(st.floats(allow_nan=True, allow_infinity=True), st.floats(-60, 60))
gains = st.floats(0, 20)


@dataclass
class Slow:
    """A PID as a textbook has it: terms are summed, and the integral takes back what was cut."""

    kp: float
    ki: float
    kd: float
    lag: float
    weight: float
    total: float = 0.0
    slope: float = 0.0
    last: float | None = None
    asked: float = 0.0

    def step(self, target: float, measured: float, written: float, h: float) -> float:
        if self.last is None:
            start = min(max(measured, -50.0), 50.0)
            self.total = written - self.kp * (self.weight * start - measured)
            self.last, h = measured, 0.0
        else:
            if self.ki:
                self.total += written - self.asked
            self.total += self.ki * h * (target - measured)
        if self.kd:
            rise = (measured - self.last) / h if h else 0.0
            part = h / (self.lag + h) if h else 0.0
            self.slope += part * (-self.kd * rise - self.slope)
        self.last = measured
        raw = self.kp * (self.weight * target - measured) + self.total + self.slope
        self.asked = min(max(raw, -2.0), 2.0)
        if self.ki:
            self.total += self.asked - raw
        return self.asked


@given(
    gains, gains, st.floats(0, 0.1), st.floats(0, 1),
    st.lists(st.tuples(st.floats(-60, 60), st.floats(-60, 60), st.booleans()), max_size=60),
)  # fmt: skip
def test_kernel_equals_slow_form(
    kp: float, ki: float, kd: float, weight: float, cycles: list[tuple[float, float, bool]]
) -> None:
    held = Held(config(kp=kp, ki=ki, kd=kd, filter_s=0.01, weight=weight, stale_s=60, stuck_s=60))
    slow = Slow(kp, ki, kd, 0.01, weight)
    taken, expected = held.t_ns, 0.0
    for index, (target, measured, fresh) in enumerate(cycles):
        held.values[0] = measured if fresh or index == 0 else held.values[0]
        written = held.current
        assert held.step(fresh=fresh or index == 0, hold=target) == ""
        if fresh or index == 0:
            goal = min(max(target, -50.0), 50.0)
            expected = slow.step(goal, measured, written, (held.t_ns - taken) * 1e-9)
            taken = held.t_ns
        assert held.bank.row("hold")[6] == pytest.approx(expected, rel=1e-9, abs=1e-9)


@given(
    st.lists(st.tuples(anything, anything, st.booleans(), st.booleans(), anything), max_size=60),
    st.floats(-20, 20), st.floats(-20, 20), st.floats(1, 1e4), st.sampled_from([0.0, 0.3, -1.25]),
)  # fmt: skip
def test_no_setpoint_leaves_limits_whatever_is_read(
    cycles: list[tuple[float, float, bool, bool, float]],
    kp: float, ki: float, rate: float, relay: float,
) -> None:  # fmt: skip
    target = SetpointLimit(-5.0, 40.0, rate)
    held = Held(
        config(kp=kp, ki=ki, kd=0.1, filter_s=0.01, forward="some.forward",
               schedule="some.schedule", low=-1.0, high=1.5, stale_s=0.003, relay=relay),
        limits=(OUTPUT, target),
    )  # fmt: skip
    last, goal, acted = held.current, math.nan, False
    for wanted, measured, fresh, active, other in cycles:
        held.values[:3] = measured, other, abs(other)
        reason = held.step(["hold.force"] if active else [], fresh=fresh, hold=wanted)
        now, applied = held.current, held.limiter.applied[1]
        assert -1.0 <= now <= 1.5
        assert abs(now - last) <= OUTPUT.rate * 1e-3 + 1e-12
        assert target.low <= applied <= target.high
        if acted and active:
            assert abs(applied - goal) <= rate * 1e-3 + 1e-9
        last, goal, acted = now, applied, active and not reason
        if reason:
            assert held.wanted == held.rest


def test_output_passes_from_fixed_setpoint_without_bump() -> None:
    held = Held(config(kp=0.5, ki=2.0, weight=0.5))
    held.values[0] = 12.0
    held.limiter.applied[0] = held.wanted[0] = 0.7
    held.step([])
    assert held.wanted[1] == 12.0  # a ramp begins where the measured value is
    held.step(hold=12.0)
    assert held.current == pytest.approx(0.7, abs=1e-12)
    held.step(hold=13.0)
    assert held.wanted[0] == pytest.approx(0.7 + 0.5 * 0.5 * 1.0 + 2.0 * 1e-3 * 1.0)


def test_setpoint_begins_at_measured_value_within_its_rate() -> None:
    held = Held(config(kp=0.5), limits=(OUTPUT, SetpointLimit(0.0, 50.0, 100.0)))
    held.values[0] = 10.0
    held.step([])
    goals = []
    for _ in range(3):
        held.step(hold=20.0)
        goals.append(held.limiter.applied[1])
    assert goals == pytest.approx([10.1, 10.2, 10.3])


def test_saturated_output_leaves_limit_at_once() -> None:
    held = Held(config(kp=0.01, ki=5.0))
    for _ in range(1000):
        assert held.step(hold=30.0) == ""
    assert held.bank.row("hold")[6:8] == [2.0, 1.0]
    held.values[0] = 31.0
    held.step()
    assert held.current < 2.0
    assert held.bank.row("hold")[7] == 0.0


def test_terms_add_up_to_output() -> None:
    held = Held(config(kp=0.02, ki=1.0, kd=0.001, filter_s=0.01, forward="some.forward"))
    held.values[1] = 0.3
    for step in range(200):
        held.values[0] = 3 * math.sin(step / 30)
        held.values[1] = 0.3 * math.cos(step / 50)
        held.step(hold=2.0)
        _, _, p, i, d, f, output, _, _ = held.bank.row("hold")
        assert p + i + d + f == pytest.approx(output, abs=1e-12)
    assert held.bank.row("hold")[5] == held.values[1]


def test_schedule_changes_gains_without_bump() -> None:
    held = Held(config(kp=0.05, ki=1.0, schedule="some.schedule"))
    held.values[0] = 8.0
    held.step(hold=10.0)
    held.step()
    before = held.current
    held.values[2] = 3.0
    held.step()
    assert held.current - before == pytest.approx(3.0 * 1.0 * 1e-3 * 2.0)


def test_outer_controller_sets_inner_in_the_same_cycle() -> None:
    outer = config("outer", measured="load.speed", unit="m/s", output="hold.force",
                   output_unit="N", kp=4.0, low=-3.0, high=3.0)  # fmt: skip
    held = Held(outer, config(kp=0.1, ki=1.0))
    both = ["outer.speed", "hold.force"]
    assert list(held.bank.loops) == both
    held.step([])
    for _ in range(30):
        assert held.step(both, outer=1.0) == ""
    assert held.bank.row("outer")[6:8] == [3.0, 1.0]
    assert held.limiter.applied[held.places["hold.force"]] == 3.0
    assert held.bank.row("hold")[1] == 3.0
    assert held.wanted[held.places["hold.force"]] == 3.0


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("place", [0, 1, 2])
def test_input_without_number_gives_up_at_once(place: int, value: float) -> None:
    held = Held(config(kp=0.1, ki=1.0, forward="some.forward", schedule="some.schedule"))
    assert held.step(hold=5.0) == ""
    held.values[place] = value
    name = ("load.force", "some.forward", "some.schedule")[place]
    assert held.step().startswith(f"controller hold: {name} is not a number")


@pytest.mark.parametrize("place", [0, 1, 2])
def test_stale_input_gives_up_after_its_time(place: int) -> None:
    inputs = ("load.force", "some.forward", "some.schedule")
    held = Held(config(kp=0.1, stale_s=0.02, forward=inputs[1], schedule=inputs[2]))
    assert held.step(hold=5.0) == ""
    taken, found = held.t_ns, []
    for _ in range(21):
        held.stamps[:] = [held.t_ns + PERIOD_NS] * len(held.stamps)
        held.stamps[place] = taken
        found.append(held.step(fresh=False))
    assert found[:-1] == [""] * 20
    old = f"controller hold: {inputs[place]} is stale: its last reading is over 20 ms old"
    assert found[-1] == old


def test_frozen_reading_gives_up_after_its_time() -> None:
    held = Held(config(ki=1.0, frozen_s=0.1))
    held.values[0] = 3.0
    found = [held.step(hold=10.0) for _ in range(103)]
    assert [bool(item) for item in found].index(True) == 101
    assert "load.force is frozen: it has not changed at all for 0.1 s" in found[101]


def test_steady_reading_is_not_frozen_while_output_rests() -> None:
    held = Held(config(ki=1.0, frozen_s=0.1))
    held.values[0] = 3.0
    assert {held.step(hold=3.0) for _ in range(500)} == {""}


def test_wrong_sign_gives_up_at_limit_without_progress() -> None:
    held = Held(config(kp=-0.02, ki=-1.0, stuck_s=0.5))
    reason = ""
    for cycle in range(3000):
        held.values[0] = 10.0 * held.current + 1e-6 * cycle  # more current, more force
        reason = held.step(hold=5.0)
        if reason:
            break
    assert reason.startswith("controller hold: press.current has been at its limit of -2 A for")
    assert "wrong sign" in reason


def test_slow_approach_at_limit_goes_on() -> None:
    held = Held(config(kp=1.0, ki=1.0, stuck_s=0.2))
    force = 0.0
    for _ in range(3000):
        force += 1e-3 * (20.0 * held.current - force) / 1.0
        held.values[0] = force
        assert held.step(hold=15.0) == ""
    assert force == pytest.approx(15.0, abs=1.0)


@pytest.mark.parametrize(("fastest", "ends"), [(20.0, False), (0.0, True), (-20.0, True)])
def test_setpoint_that_goes_away_needs_approach(fastest: float, ends: bool) -> None:
    """The force follows by ``fastest`` N/s at the limit of the current, the setpoint by 50 N/s."""
    ramp = SetpointLimit(-500.0, 500.0, 50.0)
    held = Held(config(kp=1.0, ki=1.0, stuck_s=0.2), limits=(OUTPUT, ramp))
    reasons = []
    for cycle in range(3000):
        held.values[0] += 1e-3 * (fastest * held.current / 2.0) + 1e-6 * (cycle % 2)
        reasons.append(held.step(hold=150.0))
    assert abs(held.bank.row("hold")[1]) > 50.0 or ends
    assert any("comes no nearer to its setpoint" in item for item in reasons) is ends


def test_controller_that_is_off_holds_nothing() -> None:
    held = Held(config(kp=1.0, ki=1.0))
    held.step(hold=5.0)
    held.wanted[0] = 0.25
    for _ in range(50):
        assert held.step([]) == ""
    assert held.current == 0.25
    assert held.bank.row("hold") == [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.25, 0.0, 0.0]


LOOPS = {"outer.v": "inner.f", "inner.f": "press.i"}


@pytest.mark.parametrize(
    ("before", "commanded", "found"),
    [
        ((), ("outer.v",), {"outer.v", "inner.f"}),
        (("outer.v", "inner.f"), (), {"outer.v", "inner.f"}),
        (("outer.v", "inner.f"), ("inner.f",), {"inner.f"}),
        (("outer.v", "inner.f"), ("press.i",), set()),
        (("inner.f",), ("outer.v",), {"outer.v", "inner.f"}),
        ((), ("belt.v",), set()),
    ],
)
def test_controller_acts_until_its_output_is_set(
    before: tuple[str, ...], commanded: tuple[str, ...], found: set[str]
) -> None:
    assert acting(LOOPS, before, commanded) == found


def test_controllers_in_a_circle_have_no_order() -> None:
    assert sequence({"a.x": "b.x", "b.x": "a.x"}) is None
    assert sequence({"b.x": "c.x", "a.x": "b.x"}) == ["a.x", "b.x"]


def _swing(held: Held, gain: float, needs: float, cycles: int) -> list[float]:
    """Let a relay act on a body that is braked by ``needs``; return what was set in each cycle."""
    speed, currents, late = 0.0, [], [needs] * 20  # the drive answers 20 ms later
    for _ in range(cycles):
        held.values[0] = speed
        assert held.step(hold=0.0) == ""
        currents.append(held.current)
        late.append(held.current)
        speed += 1e-3 * gain * (late.pop(0) - needs)
    return currents


@pytest.mark.parametrize("gain", [50.0, -50.0])
def test_relay_finds_the_middle_of_its_swing(gain: float) -> None:
    relay = math.copysign(0.5, gain)
    held = Held(config(relay=relay, hysteresis=0.05), limits=(SetpointLimit(-2, 2, 1e5), TARGET))
    held.limiter.applied[0] = held.wanted[0] = 0.6  # what is needed is 0.8
    currents = _swing(held, gain, needs=0.8, cycles=3000)
    last = currents[-1500:]
    assert min(currents) == pytest.approx(0.1)  # half a relay below the output at the start
    assert sum(last) / len(last) == pytest.approx(0.8, abs=0.01)
    assert max(last) == pytest.approx(1.3, abs=0.05)
    assert min(last) == pytest.approx(0.3, abs=0.05)


def test_relay_out_of_reach_gives_up_in_time() -> None:
    held = Held(config(relay=0.2, hysteresis=0.1, stuck_s=0.5))
    reasons = []
    for step in range(502):
        held.values[0] = -10 + 0.001 * (step % 2)
        reasons.append(held.step(hold=5.0))
    assert not any(reasons[:501])
    assert "has had press.current at 0.2 A for 0.5 s" in reasons[501]
    assert held.wanted == held.rest


@pytest.mark.parametrize("weight", [0.0, 0.3, 1.0])
def test_pid_equals_transfer_function_of_python_control(weight: float) -> None:
    kp, ki, kd, lag, h = 0.02, 0.6, 4e-5, 0.004, 1e-3
    z = control.tf("z")
    z.dt = h
    integral, slope = ki * h * z / (z - 1), kd * (z - 1) / ((lag + h) * z - lag)
    random = np.random.default_rng(3)
    goals, readings = random.uniform(-1.0, 1.0, size=(2, 200))
    goals[0] = readings[0] = 0.0  # where it begins
    asked = control.forced_response(kp * weight + integral, U=goals).outputs
    asked = asked - control.forced_response(kp + integral + slope, U=readings).outputs
    held = Held(config(kp=kp, ki=ki, kd=kd, filter_s=lag, weight=weight))
    found = []
    for goal, reading in zip(goals.tolist(), readings.tolist(), strict=True):
        held.values[0] = reading
        assert held.step(hold=goal) == ""
        found.append(held.bank.row("hold")[6])
    assert max(abs(np.diff(asked))) < 0.1  # within the rate
    assert found == pytest.approx(asked, rel=1e-9, abs=1e-12)
