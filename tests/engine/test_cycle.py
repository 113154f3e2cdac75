"""The cycle as a whole: for any program limits hold and the rig ends safe."""

from __future__ import annotations

import math
from collections.abc import Sequence

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.engine.bench import Axis, Bench, move

from rigd.engine.cycle.cycle import MOST_TRIPS
from rigd.engine.sink import Rows
from rigd.model.errors import DeviceError
from rigd.model.limits import Interlock, SetpointLimit
from rigd.model.severity import STOPS, Severity
from rigd.procedure.profiles.profiles import Chirp, ConstantProfile, Profile, Ramp, Sine
from rigd.procedure.program import (
    Capture,
    Comparison,
    Condition,
    CycleProgram,
    OnTimeout,
    Recorded,
    Segment,
)
from rigd.sdk import Link

wild = st.one_of(st.floats(allow_nan=True, allow_infinity=True), st.floats(-5, 5))
profiles: st.SearchStrategy[Profile] = st.one_of(
    st.builds(ConstantProfile, wild),
    st.builds(Ramp, st.one_of(st.none(), wild), wild, st.floats(1e-3, 0.02)),
    st.builds(Sine, wild, st.floats(0, 500), wild),
    st.builds(Chirp, wild, st.floats(1, 100), st.floats(1, 100), st.floats(1e-3, 0.02)),
)


@settings(max_examples=150, deadline=None)
@given(
    programs=st.lists(st.lists(profiles, max_size=4), max_size=4),
    rate=st.one_of(st.just(math.inf), st.floats(1.0, 1e4)),
)
def test_no_command_sequence_moves_setpoint_beyond_its_limit(
    programs: list[list[Profile]], rate: float
) -> None:
    bench = Bench(limit=SetpointLimit(-0.7, 1.1, rate))
    host = bench.host()
    for sequence in programs:
        segments = tuple(
            Segment(str(index), {"axis.speed": profile}, duration_s=0.004)
            for index, profile in enumerate(sequence)
        )
        host.play(CycleProgram(segments))
    written = bench.axis.written
    assert all(-0.7 <= value <= 1.1 for value in written)
    steps = [abs(b - a) for a, b in zip([0.0, *written], written, strict=False)]
    assert all(step <= rate * 1e-3 + 1e-12 for step in steps)


def test_with_no_program_setpoints_go_to_rest() -> None:
    bench = Bench()
    host = bench.host()
    host.play(move("go", 1.0))
    assert bench.axis.speed == 1.0
    host.settle(20)
    assert bench.axis.speed == 0.0


def test_setpoint_that_holds_keeps_its_value_at_rest() -> None:
    bench = Bench(limit=SetpointLimit(-2.0, 2.0, 50.0, holds=True))
    host = bench.host()
    host.play(move("go", 1.0))
    reached = bench.axis.speed
    assert 0.0 < reached <= 1.0
    assert host.come_to_rest() is None
    host.settle(20)
    assert bench.axis.speed == reached
    host.cycle.control.request(Severity.STOP, "asked")
    outcome = host.play(move("back", -1.0))
    assert outcome.severity is Severity.STOP
    assert bench.axis.speed == reached


@pytest.mark.parametrize("row", [(0.0,), (0.0, 1.0, 2.0)])
def test_row_of_wrong_width_faults_without_other_changes(row: tuple[float, ...]) -> None:
    bench = Bench()
    host = bench.host()
    host.settle(2)
    before = host.cycle.readings()
    bench.axis.answer = lambda _: row
    outcome = host.play(move("go", 1.0))
    assert outcome.severity is Severity.FAULT
    assert f"axis gave a row of {len(row)} values, expected 2" in outcome.reason
    assert host.cycle.readings().keys() == before.keys()
    assert bench.axis.safe_calls == 1


