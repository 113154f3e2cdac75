"""After a run that did not reach its end rows go on for a while, and nothing is written."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType

import pytest
from support.engine.bench import PERIOD_NS, Axis, Bench, ListSink, Stubborn, move, procedure

from rigd.config.rig import RestBound, Supervision
from rigd.engine.cycle.cycle import Cycle
from rigd.engine.cycle.resting import LEAST_NS, STEP_NS, STILL_NS, Resting
from rigd.engine.run.result import RunResult
from rigd.engine.sink import Rows
from rigd.model.errors import DeviceError, Exit
from rigd.model.rows import TIME_FIELD
from rigd.model.severity import Severity
from rigd.model.states import RunState
from rigd.sdk import Link, LinkConfig

REST_NS = round(Supervision().rest_s * 1e9)


class Wire(Link):
    """A link on which reading sends nothing."""

    reads_on = True
    ends = 0

    def open(self) -> None:
        pass

    def end(self, t_ns: int) -> None:
        self.ends += 1

    def close(self) -> None:
        pass


class Coasting(Axis):
    """An axis that slows down by itself once it is safe, and tells what was asked of it."""

    def __init__(self, link: Link | None) -> None:
        super().__init__()
        self.link = link  # type: ignore[assignment]  # the bench declares none
        self.asked: list[str] = []
        self.moving = 1.0
        self.stop: Callable[[], None] = lambda: None
        self.again: Callable[[], None] = lambda: None  #: called in its fifth read after that
        self.dies_at: int | None = None  #: of its reads after it was made safe
        self.stays_on = False  #: it cannot be made safe

    def read(self, t_ns: int) -> Sequence[float] | None:
        self.asked.append("read")
        if self.asked.count("write") == 50:
            self.stop()
        if self.safe_calls:
            self.moving *= 0.999
            after = self.asked[self.asked.index("make_safe") :].count("read")
            if after == 5:
                self.again()
            if self.dies_at is not None and after >= self.dies_at:
                raise DeviceError("gone")
        return [self.moving, self.load]

    def write(self, setpoints: Sequence[float]) -> None:
        self.asked.append("write")
        super().write(setpoints)

    def make_safe(self) -> None:
        self.asked.append("make_safe")
        super().make_safe()
        if self.stays_on:
            raise DeviceError("a contact is welded")


class Obeying(Stubborn):
    """A device that is made safe."""

    def make_safe(self) -> None:
        self.safe_calls += 1


class Asked(Coasting):
    """One that must be asked, and stays safe while it is."""

    reads_when_safe = True


class SendingWire(Wire):
    """A link that sends, also so that its devices can be read."""

    reads_on = False


class TimedSink(ListSink):
    """Keeps the times and values of the axis' rows."""

    def __init__(self) -> None:
        super().__init__()
        self.axis: list[tuple[int, float, float]] = []

    def write(self, stream: str, rows: Rows) -> None:
        super().write(stream, rows)
        if stream == "axis":
            self.axis += [
                (int(row[TIME_FIELD]), float(row["position"]), float(row["speed_setpoint"]))
                for row in rows
            ]


class Ended(Bench):
    """A run of a coasting axis that a person stops, in its 50th cycle or so."""

    def __init__(self, link: Link | None = None, axis: type[Coasting] = Coasting) -> None:
        self.wire = link
        self.supervision = Supervision()
        super().__init__(axis=axis(link), other=Obeying(), sink=TimedSink())
        self.sink: TimedSink
        self.axis: Coasting

    def cycle(self, links: Mapping[str, Link] = MappingProxyType({})) -> Cycle:
        cycle = super().cycle({} if self.wire is None else {"wire": self.wire})
        cycle.resting = Resting(self.supervision.at_rest, cycle.rig)
        return cycle

    def end_by(self, severity: Severity | None) -> RunResult:
        if severity is not None:
            self.axis.stop = lambda: self.control.request(severity, "asked")
        moves = procedure([move("one", 0.5, 0.2)])
        return self.run(moves, supervision=self.supervision).execute()

    def rests_below(self, bound: float, within_s: float, unit: str = "mm") -> None:
        """Let the axis rest if its position, which shrinks by 0.1 % each cycle, is below this.

        Or, if the unit is that of a speed, if it shrinks more slowly.
        """
        at_rest = (RestBound("axis.position", bound, unit, is_rate=unit == "mm/s"),)
        self.supervision = Supervision(rest_s=within_s, at_rest=at_rest)

    @property
    def end_ns(self) -> int:
        return self.sink.events[self.sink.kinds().index("run_end")][0]

    @property
    def rest_event(self) -> Mapping[str, object]:
        _, kind, _, data = self.sink.events[-1]
        assert kind == "rest"
        return data

    @property
    def after(self) -> list[tuple[int, float, float]]:
        return [row for row in self.sink.axis if row[0] > self.end_ns]


@pytest.mark.parametrize("severity", [Severity.STOP, Severity.ABORT, Severity.ESTOP])
def test_rows_go_on_after_a_stop(severity: Severity) -> None:
    bench = Ended(Wire(LinkConfig()))
    bench.end_by(severity)
    after = bench.after
    assert len(after) == REST_NS // PERIOD_NS
    assert after[0][0] == bench.end_ns + PERIOD_NS  # without a gap
    assert after[-1][1] < 0.2 < after[0][1]  # one sees it come to rest
    assert {setpoint for *_, setpoint in after} == {0.0}


