"""The suite finds every mistake that a fast driver can make, and none in a good one."""

from __future__ import annotations

import itertools
import math
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Annotated, Any, ClassVar

import pytest
from pydantic import ConfigDict

from rigd.sdk import Channel, DeviceError, Driver, DriverConfig, In, Link, LinkConfig, LinkError
from rigd.sdk.check import FAULTS, NonConforming, Peer, check_driver, examine_driver
from rigd.sdk.check import declared as declared_rules
from rigd.sdk.check.cycled import RULES


class Wire:
    """A motor in memory: one session at a time, and one fault at a time."""

    def __init__(self) -> None:
        self.fault = ""
        self.taken = False
        self.speed = 0.0

    def begin(self, fault: str) -> None:
        self.fault = fault


class WireLink(Link):
    """The way to a motor in memory."""

    def __init__(self, wire: Wire) -> None:
        super().__init__(LinkConfig())
        self.wire = wire
        self.ours = False

    def open(self) -> None:
        if self.wire.fault == "dead":
            raise LinkError("nothing is connected", hint="plug it in")
        if self.wire.taken:
            raise LinkError("somebody has it", hint="end the other session")
        self.wire.taken = self.ours = True

    def close(self) -> None:
        if self.ours:
            self.wire.taken = self.ours = False


@contextmanager
def motor() -> Iterator[Peer]:
    wire = Wire()
    yield Peer(
        link=lambda: WireLink(wire),
        faults={fault: lambda fault=fault: wire.begin(fault) for fault in FAULTS},  # type: ignore[misc]
    )


class MotorConfig(DriverConfig):
    """A motor in memory."""

    speed_range: Annotated[float, In("m/s")] = 2.0
    """Largest speed of either sign."""


class Good(Driver):
    """A motor in memory; safe means standing still."""

    Config: ClassVar[type[DriverConfig]] = MotorConfig
    title: ClassVar[str] = "motor in memory"
    has_status = True
    status_bits: Mapping[str, int] = {"moving": 1}
    watchdog_s = 0.05
    second_link: ClassVar[bool] = True
    link: WireLink

    def __init__(self, config: MotorConfig, link: WireLink | None) -> None:
        super().__init__(config, link)
        top = config.speed_range
        self.channels: tuple[Channel, ...] = (Channel("speed", "m/s", "speed", -9.0, 9.0),)
        self.setpoints: tuple[Channel, ...] = (Channel("speed", "m/s", "speed", -top, top),)

    def open(self) -> None:
        """Open."""

    def prove_watchdog(self) -> float:
        """Prove it."""
        return 0.05

    def arm(self) -> None:
        """Arm."""

    def read(self, t_ns: int) -> Sequence[float] | None:
        """Read."""
        if self.link.wire.fault == "dead":
            raise LinkError("the motor is gone")
        return None if self.link.wire.fault else (self.link.wire.speed, 1)

    def write(self, setpoints: Sequence[float]) -> None:
        """Write."""
        (speed,) = setpoints
        if math.isnan(speed):
            raise DeviceError("speed is NaN")
        self.link.wire.speed = min(max(speed, self.setpoints[0].low), self.setpoints[0].high)

    def make_safe(self) -> None:
        """Stand still, which is the safe state."""
        if self.link is not None:
            self.link.wire.speed = 0.0

    def rescue(self) -> None:
        """Stand still over a link of its own."""
        self.link.open()
        self.make_safe()
        self.link.close()


def test_a_good_driver_passes_every_rule() -> None:
    report = check_driver(Good, {"speed_range": "1 m/s"}, peer=motor)
    assert report.findings == ()
    assert report.skipped == {}
    assert len(report.checked) > 20


# One bad driver for each rule: each is good but for one mistake.


class Untitled(Good):
    title = ""


class Unsaid(Good):
    def make_safe(self) -> None:
        pass


class Wordless(Good):
    has_status = False
    status_bits: Mapping[str, int] = {"moving": 1}


class TakenBit(Good):
    status_bits: Mapping[str, int] = {"old": 1 << 31}


