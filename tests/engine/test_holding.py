"""A step that can be held: its time stands still, its setpoints go and come back at their rates."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from types import MappingProxyType

import pytest
from support.engine.bench import Bench, move, procedure

from rigd.engine.cycle.limiter import Limiter
from rigd.engine.play.holding import HoldPhase
from rigd.engine.play.player import Outcome, Player
from rigd.engine.run.result import Progress
from rigd.model.limits import SetpointLimit
from rigd.model.severity import Severity
from rigd.model.states import RunState
from rigd.procedure.profiles.profiles import ConstantProfile, Ramp
from rigd.procedure.program import (
    Comparison,
    Condition,
    CycleProgram,
    Hold,
    Segment,
    TrialLimit,
)

MS = 1_000_000
#: Rates of 100 and 50 per second: a tenth and a twentieth in each cycle.
LIMITS = (SetpointLimit(-2, 2, 100.0), SetpointLimit(-2, 2, 50.0))


@dataclass
class Played:
    """A program with a limiter, stepped by hand; row k belongs to the cycle at k ms."""

    player: Player
    limiter: Limiter = field(default_factory=lambda: Limiter(LIMITS, 1e-3))
    wanted: list[float] = field(default_factory=lambda: [0.0, 0.0])
    t_ns: int = 0
    rows: list[tuple[float, ...]] = field(default_factory=list)

    def on(self, cycles: int, *, pause: bool = False, x: float = 0.0) -> Outcome | None:
        for _ in range(cycles):
            applied = self.limiter.applied
            outcome = self.player.step(self.t_ns, (x,), self.wanted, applied, pause=pause)
            if outcome is not None:
                return outcome
            self.rows.append(tuple(self.limiter.apply(self.wanted)))
            self.t_ns += MS
        return None


def played(segment: Segment, *limits: TrialLimit) -> Played:
    program = CycleProgram((segment,), limits)
    return Played(Player(program, {"a.x": 0}, {"a.u": 0, "a.v": 1}))


RAMP = Segment(
    "ramp",
    {"a.u": Ramp(0.0, 1.0, 0.1), "a.v": ConstantProfile(0.5)},
    duration_s=0.12,
    hold=Hold({"a.u": 0.0}, 0.05),
)


def test_ramp_goes_on_where_hold_began() -> None:
    plain, held = played(RAMP), played(RAMP)
    plain.on(200)
    held.on(51)
    held.on(40, pause=True)
    assert held.rows[-1] == (0.0, 0.5)
    assert held.on(200) == Outcome(Severity.DONE)
    away = len(held.rows) - len(plain.rows)
    assert held.rows[:51] + held.rows[51 + away :] == plain.rows
    steps = [abs(b[0] - a[0]) for a, b in zip(held.rows, held.rows[1:], strict=False)]
    assert max(steps) <= 0.1 + 1e-12  # also away and back


def test_unnamed_setpoint_keeps_value_it_reached() -> None:
    held = played(Segment("go", {"a.v": ConstantProfile(1.0)}, duration_s=1.0, hold=Hold({}, 1.0)))
    held.on(10)  # still on its way
    held.on(30, pause=True)
    assert held.rows[-1] == held.rows[9]
    assert held.rows[9] == pytest.approx((0.0, 0.5))
    held.on(30)
    assert held.rows[-1] == (0.0, 1.0)


def test_window_of_condition_stands_still_while_held() -> None:
    until = ((Condition("a.x", Comparison.ABOVE, 1.0, for_s=0.01),),)
    held = played(Segment("wait", {}, until, timeout_s=0.02, hold=Hold({}, 1.0)))
    held.on(6, x=2.0)
    assert held.on(100, pause=True, x=2.0) is None  # neither the window nor the timeout
    held.on(2, x=2.0)
    assert held.on(3, x=2.0) is None
    assert held.on(1, x=2.0) == Outcome(Severity.DONE, last_values={"a.x": 2.0})


def test_longest_hold_ends_trial() -> None:
    held = played(RAMP)
    held.on(20)
    outcome = held.on(100, pause=True)
    assert outcome is not None
    assert outcome.severity is Severity.END_TRIAL
    assert outcome.reason == "step 'ramp' was held for 0.05 s, the longest allowed"
    assert len(held.rows) == 70


def test_limits_of_trial_hold_while_held() -> None:
    held = played(RAMP, TrialLimit("a.x", -1.0, 1.0))
    held.on(20)
    outcome = held.on(5, pause=True, x=3.0)
    assert outcome is not None
    assert "above the trial's limit" in outcome.reason


LOOPS = MappingProxyType({"c.f": "a.u"})


@pytest.mark.parametrize(("hold", "acts"), [({}, True), ({"a.u": 0.0}, False)])
def test_controller_goes_on_unless_hold_commands_output(hold: dict[str, float], acts: bool) -> None:
    segment = Segment("c", {"c.f": ConstantProfile(1.0)}, duration_s=1.0, hold=Hold(hold, 1.0))
    setpoints = {"a.u": 0, "c.f": 1}
    held = Played(Player(CycleProgram((segment,)), {"a.x": 0}, setpoints, LOOPS))
    held.on(30)
    held.on(30, pause=True)
    assert (held.player.acting == {"c.f"}) is acts
    held.on(30)
    assert held.player.acting == {"c.f"}
    assert held.player.phase is HoldPhase.NONE


def holding(speed: float, duration_s: float, hold: Hold) -> CycleProgram:
    segment = Segment(
        "go", {"axis.speed": ConstantProfile(speed)}, duration_s=duration_s, hold=hold
    )
    return CycleProgram((segment,))


def pausing(
    bench: Bench, states: list[RunState], held: Callable[[], None]
) -> Callable[[Progress], None]:
    """Ask for a pause after 0.9 s, and call ``held`` at each report of a run that is held."""

    def operator(progress: Progress) -> None:
        if not states or states[-1] is not progress.state:
            states.append(progress.state)
        if progress.run_s > 0.9 and RunState.HELD not in states:
            bench.control.pause_wanted = True
        if progress.state is RunState.HELD:
            held()

    return operator


def test_pause_holds_step_and_resume_completes_it() -> None:
    bench, states = Bench(), list[RunState]()
    run = bench.run(procedure([holding(0.5, 3.0, Hold({"axis.speed": 0.0}, 5.0))]))
    seen: list[float] = []

    def resume() -> None:
        seen.append(bench.axis.speed)
        bench.control.pause_wanted = len(seen) < 30

    run.watch = pausing(bench, states, resume)
    result = run.execute()
    assert (result.ending, result.trials_done) == ("complete", 1)
    assert RunState.PAUSED not in states
    assert seen[-1] == 0.0
    phases = [data for _, kind, _, data in bench.sink.events if kind == "hold"]
    assert [data["phase"] for data in phases] == ["held", "returning", "over"]
    moved = sum(1 for speed in bench.axis.written if speed == 0.5)
    assert moved == pytest.approx(3000, abs=8)


def test_overlong_hold_waits_at_rest_for_resume() -> None:
    bench, states = Bench(), list[RunState]()
    go = holding(0.5, 3.0, Hold({"axis.speed": 0.2}, 0.03))
    run = bench.run(procedure([go], [move("two", 0.4)], after=[move("back", -0.5)]))
    operator = pausing(bench, states, lambda: None)

    def resume(progress: Progress) -> None:
        operator(progress)
        if progress.state is RunState.PAUSED:
            assert "back" not in bench.sink.steps()
            bench.control.pause_wanted = False

    run.watch = resume
    result = run.execute()
    assert states.index(RunState.PAUSED) == states.index(RunState.HELD) + 1
    assert bench.sink.steps() == ["go", "back", "two", "back", "home"]
    assert result.incomplete == ((1, "step 'go' was held for 0.03 s, the longest allowed"),)


def test_resume_as_last_trial_ends_early_completes_run() -> None:
    """The setpoints still go to rest when the pause is taken back."""
    bench, states = Bench(), list[RunState]()
    run = bench.run(procedure([holding(0.5, 3.0, Hold({}, 0.03))]))
    began: list[float] = []
    operator = pausing(bench, states, lambda: began.append(run.host.run_s))

    def resume(progress: Progress) -> None:
        operator(progress)
        if began and run.host.run_s > began[0] + 0.03 and bench.axis.speed > 0.0:
            bench.control.pause_wanted = False

    run.watch = resume
    result = run.execute()
    assert RunState.PAUSED not in states
    assert (result.state, result.ending) == (RunState.DONE, "incomplete")
    assert bench.sink.steps() == ["go", "home"]


def test_stop_ends_held_run() -> None:
    bench, states = Bench(), list[RunState]()
    run = bench.run(procedure([holding(0.5, 3.0, Hold({}, 5.0))]))
    run.watch = pausing(bench, states, lambda: bench.control.request(Severity.STOP, "enough"))
    assert run.execute().ending == "stopped"
    assert bench.axis.speed == 0.0
