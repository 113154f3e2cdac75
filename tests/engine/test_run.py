"""After any end of a run the rig is safe; `finish` moves only if the rig has no fault."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import pytest
from support.engine.bench import (
    PERIOD_NS,
    Axis,
    AxisRow,
    Bench,
    ListSink,
    Stubborn,
    move,
    procedure,
)

from rigd.engine.cycle.cycle import CONFIRMING_NS
from rigd.engine.play.control import Control
from rigd.engine.run.result import Progress
from rigd.model.errors import Blocked, DeviceError, Exit, LinkError, RecordingError
from rigd.model.limits import Interlock, SetpointLimit
from rigd.model.severity import Severity
from rigd.model.states import RunState
from rigd.procedure.program import (
    AnswerKind,
    Comparison,
    Condition,
    CycleProgram,
    OnTimeout,
    Prompt,
    Segment,
    TrialLimit,
)


def never(on_timeout: OnTimeout) -> CycleProgram:
    """A step that waits for what does not come."""
    far = Condition("axis.position", Comparison.ABOVE, 99.0)
    return CycleProgram((Segment("wait", until=((far,),), timeout_s=0.05, on_timeout=on_timeout),))


def assert_safe(bench: Bench) -> None:
    assert bench.axis.safe_calls >= 1
    assert bench.other.safe_calls >= 1
    assert bench.axis.speed == 0.0
    assert bench.axis.closed
    assert bench.sink.closed


def test_whole_run_plays_every_block_and_ends_safe() -> None:
    bench = Bench()
    result = bench.run(
        procedure([move("one", 0.5)], [move("two", 0.5)], prepare=[move("prep", 0.1)])
    ).execute()
    # The stubborn device is reported, and spoils the exit code, but keeps nothing from ending.
    assert result.problems == ("other could not be made safe: relay welded",)
    assert (result.state, result.exit_code) == (RunState.DONE, Exit.TRIPPED)
    assert bench.sink.steps() == ["prep", "one", "two", "home"]
    assert (result.trials_done, result.trials_total) == (2, 2)
    assert bench.sink.kinds()[0] == "run_start"
    assert bench.sink.kinds()[-1] == "run_end"
    assert_safe(bench)


def test_trial_is_not_done_while_it_is_shown() -> None:
    bench = Bench()
    seen: list[Progress] = []
    run = bench.run(procedure([move("one", 0.5)], [move("two", 0.5)], after=[move("back", -0.5)]))
    run.watch = seen.append
    run.execute()
    shown = {(item.trial.number, item.trials_done) for item in seen if item.trial is not None}
    assert shown == {(1, 0), (2, 1)}


def test_preflight_is_no_time_of_the_run() -> None:
    bench, long_s = Bench(), 30.0
    run = bench.run(procedure([move("one", 0.5)]))

    def opens_slowly() -> Sequence[str]:
        run.host.settle(round(long_s * 1e9 / PERIOD_NS))
        return ()

    run.extra_checks = [opens_slowly]
    result = run.execute()
    took_s = (bench.sink.events[-1][0] - bench.sink.events[0][0]) * 1e-9
    assert run.host.run_s > long_s
    assert result.run_s == pytest.approx(took_s, abs=0.01)


def test_progress_says_how_long_a_person_was_awaited() -> None:
    bench = Bench()
    asked = Prompt("ready", "Ready?", AnswerKind.CONFIRM)
    seen: list[Progress] = []
    run = bench.run(procedure([move("one", 0.5)], prepare=[asked]))
    run.watch = seen.append
    ask = run.host.ask

    def slowly(question: Callable[[], None]) -> object:
        run.host.settle(round(5e9 / PERIOD_NS))
        return ask(question)

    run.host.ask = slowly  # type: ignore[method-assign,assignment]
    run.execute()
    assert seen[-1].waited_s == pytest.approx(5.0, abs=0.1)
    assert seen[0].waited_s == 0.0


class Unconfirmed(Axis):
    """A device that took the order to be safe, and does not show that it is."""

    def __init__(self, other: Stubborn) -> None:
        super().__init__()
        self.other = other

    def confirm_safe(self) -> None:
        assert self.other.safe_calls == self.safe_calls  # every device got the order before
        raise DeviceError("it still turns")


def test_device_that_does_not_confirm_spoils_exit_code() -> None:
    other = Stubborn()
    bench = Bench(other=other, axis=Unconfirmed(other))
    result = bench.run(procedure([move("one", 0.5)])).execute()
    assert result.problems == (
        "other could not be made safe: relay welded",
        "axis does not confirm that it is safe: it still turns",
    )
    assert result.exit_code is Exit.TRIPPED


class SlowToConfirm(Stubborn):
    """A device that takes ``late_ns`` to show that it is safe."""

    late_ns = 0

    def make_safe(self) -> None:
        self.safe_calls += 1

    def confirm_safe(self) -> None:
        self.late_ns += CONFIRMING_NS


def test_devices_without_time_to_confirm_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    other = SlowToConfirm()
    monkeypatch.setattr("rigd.engine.cycle.cycle.monotonic_ns", lambda: other.late_ns)
    bench = Bench(other=other, axis=Unconfirmed(other))
    result = bench.run(procedure([move("one", 0.5)])).execute()
    (problem,) = result.problems
    assert problem.startswith("axis was not asked whether it is safe: the devices before it took 1")
    assert result.exit_code is Exit.TRIPPED


def test_error_in_prepare_plays_no_trial_but_finishes() -> None:
    bench = Bench()
    result = bench.run(procedure([move("one", 0.5)], prepare=[never(OnTimeout.FAIL)])).execute()
    assert bench.sink.steps() == ["wait", "home"]
    assert "did not end within" in result.reason
    assert result.state is RunState.DONE
    assert_safe(bench)


@pytest.mark.parametrize(
    ("verb", "finishes", "state"),
    [
        (Severity.STOP, True, RunState.DONE),
        (Severity.ABORT, False, RunState.DONE),
        (Severity.ESTOP, False, RunState.ESTOPPED),
    ],
)
def test_request_of_person_ends_run(verb: Severity, finishes: bool, state: RunState) -> None:
    bench = Bench()
    run = bench.run(procedure([move("one", 0.5, 5.0)], [move("two", 0.5)]))

    def press(progress: Progress) -> None:
        if progress.run_s > 1.0:
            bench.control.request(verb, "button")

    run.watch = press
    result = run.execute()
    assert result.state is state
    assert result.reason == "button"
    assert ("home" in bench.sink.steps()) is finishes
    assert "two" not in bench.sink.steps()
    assert result.trials_done == 0
    assert_safe(bench)


def test_a_stop_during_finish_can_be_escalated() -> None:
    bench = Bench()
    run = bench.run(procedure([move("one", 0.5, 5.0)]))
    run.procedure = run.procedure.__class__(
        **{**run.procedure.__dict__, "finish": (move("home", -0.5, 5.0),)}
    )

    def press(progress: Progress) -> None:
        if progress.run_s > 1.0:
            bench.control.request(Severity.STOP, "first")
        if progress.step == "home":
            bench.control.request(Severity.ABORT, "second")

    run.watch = press
    result = run.execute()
    assert result.reason == "first; in finish: second"
    assert_safe(bench)
    assert bench.axis.position > -1.0  # `home` would have gone 2.5 m


@pytest.mark.parametrize(
    ("action", "latch", "finishes", "state"),
    [
        (Severity.STOP, False, False, RunState.FAULTED),  # the axis still stands beyond it
        (Severity.STOP, True, False, RunState.FAULTED),
        (Severity.END_TRIAL, True, False, RunState.FAULTED),
        (Severity.ABORT, False, False, RunState.DONE),
        (Severity.ESTOP, False, False, RunState.ESTOPPED),
    ],
)
def test_an_interlock_ends_the_run(
    action: Severity, latch: bool, finishes: bool, state: RunState
) -> None:
    far = Interlock("far", "axis.position", high=0.2, action=action, latch=latch)
    bench = Bench(interlocks=(far,))
    result = bench.run(procedure([move("one", 0.5, 5.0)], [move("two", 0.1)])).execute()
    assert (result.state, result.exit_code) == (state, Exit.TRIPPED)
    assert ("home" in bench.sink.steps()) is finishes
    assert "two" not in bench.sink.steps()
    assert "far" in result.reason
    assert_safe(bench)


def test_interlock_that_ends_trials_lets_sweep_go_on() -> None:
    far = Interlock("far", "axis.position", high=0.2, action=Severity.END_TRIAL)
    bench = Bench(interlocks=(far,))
    result = bench.run(
        procedure([move("one", 0.5, 5.0)], [move("two", 0.1)], after=[move("back", -0.5, 0.5)])
    ).execute()
    assert bench.sink.steps() == ["one", "back", "two", "back", "home"]
    assert [number for number, _ in result.incomplete] == [1]
    assert result.ending == "incomplete"
    assert "1 of 2 trials" in result.reason


@pytest.mark.parametrize("early", ["timeout", "limit"])
def test_trial_ended_early_is_marked_and_rig_returns(early: str) -> None:
    bench = Bench()
    step = (
        never(OnTimeout.END_TRIAL)
        if early == "timeout"
        else CycleProgram(move("one", 0.5, 5.0).segments, (TrialLimit("axis.position", -1, 0.1),))
    )
    result = bench.run(procedure([step], [move("two", 0.1)], after=[move("back", -0.1)])).execute()
    ends = [data for _, kind, _, data in bench.sink.events if kind == "trial_end"]
    assert [end["complete"] for end in ends] == [False, True]
    assert bench.sink.steps()[1:] == ["back", "two", "back", "home"]
    assert [number for number, _ in result.incomplete] == [1]
    assert result.ending == "incomplete"
    assert "1 of 2 trials" in result.reason


def test_fault_in_trial_plays_no_later_step() -> None:
    bench = Bench()

    def fail(t_ns: int) -> Sequence[float]:
        if bench.axis.position > 0.1:
            raise DeviceError("encoder cable off")
        return (bench.axis.position, 1.0)

    bench.axis.answer = fail
    result = bench.run(procedure([move("one", 0.5, 5.0)], after=[move("back", -0.1)])).execute()
    assert (result.state, result.exit_code) == (RunState.FAULTED, Exit.TRIPPED)
    assert bench.sink.steps() == ["one"]
    assert_safe(bench)


def test_fault_in_finish_after_failed_step_is_faulted() -> None:
    bench = Bench()

    def fail(t_ns: int) -> Sequence[float]:
        if bench.axis.position < -0.01:  # on the way home
            raise DeviceError("encoder cable off")
        return (bench.axis.position, 1.0)

    bench.axis.answer = fail
    result = bench.run(procedure([never(OnTimeout.FAIL)])).execute()
    assert bench.sink.steps() == ["wait", "home"]
    assert (result.state, result.ending) == (RunState.FAULTED, "faulted")
    assert "did not end within" in result.reason
    assert result.reason.endswith("in finish: axis: encoder cable off")
    assert_safe(bench)


class BrokenAxis(Axis):
    def arm(self) -> None:
        raise ZeroDivisionError("a bug in a driver")


def test_even_bug_in_driver_leaves_safe_rig() -> None:
    bench = Bench(axis=BrokenAxis())
    with pytest.raises(ZeroDivisionError):
        bench.run(procedure([move("one", 0.5)])).execute()
    assert_safe(bench)


class FullSink(ListSink):
    """A recording without room for what could not be made safe."""

    def event(self, t_ns: int, kind: str, trial: int, data: Mapping[str, object]) -> None:
        if kind == "fault":
            raise RecordingError("the disk is full")
        super().event(t_ns, kind, trial, data)


def test_devices_are_closed_if_make_safe_raises() -> None:
    bench = Bench(sink=FullSink())  # it cannot record that its stubborn device is not safe
    with pytest.raises(RecordingError, match="the disk is full"):
        bench.run(procedure([move("one", 0.5)])).execute()
    assert_safe(bench)


def test_a_sink_that_fails_ends_the_run_safe() -> None:
    bench = Bench()

    class FullDisk(type(bench.sink)):  # type: ignore[misc]  # a class made of the fixture's
        def write(self, stream: str, rows: object) -> None:
            raise RecordingError("no space left on device")

    bench.sink.__class__ = FullDisk
    with pytest.raises(RecordingError):
        bench.run(procedure([move("one", 0.5, 5.0)])).execute()
    assert bench.axis.safe_calls == 1
    assert bench.axis.speed == 0.0


def test_preflight_names_all_missing_and_nothing_moves() -> None:
    standing = Interlock("door", "axis.load", low=5.0, action=Severity.STOP)
    bench = Bench(interlocks=(standing,))
    question = Prompt("weight", "How heavy?", AnswerKind.NUMBER, "kg")
    run = bench.run(procedure([question, move("one", 0.5)]))
    run.extra_checks = (lambda: ["the disk is full"],)
    with pytest.raises(Blocked) as blocked:
        run.execute()
    text = str(blocked.value)
    assert "the disk is full" in text
    assert "prompt 'weight' needs an operator" in text
    assert "door" in text
    assert run.state is RunState.BLOCKED
    assert not bench.axis.armed
    assert set(bench.axis.written) == {0.0}


def test_a_refused_answer_fails_the_run_but_finishes() -> None:
    bench = Bench()
    question = Prompt("weight", "How heavy?", AnswerKind.NUMBER, "kg", low=1.0, answer=0.5)
    result = bench.run(procedure([question, move("one", 0.5)])).execute()
    assert "0.5 kg is outside 1 kg" in result.reason
    assert bench.sink.steps() == ["home"]


def test_an_answer_changes_the_plant_and_is_recorded() -> None:
    bench = Bench()
    changes: list[tuple[str, object]] = []
    question = Prompt(
        "floor", "Lay it.", AnswerKind.CHOICE, choices=("pvc",), answer="pvc", changes="floor"
    )
    bench.run(
        procedure([question, move("one", 0.5)]), change=lambda *told: changes.append(told)
    ).execute()
    assert changes == [("floor", "pvc")]
    (answer,) = [data for _, kind, _, data in bench.sink.events if kind == "answer"]
    assert (answer["answer"], answer["by"]) == ("pvc", "procedure")


def test_trials_done_before_are_left_out() -> None:
    bench = Bench()
    result = bench.run(
        procedure([move("one", 0.5)], [move("two", 0.5)], [move("three", 0.5)]),
        done=frozenset({1, 3}),
    ).execute()
    assert bench.sink.steps() == ["two", "home"]
    assert result.trials_done == 3


def test_trials_done_before_count_despite_early_end() -> None:
    bench = Bench()
    run = bench.run(procedure([move("one", 0.5)], [move("two", 0.5)]), done=frozenset({1}))
    bench.control.request(Severity.STOP, "button")
    assert run.execute().trials_done == 1


def spike(bench: Bench, from_s: float, to_s: float) -> None:
    """The load reads 9 N from one time of the run to another, 1 N otherwise."""
    start_ns = 1_000_000_000_000

    def answer(t_ns: int) -> Sequence[float]:
        inside = from_s <= (t_ns - start_ns) * 1e-9 < to_s
        return (bench.axis.position, 9.0 if inside else 1.0)

    bench.axis.answer = answer


def test_finish_plays_after_cause_of_stop_ends() -> None:
    bench = Bench(interlocks=(Interlock("load", "axis.load", high=5.0, action=Severity.STOP),))
    spike(bench, 0.2, 0.205)
    result = bench.run(procedure([move("one", 0.5, 5.0)])).execute()
    assert bench.sink.steps() == ["one", "home"]
    assert result.exit_code is Exit.TRIPPED


@pytest.mark.parametrize("offset_ms", range(0, 12))
def test_trip_while_resting_before_prompt_is_never_lost(offset_ms: int) -> None:
    latched = Interlock("load", "axis.load", high=5.0, action=Severity.ABORT, latch=True)
    bench = Bench(interlocks=(latched,), limit=SetpointLimit(-1.5, 1.5, 50.0))
    # The first step ends 20 ms of preflight and 100 ms after the start; the ramp takes 10 ms.
    spike(bench, 0.118 + offset_ms * 1e-3, 0.120 + offset_ms * 1e-3)
    question = Prompt("go", "Go on?")
    run = bench.run(procedure([move("one", 0.5), question, move("two", 0.5)]))
    result = run.execute()
    assert result.exit_code is Exit.TRIPPED
    assert "home" not in bench.sink.steps()


def test_latched_trip_while_stopping_keeps_finish_from_playing() -> None:
    latched = Interlock("load", "axis.load", high=5.0, action=Severity.STOP, latch=True)
    bench = Bench(interlocks=(latched,), limit=SetpointLimit(-1.5, 1.5, 5.0))
    run = bench.run(procedure([move("one", 0.5, 5.0)]))
    spike(bench, 1.03, 1.04)

    def press(progress: Progress) -> None:
        if progress.run_s > 0.97:
            bench.control.request(Severity.STOP, "button")

    run.watch = press
    result = run.execute()
    assert "home" not in bench.sink.steps()
    assert (result.state, result.exit_code) == (RunState.FAULTED, Exit.TRIPPED)
    assert "latched" in result.reason


def test_no_further_trial_while_interlock_still_stands_tripped() -> None:
    far = Interlock("far", "axis.position", high=0.2, action=Severity.END_TRIAL)
    bench = Bench(interlocks=(far,))
    result = bench.run(procedure([move("one", 0.5, 5.0)], [move("two", 0.5, 5.0)])).execute()
    assert bench.sink.steps() == ["one"]
    assert result.exit_code is Exit.TRIPPED
    assert bench.axis.position < 0.3


class LostAxis(Axis):
    """Loses its link on the way, then cannot even be closed."""

    def make_safe(self) -> None:
        super().make_safe()
        self.log.append("safe")

    def read(self, t_ns: int) -> Sequence[float] | None:
        if self.position > 0.1:
            raise LinkError("cable off")
        return super().read(t_ns)

    def close(self) -> None:
        super().close()
        raise RuntimeError("port gone")


def test_lost_link_is_made_safe_before_reporting() -> None:
    bench = Bench(axis=LostAxis())
    order: list[str] = []
    bench.axis.log = order
    bench.sink.log = order
    result = bench.run(procedure([move("one", 0.5, 5.0)])).execute()
    assert result.state is RunState.FAULTED
    assert order.index("safe") < order.index("fault")
    assert bench.sink.closed  # although closing the axis failed


class Hesitant(Axis):
    """It is ready a few cycles after it was armed; meanwhile ``meanwhile`` happens."""

    def __init__(self, meanwhile: Callable[[], None]) -> None:
        super().__init__()
        self.asked = 0
        self.meanwhile = meanwhile

    def ready(self) -> bool:
        self.asked += 1
        if self.asked == 3:
            self.meanwhile()
        return self.asked > 50


@pytest.mark.parametrize("during", ["opening", "preflight", "arming"])
@pytest.mark.parametrize(
    ("verb", "ending", "state"),
    [
        (Severity.STOP, "stopped", RunState.DONE),
        (Severity.ABORT, "aborted", RunState.DONE),
        (Severity.ESTOP, "estopped", RunState.ESTOPPED),
    ],
)
def test_request_before_motion_becomes_result_of_run(
    during: str, verb: Severity, ending: str, state: RunState
) -> None:
    control = Control()

    def press() -> None:
        control.request(verb, "pressed")

    def fail() -> None:
        press()
        raise LinkError("given up, as a person wanted out")

    bench = Bench(axis=Hesitant(press), control=control)
    if during == "opening":
        bench.axis.open = fail  # type: ignore[method-assign]
    if during == "preflight":
        press()
    result = bench.run(procedure([move("one", 0.5)])).execute()
    assert (result.ending, result.state) == (ending, state)
    assert "pressed" in result.reason
    assert bench.sink.steps() == []
    assert [data["state"] for _, kind, _, data in bench.sink.events if kind == "run_end"] == [
        ending
    ]
    assert_safe(bench)


def test_preflight_blocks_on_mute_device_and_delayed_violation() -> None:
    mute = Bench()
    mute.axis.answer = lambda t_ns: None
    with pytest.raises(Blocked, match="axis gave no row"):
        mute.run(procedure([move("one", 0.5)])).execute()
    slow = Interlock("load", "axis.load", high=0.5, delay_s=1.0, action=Severity.STOP)
    with pytest.raises(Blocked, match="load is violated"):
        Bench(interlocks=(slow,)).run(procedure([move("one", 0.5)])).execute()


@pytest.mark.parametrize(
    ("cycles", "told"), [(999, "load is violated at rest"), (3, "load tripped at rest")]
)
def test_trip_at_rest_blocks_and_is_told_once(
    monkeypatch: pytest.MonkeyPatch, cycles: int, told: str
) -> None:
    """Cycles go on after the trip, as they do in a process of their own; the load may go away."""
    bench = Bench(interlocks=(Interlock("load", "axis.load", high=5.0, action=Severity.ABORT),))
    loads = iter([9.0] * cycles)
    bench.axis.answer = lambda _: AxisRow.of(position=0.0, load=next(loads, 1.0))
    run = bench.run(procedure([move("one", 0.5)]))
    settle = run.host.settle
    monkeypatch.setattr(run.host, "settle", lambda n: [settle(n), settle(n), settle(n)][0])
    with pytest.raises(Blocked) as blocked:
        run.execute()
    assert told in str(blocked.value)
    assert str(blocked.value).count("interlock load") == 1


def test_stop_while_devices_open_is_told_once(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench()
    run = bench.run(procedure([move("one", 0.5)]))
    bench.control.request(Severity.STOP, "stopped by Ctrl-C")
    told = "stopped by Ctrl-C, while devices were opened"
    monkeypatch.setattr(run.host, "open", lambda: (told,))
    assert run.execute().reason == told


def test_stop_during_preflight_is_stop_and_not_block() -> None:
    bench = Bench()
    bench.control.request(Severity.STOP, "button")
    result = bench.run(procedure([move("one", 0.5)])).execute()
    assert (result.state, result.ending, result.reason) == (RunState.DONE, "stopped", "button")
    assert not bench.axis.armed