class Unexplained(Driver):
    """A motor."""

    title: ClassVar[str] = "motor"

    def open(self) -> None:
        """Open."""

    def arm(self) -> None:
        """Arm."""

    def read(self, t_ns: int) -> Sequence[float] | None:
        """Read."""
        return None

    def write(self, setpoints: Sequence[float]) -> None:
        """Write."""

    def make_safe(self) -> None:
        """Do something."""


class LaxConfig(MotorConfig):
    model_config = ConfigDict(extra="ignore")


class Lax(Good):
    Config = LaxConfig


class UndocumentedConfig(MotorConfig):
    turns: Annotated[float, In("rev")] = 1.0


class Undocumented(Good):
    Config = UndocumentedConfig


class BareConfig(MotorConfig):
    gain: float | None = None
    """A number of what?"""


class Bare(Good):
    Config = BareConfig


class Eager(Good):
    def __init__(self, config: MotorConfig, link: WireLink | None) -> None:
        super().__init__(config, link)
        self.link.wire.speed = 0.0  # link is None


class Sleeper(Good):
    def __init__(self, config: MotorConfig, link: WireLink | None) -> None:
        super().__init__(config, link)
        threading.Event().wait()


class Fickle(Good):
    _count = itertools.count()

    def __init__(self, config: MotorConfig, link: WireLink | None) -> None:
        super().__init__(config, link)
        self.channels = (Channel(f"speed_{next(self._count)}", "m/s", "speed"),)


class Misnamed(Good):
    def __init__(self, config: MotorConfig, link: WireLink | None) -> None:
        super().__init__(config, link)
        self.channels = (Channel("Speed", "m/s", "speed"),)


class Status(Good):
    def __init__(self, config: MotorConfig, link: WireLink | None) -> None:
        super().__init__(config, link)
        self.channels = (Channel("status", "1", "status"),)


class RawOfNothing(Good):
    def __init__(self, config: MotorConfig, link: WireLink | None) -> None:
        super().__init__(config, link)
        self.channels = (Channel("volts", "V", "volts", raw_of="speed"),)


class Unlimited(Good):
    def __init__(self, config: MotorConfig, link: WireLink | None) -> None:
        super().__init__(config, link)
        self.setpoints = (Channel("speed", "m/s", "speed"),)


class Unproven(Good):
    prove_watchdog = Driver.prove_watchdog


class Inert(Good):
    actions = {"tare": "sets zero"}  # noqa: RUF012


class Patient(Good):
    silent_s = 0.0


class NeedsLink(Good):
    def make_safe(self) -> None:
        """Stand still, which is safe."""
        self.link.wire.speed = 0.0


class Unready(Good):
    def preflight(self) -> Sequence[str]:
        return ("I do not feel like it",)


class Closed(Good):
    def open(self) -> None:
        raise KeyError("port")


class Short(Good):
    def read(self, t_ns: int) -> Sequence[float] | None:
        return (0.0,)


class Texts(Good):
    def read(self, t_ns: int) -> Any:
        return ("0.0", 1)


class FloatStatus(Good):
    def read(self, t_ns: int) -> Sequence[float] | None:
        return (0.0, 1.0)


class OurBit(Good):
    def read(self, t_ns: int) -> Sequence[float] | None:
        return (0.0, 1 << 31)


class Undefined(Good):
    def read(self, t_ns: int) -> Sequence[float] | None:
        return (math.nan, 1)


class OutOfRange(Good):
    def read(self, t_ns: int) -> Sequence[float] | None:
        return (1e3, 1)


class Mute(Good):
    def read(self, t_ns: int) -> Sequence[float] | None:
        return None


class Waiting(Good):
    def read(self, t_ns: int) -> Sequence[float] | None:
        time.sleep(0.02)
        return super().read(t_ns)


class Hanging(Good):
    def read(self, t_ns: int) -> Sequence[float] | None:
        threading.Event().wait()
        return None


class TakesNan(Good):
    def write(self, setpoints: Sequence[float]) -> None:
        self.link.wire.speed = min(max(setpoints[0], -1.0), 1.0)