def test_value_trembling_at_limit_fills_no_memory() -> None:
    light = Interlock("light", "axis.load", high=1.0, action=Severity.WARN)
    heavy = Interlock("heavy", "axis.load", high=3.0, action=Severity.ABORT, latch=True)
    bench = Bench(interlocks=(light, heavy))
    host = bench.host()
    loads = (0.5 + t_ns // 1_000_000 % 2 for t_ns in range(0, 10**12, 1_000_000))
    bench.axis.answer = lambda _: (0.0, next(loads))
    host.settle(1000)
    assert len(host.trips) == MOST_TRIPS
    assert bench.sink.kinds().count("interlock") == 500
    bench.axis.answer = lambda _: (0.0, 4.0)
    assert host.play(move("go", 1.0)).severity is Severity.ABORT
    assert "heavy is latched" in host.lockout_reason()


def test_unlatched_abort_after_many_warnings_is_kept() -> None:
    light = Interlock("light", "axis.load", high=1.0, action=Severity.WARN)
    heavy = Interlock("heavy", "axis.load", high=3.0, action=Severity.ABORT)
    bench = Bench(interlocks=(light, heavy))
    host = bench.host()
    loads = (0.5 + t_ns // 1_000_000 % 2 for t_ns in range(0, 10**12, 1_000_000))
    bench.axis.answer = lambda _: (0.0, next(loads))
    host.settle(1000)
    bench.axis.answer = lambda _: (0.0, 4.0)
    assert host.play(move("go", 1.0)).severity is Severity.ABORT
    assert [trip.interlock.name for trip in host.trips] == [*MOST_TRIPS * ["light"], "heavy"]


def test_each_interlock_action_takes_its_way_out() -> None:
    for action in (Severity.END_TRIAL, *STOPS):
        bench = Bench(interlocks=(Interlock("far", "axis.position", high=0.05, action=action),))
        outcome = bench.host().play(move("go", 1.0, 1.0))
        assert outcome.severity is action
        assert bench.axis.speed == 0.0
        # 1 m/s for 50 ms, 10 ms to reach that speed, 10 ms to leave it.
        assert bench.axis.position < 0.07


def test_a_warning_lets_the_program_play_on() -> None:
    warn = Interlock("far", "axis.position", high=0.05, action=Severity.WARN)
    bench = Bench(interlocks=(warn,))
    assert bench.host().play(move("go", 1.0, 0.2)).severity is Severity.DONE
    assert bench.sink.kinds().count("interlock") == 1


def test_the_more_severe_of_two_trips_wins() -> None:
    bench = Bench(
        interlocks=(
            Interlock("a", "axis.position", high=0.05, action=Severity.STOP),
            Interlock("b", "axis.position", high=0.051, action=Severity.ESTOP),
        )
    )
    assert bench.host().play(move("go", 1.0, 1.0)).severity is Severity.ESTOP
    assert bench.axis.safe_calls == 1


def test_nan_and_stale_readings_trip_in_the_cycle() -> None:
    alive = Interlock("alive", "axis.load", action=Severity.ABORT, stale_after_s=0.005)
    nan = Bench(interlocks=(alive,))
    nan.axis.answer = lambda t_ns: (nan.axis.position, math.nan)
    assert nan.host().play(move("go", 1.0)).severity is Severity.ABORT

    silent = Bench(interlocks=(alive,))
    rows = iter([(0.0, 1.0)] * 10)
    silent.axis.answer = lambda t_ns: next(rows, None)
    outcome = silent.host().play(move("go", 1.0, 1.0))
    assert outcome.severity is Severity.ABORT
    assert "stale" in outcome.reason
    assert silent.axis.speed == 0.0


def test_row_that_comes_late_has_its_own_time() -> None:
    alive = Interlock("alive", "axis.load", action=Severity.ABORT, stale_after_s=0.005)
    bench = Bench(interlocks=(alive,))
    host, pushed = bench.host(), []
    late_ns = 3_000_000

    def answer(t_ns: int) -> tuple[float, float]:
        bench.axis.taken_ns = t_ns - late_ns
        return (0.0, 1.0)

    bench.axis.answer = answer
    host.settle(2)

    class Ring:
        def push(self, t_ns: int, row: Sequence[float]) -> None:
            pushed.append(t_ns)

        def push_packed(self, row: memoryview) -> None:
            raise AssertionError("no channel is derived")

        def push_block(self, rows: Rows) -> None:
            raise AssertionError("nothing is captured")

    host.cycle.connect({"axis": Ring()}, {"axis": Recorded(1)}, lambda *_: None)
    host.cycle.step()
    assert pushed == [host.cycle.t_ns - 3_000_000]
    late_ns = 6_000_000
    outcome = host.play(move("go", 1.0))
    assert outcome.severity is Severity.ABORT
    assert "6 ms old" in outcome.reason
    late_ns = -1_000_000
    outcome = host.play(move("go", 1.0))
    assert outcome.severity is Severity.FAULT
    assert "axis gave a row that is 0.001 s ahead" in outcome.reason


HEAVY = Condition("axis.load", Comparison.ABOVE, 3.0, for_s=0.02)


@pytest.mark.parametrize(
    ("answered", "ends_after_ms"),
    [
        (range(1000), 30),
        ([10], None),  # one reading, then silence: the value stays in the table
        (range(10, 25), None),
        ([*range(10, 25), *range(60, 1000)], 60),
    ],
)
def test_silent_sensor_does_not_count_as_held(
    answered: Sequence[int], ends_after_ms: int | None
) -> None:
    bench = Bench()
    host = bench.host()
    begun_ns = host.cycle.clock.start_ns

    def answer(t_ns: int) -> Sequence[float] | None:
        now_ms = (t_ns - begun_ns) // 1_000_000
        if now_ms >= 10 and now_ms not in answered:
            return None
        return 0.0, 5.0 if now_ms >= 10 else 1.0

    bench.axis.answer = answer
    segment = Segment("push", {}, until=((HEAVY,),), timeout_s=0.09, on_timeout=OnTimeout.END_TRIAL)
    outcome = host.play(CycleProgram((segment,)))
    if ends_after_ms is None:
        assert outcome.severity is Severity.END_TRIAL
        assert "did not end within 0.09 s" in outcome.reason
    else:
        assert outcome.severity is Severity.DONE
        assert host.cycle.t_ns - begun_ns == ends_after_ms * 1_000_000


def test_reading_before_step_does_not_count_as_held() -> None:
    bench = Bench()
    host = bench.host()
    begun_ns = host.cycle.clock.start_ns
    bench.axis.answer = lambda t_ns: (0.0, 5.0) if (t_ns - begun_ns) % 50_000_000 == 0 else None
    push = Segment("push", {}, until=((HEAVY,),), timeout_s=0.2)
    wait = Segment("wait", {}, duration_s=0.035)
    assert host.play(CycleProgram((wait, push))).severity is Severity.DONE
    assert host.cycle.t_ns - begun_ns == 100_000_000  # 15 ms after the step began are not enough


def test_silent_sensor_captures_nothing_that_is_held() -> None:
    bench = Bench()
    cycle = bench.cycle()
    events: list[str] = []
    record = {"axis": Recorded(capture=Capture(((HEAVY,),), 0.01, 0.01))}
    cycle.connect({}, record, lambda t_ns, kind, data: events.append(kind))
    bench.axis.answer = lambda t_ns: (0.0, 5.0) if cycle.counters.cycles == 1 else None
    for _ in range(60):
        cycle.step()
    assert events == []
    bench.axis.answer = lambda t_ns: (0.0, 5.0)
    cycle.step()
    assert events == ["capture"]


def test_device_that_falls_silent_is_fault_even_unwatched() -> None:
    bench = Bench()
    rows = iter([(0.0, 1.0)] * 10)
    bench.axis.answer = lambda t_ns: next(rows, None)
    outcome = bench.host().play(move("go", 1.0, 5.0))
    assert outcome.severity is Severity.FAULT
    assert outcome.reason.startswith("axis gave no row for 100 ms (check its supply")
    assert bench.axis.safe_calls == 1


class Idle(Link):
    """A link that notes when it is told that no cycle follows, and fails then."""

    lost = 812

    def __init__(self, told: list[str]) -> None:
        super().__init__(None)
        self.told = told

    def open(self) -> None:
        pass

    def begin(self, t_ns: int) -> None:
        self.told.append("begin")

    def idle(self) -> None:
        self.told.append("idle")
        raise RuntimeError("no thread")

    def close(self) -> None:
        pass


class Telling(Axis):
    """An axis that notes when it is made safe, and asked whether it is."""

    def make_safe(self) -> None:
        super().make_safe()
        self.log.append("order")

    def confirm_safe(self) -> None:
        self.log.append("confirm")


def test_links_are_idle_between_order_and_confirming() -> None:
    axis = Telling()
    cycle = Bench(axis=axis).cycle({"bus": Idle(axis.log)})
    cycle.step()
    problems = cycle.make_safe()
    assert axis.log == ["begin", "order", "idle", "confirm"]
    assert "bus is not read any more: no thread" in problems


def test_silent_device_on_overflowed_link_is_told_so() -> None:
    axis = Telling()
    link = Idle(axis.log)
    axis.link = link  # type: ignore[assignment]
    rows = iter([(0.0, 1.0)] * 10)
    axis.answer = lambda t_ns: next(rows, None)
    cycle = Bench(axis=axis).cycle({"bus": link})
    outcome = None
    while outcome is None:
        outcome = cycle.step()
    assert "its link overflowed: 812 frames lost" in outcome.reason
    assert "cable" not in outcome.reason


def test_a_device_fault_makes_every_device_safe() -> None:
    bench = Bench()

    def fail(t_ns: int) -> None:
        raise DeviceError("over-temperature", hint="let it cool")

    bench.axis.answer = fail
    outcome = bench.host().play(move("go", 1.0))
    told = "axis: over-temperature (let it cool)"
    assert (outcome.severity, outcome.reason) == (Severity.FAULT, told)
    # The first device refuses to be made safe; the axis is made safe all the same.
    assert (bench.other.safe_calls, bench.axis.safe_calls) == (1, 1)
    assert any("relay welded" in str(data) for _, _, _, data in bench.sink.events)


class DeafAxis(Axis):
    """Refuses its setpoints."""

    def write(self, setpoints: object) -> None:
        raise DeviceError("heartbeat lost")


def test_device_that_refuses_setpoint_is_fault() -> None:
    bench = Bench(axis=DeafAxis())
    outcome = bench.host().play(move("go", 1.0))
    assert (outcome.severity, outcome.reason) == (Severity.FAULT, "axis: heartbeat lost")
    assert bench.axis.safe_calls == 1