def test_run_comes_to_rest_under_its_ending() -> None:
    bench = Ended(Wire(LinkConfig()))
    bench.axis.stop = lambda: bench.control.request(Severity.ABORT, "asked")
    run = bench.run(procedure([move("one", 0.5, 0.2)]))
    seen: list[tuple[str, bool, bool]] = []
    run.watch = lambda progress: seen.append(
        (progress.ending, progress.coming_to_rest, progress.state is RunState.DONE)
    )
    run.execute()
    assert seen[0] == ("", False, False)
    assert ("", False, True) not in seen  # never "done" alone
    assert seen[-1] == ("aborted", True, True)


def test_nothing_is_written_after_devices_are_safe() -> None:
    wire = Wire(LinkConfig())
    bench = Ended(wire)
    bench.end_by(Severity.ABORT)
    asked = bench.axis.asked
    assert asked[asked.index("make_safe") :].count("write") == 0
    assert wire.ends == asked.count("write")  # and the link sends no more


def test_complete_run_ends_with_its_last_cycle() -> None:
    bench = Ended(Wire(LinkConfig()))
    bench.end_by(None)
    assert bench.after == []


def test_device_is_left_alone_unless_reading_is_silent() -> None:
    bench = Ended(None)
    bench.end_by(Severity.ABORT)
    asked = bench.axis.asked
    assert asked[asked.index("make_safe") :].count("read") == 0
    assert bench.after == []


def test_device_that_fails_ends_the_rows() -> None:
    bench = Ended(Wire(LinkConfig()))
    bench.axis.dies_at = 11
    result = bench.end_by(Severity.ABORT)
    assert len(bench.after) == 10
    assert result.ending == "aborted"  # as before
    assert bench.sink.kinds()[-1] == "run_end"
    assert bench.sink.closed


def test_second_signal_ends_the_rows() -> None:
    bench = Ended(Wire(LinkConfig()))
    bench.axis.again = lambda: bench.control.request(Severity.ESTOP, "again")
    bench.end_by(Severity.ABORT)
    assert len(bench.after) == 5


@pytest.mark.parametrize("wire", [None, SendingWire(LinkConfig())], ids=["no link", "link"])
def test_device_that_stays_safe_is_asked_on(wire: SendingWire | None) -> None:
    bench = Ended(wire, Asked)
    bench.end_by(Severity.ABORT)
    assert len(bench.after) == REST_NS // PERIOD_NS
    asked = bench.axis.asked
    assert asked[asked.index("make_safe") :].count("write") == 0
    if wire is not None:
        assert wire.ends == asked.count("write") + len(bench.after)  # what asks them is sent


def test_rows_end_once_the_rig_rests() -> None:
    bench = Ended(Wire(LinkConfig()))
    bench.rests_below(0.1, within_s=30.0)
    result = bench.end_by(Severity.ABORT)
    still = [t_ns for t_ns, position, _ in bench.after if position <= 0.1]
    assert still[-1] - still[0] == pytest.approx(STILL_NS, abs=STEP_NS)
    assert bench.rest_event["rests"]
    assert result.problems == ()
    assert result.exit_code is Exit.STOPPED


def test_rows_end_once_a_position_stays() -> None:
    bench = Ended(Wire(LinkConfig()))
    bench.rests_below(0.01, within_s=30.0, unit="mm/s")
    result = bench.end_by(Severity.ABORT)
    positions = [position for _, position, _ in bench.after]
    assert positions[-STILL_NS // PERIOD_NS] - positions[-1] == pytest.approx(0.005, rel=0.03)
    assert result.problems == ()


def test_rows_go_on_for_2_s_at_rest() -> None:
    bench = Ended(Wire(LinkConfig()))
    bench.rests_below(2.0, within_s=30.0)
    bench.end_by(Severity.ABORT)
    assert bench.after[-1][0] - bench.after[0][0] == LEAST_NS


@pytest.mark.parametrize(
    ("wire", "why"),
    [
        (Wire(LinkConfig()), "axis.position reaches 82.7 mm, `at_rest` allows 1e-06 mm"),
        (None, "not known: 0.0 s after the end of the run axis.position gives no value"),
    ],
    ids=["moves", "not read"],
)
def test_rig_that_does_not_rest_is_reported(wire: Wire | None, why: str) -> None:
    bench = Ended(wire)
    bench.rests_below(1e-9, within_s=3.0)
    result = bench.end_by(Severity.ABORT)
    (reason,) = result.problems
    assert reason.endswith(why)
    assert bench.rest_event["reasons"] == [reason]
    assert not bench.rest_event["rests"]
    assert result.exit_code is Exit.TRIPPED


def test_link_is_silent_if_a_device_must_be(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its watchdog would be fed by what asks the others on that link."""
    wire = SendingWire(LinkConfig())
    bench = Ended(wire, Asked)
    monkeypatch.setattr(Asked, "reads_when_safe", False)
    bench.end_by(Severity.ABORT)
    assert bench.after == []
    assert wire.ends == bench.axis.asked.count("write")


def test_device_not_made_safe_is_asked_nothing() -> None:
    wire = SendingWire(LinkConfig())
    bench = Ended(wire, Asked)
    bench.axis.stays_on = True
    bench.end_by(Severity.ABORT)
    assert bench.after == []
    assert wire.ends == bench.axis.asked.count("write")