class Brittle(Good):
    def write(self, setpoints: Sequence[float]) -> None:
        super().write([{-2.0: -2.0, 0.0: 0.0, 2.0: 2.0}[setpoints[0]]])


class SafeOnce(Good):
    made_safe = False

    def make_safe(self) -> None:
        """Be safe, once."""
        if self.made_safe:
            raise RuntimeError("already safe")
        self.made_safe = self.link is not None


class OpenOnce(Good):
    is_open = False

    def open(self) -> None:
        if self.is_open:
            raise RuntimeError("already open")
        self.is_open = True


class Clinging(Good):
    held: ClassVar[set[int]] = set()

    def open(self) -> None:
        if id(self.link.wire) in self.held:
            raise LinkError("busy")
        self.held.add(id(self.link.wire))


class Boasting(Good):
    def prove_watchdog(self) -> float:
        return 99.0


class Helpless(Good):
    def rescue(self) -> None:
        raise LinkError("no way")


class Inventive(Good):
    """Gives rows whatever happens; never safe to believe."""

    def read(self, t_ns: int) -> Sequence[float] | None:
        return (0.0, 1)


class BadWords(Good):
    def read(self, t_ns: int) -> Sequence[float] | None:
        if self.link.wire.fault:
            raise OSError(5, "Input/output error")
        return (0.0, 1)


class WaitsForLate(Good):
    def read(self, t_ns: int) -> Sequence[float] | None:
        if self.link.wire.fault == "late":
            time.sleep(0.02)
        return super().read(t_ns)


class BelievesGarbage(Good):
    def read(self, t_ns: int) -> Sequence[float] | None:
        return (0.0, 1, 2, 3) if self.link.wire.fault == "garbled" else super().read(t_ns)


class Stubborn(Good):
    def close(self) -> None:
        if self.link.wire.fault:
            raise OSError(5, "Input/output error")


class Startled(Good):
    def open(self) -> None:
        if self.link.wire.fault:
            raise UnicodeDecodeError("ascii", b"\xff", 0, 1, "not in range")


BAD: list[tuple[str, type[Driver], str]] = [
    ("title", Untitled, "title is ''"),
    ("safe is said", Unsaid, "no docstring"),
    ("safe is said", Unexplained, "nowhere says what safe means"),
    ("options strict", Lax, "unknown option is accepted"),
    ("options documented", Undocumented, "option turns"),
    ("options have units", Bare, "option gain is a bare float"),
    ("constructor opens nothing", Eager, "AttributeError"),
    ("constructor opens nothing", Sleeper, "did not return"),
    ("same again", Fickle, "differ in channels"),
    ("status bits", Wordless, "has_status is False"),
    ("status bits", TakenBit, "'old' is 0x80000000, not within"),
    ("channels", Misnamed, "'Speed'"),
    ("channels", Status, "taken by the status word"),
    ("channels", RawOfNothing, "raw_of 'speed'"),
    ("setpoints", Unlimited, "range -inf to inf"),
    ("hooks", Unproven, "prove_watchdog"),
    ("hooks", Inert, "actions tare"),
    ("silence", Patient, "silent_s is 0"),
    ("safe and closed before open", NeedsLink, "make_safe before open raises AttributeError"),
    ("opens and arms", Closed, "KeyError"),
    ("opens and arms", Unready, "I do not feel like it"),
    ("rows", Short, "expected 2 numbers"),
    ("rows", Texts, "speed is '0.0'"),
    ("rows", FloatStatus, "expected an int"),
    ("rows", OurBit, "bits are 0 to 30"),
    ("rows", Undefined, "speed is nan"),
    ("rows", OutOfRange, "beyond its range"),
    ("rows", Mute, "gave no row"),
    ("bounded", Waiting, "read takes"),
    ("bounded", Hanging, "did not return"),
    ("no NaN", TakesNan, "as if it were a setpoint"),
    ("setpoints beyond the range", Brittle, "KeyError"),
    ("safe twice, closed twice", SafeOnce, "make_safe again raises RuntimeError"),
    ("opened twice", OpenOnce, "RuntimeError"),
    ("lets go", Clinging, "the second of two"),
    ("watchdog", Boasting, "returns 99.0 s"),
    ("rescue", Helpless, "no way"),
    ("dead", Inventive, "still gives rows"),
    ("dead", BadWords, "a cycle raises OSError"),
    ("dead", Stubborn, "close raises OSError"),
    ("silent", Inventive, "still gives rows"),
    ("late", WaitsForLate, "read waits"),
    ("silent at open", Startled, "UnicodeDecodeError"),
    ("garbled at open", Startled, "UnicodeDecodeError"),
    ("garbled", BelievesGarbage, "expected 2 numbers"),
]


@pytest.mark.parametrize(
    ("rule", "driver", "words"), BAD, ids=lambda item: getattr(item, "__name__", "")
)
def test_a_mistake_is_found_by_its_rule(rule: str, driver: type[Driver], words: str) -> None:
    report = examine_driver(driver, peer=motor, only=[rule])
    assert [finding.rule for finding in report.findings][:1] == [rule]
    assert any(words in finding.problem for finding in report.findings), str(report)


class Pretending(WireLink):
    """A link that says it is open whatever it finds."""

    def open(self) -> None:
        pass


class Curt(WireLink):
    def open(self) -> None:
        raise LinkError("no")


@pytest.mark.parametrize(
    ("link", "words"), [(Pretending, "open() succeeds"), (Curt, "not what to do about it")]
)
def test_a_device_that_is_not_there_must_be_missed(link: type[WireLink], words: str) -> None:
    @contextmanager
    def peer() -> Iterator[Peer]:
        wire = Wire()
        yield Peer(link=lambda: link(wire), faults={"dead": lambda: wire.begin("dead")})

    (finding,) = examine_driver(Good, peer=peer, only=["not there"]).findings
    assert words in finding.problem


def test_no_rule_is_without_a_driver_that_breaks_it() -> None:
    rules = (
        *declared_rules.CLASS_RULES,
        *declared_rules.CONSTRUCTOR,
        *declared_rules.UNOPENED_RULES,
        *RULES,
    )
    assert {rule.name for rule in rules} == {rule for rule, _, _ in BAD} | {"not there"}


def test_all_breaches_are_told_at_once_with_what_to_do() -> None:
    class Several(Untitled):
        silent_s = -1.0

    with pytest.raises(NonConforming) as caught:
        check_driver(Several, peer=motor)
    text = str(caught.value)
    assert "2 rules broken" in text
    assert "title is ''" in text
    assert "give the class a `title` of one line" in text
    assert "silent_s is -1" in text


def test_what_cannot_be_tried_is_said() -> None:
    report = examine_driver(Good)
    assert report.findings == ()
    assert report.skipped["rows"] == "no peer was given"

    @contextmanager
    def healthy() -> Iterator[Peer]:
        yield Peer(link=lambda: WireLink(Wire()))

    report = examine_driver(Good, peer=healthy, only=["rows", "dead"])
    assert report.skipped == {"dead": "the peer has no fault 'dead'"}
    report = examine_driver(Closed, peer=motor)
    assert {finding.rule for finding in report.findings} == {"opens and arms"}
    assert report.skipped["rows"] == "mend what is above first"


def test_a_suite_used_wrongly_says_so() -> None:
    with pytest.raises(ValueError, match="no rule speed; there are title"):
        examine_driver(Good, only=["speed"])
    with pytest.raises(ValueError, match="options given to the suite are not accepted"):
        examine_driver(Good, {"speed_range": "1 kg"})
    with pytest.raises(TypeError, match="derives from none of"):
        examine_driver(Wire)  # type: ignore[arg-type]

    @contextmanager
    def odd() -> Iterator[Peer]:
        yield Peer(faults={"sleepy": lambda: None})

    with pytest.raises(ValueError, match="has the fault sleepy; those the suite knows are dead"):
        examine_driver(Good, peer=odd)
