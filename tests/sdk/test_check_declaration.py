"""The suite finds every mistake in what a driver declares, and in a driver that is not open."""

from __future__ import annotations

import colorsys
import contextlib
import itertools
import socket
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Annotated, Any, ClassVar

import pytest
from pydantic import ConfigDict
from support.instruments.memory_motor import Good, MotorConfig, MotorRow, MotorWire, WireLink, motor
from support.instruments.memory_wire import assert_found, each_mistake

from rigd.sdk import Channel, Declaration, Driver, DriverConfig, In, LinkError, Row
from rigd.sdk.check import NonConforming, Peer, check_driver, examine_driver
from rigd.sdk.check import declaration_rules as declared_rules

# One bad driver for each rule: each is good but for one mistake.


class Untitled(Good):
    title = ""


class Unsaid(Good):
    def make_safe(self) -> None:
        pass


class Wordless(Good):
    @classmethod
    def declare(cls, config: MotorConfig) -> Declaration:
        return replace(super().declare(config), row=None, plain_rows=True, has_status=False)


class TakenBit(Good):
    @classmethod
    def declare(cls, config: MotorConfig) -> Declaration:
        return replace(super().declare(config), status_bits={"old": 1 << 31})


class Unexplained(Driver[DriverConfig, None]):
    """A motor."""

    title: ClassVar[str] = "motor"

    @classmethod
    def declare(cls, config: DriverConfig) -> Declaration:
        return Declaration()

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


class UnreadConfig(DriverConfig):
    turns_of_winding: Annotated[float, In("rev")] = 1.0
    """Turns of the winding."""


class Unread(Good):
    Config = UnreadConfig


# All tests are one package, in which others read options; these stand in a module that does not.
UnreadConfig.__module__ = Unread.__module__ = colorsys.__name__


class BareConfig(MotorConfig):
    gain: float | None = None
    """A number of what?"""


class Bare(Good):
    Config = BareConfig


class Undeclared(Good):
    @classmethod
    def declare(cls, config: MotorConfig) -> Any:
        return {"channels": ()}


class Refusing(Good):
    @classmethod
    def declare(cls, config: MotorConfig) -> Declaration:
        return replace(super().declare(config), row=SwappedRow)


class SwappedRow(Row):
    load: float
    speed: float
    status: int


class LongRow(MotorRow):
    torque: float


class Long(Good):
    @classmethod
    def declare(cls, config: MotorConfig) -> Declaration:
        return replace(super().declare(config), row=LongRow)


class ShortRow(Row):
    speed: float
    status: int


class Short(Good):
    @classmethod
    def declare(cls, config: MotorConfig) -> Declaration:
        return replace(super().declare(config), row=ShortRow)


class Pondering(Good):
    @classmethod
    def declare(cls, config: MotorConfig) -> Declaration:
        threading.Event().wait()
        return super().declare(config)


class Eager(Good):
    def __init__(self, config: MotorConfig, link: WireLink) -> None:
        super().__init__(config, link)
        if not link.ours:
            raise LinkError("the link is not open")


class Sleeper(Good):
    def __init__(self, config: MotorConfig, link: WireLink) -> None:
        super().__init__(config, link)
        threading.Event().wait()


class Fickle(Good):
    _count = itertools.count()

    @classmethod
    def declare(cls, config: MotorConfig) -> Declaration:
        return replace(super().declare(config), silent_s=1.0 + next(cls._count))


class OtherChannels(Good):
    channels: tuple[Channel, ...] = ()

    @classmethod
    def declare(cls, config: MotorConfig) -> Declaration:
        plain = replace(super().declare(config), row=None, plain_rows=True)
        return replace(plain, channels=cls.channels)


class Misnamed(OtherChannels):
    channels = (Channel("Speed", "m/s", "speed"),)


class Status(OtherChannels):
    channels = (Channel("status", "1", "status"),)


class RawOfNothing(OtherChannels):
    channels = (Channel("volts", "V", "volts", raw_of="speed"),)


class Nameless(Good):
    @classmethod
    def declare(cls, config: MotorConfig) -> Declaration:
        return replace(super().declare(config), row=None)


class Twofold(Good):
    @classmethod
    def declare(cls, config: MotorConfig) -> Declaration:
        return replace(super().declare(config), plain_rows=True)


class Unlimited(Good):
    @classmethod
    def declare(cls, config: MotorConfig) -> Declaration:
        return replace(super().declare(config), setpoints=(Channel("speed", "m/s", "speed"),))


class Unproven(Good):
    prove_watchdog = Driver.prove_watchdog


class Inert(Good):
    @classmethod
    def declare(cls, config: MotorConfig) -> Declaration:
        return replace(super().declare(config), actions={"tare": "sets zero"})


class Patient(Good):
    @classmethod
    def declare(cls, config: MotorConfig) -> Declaration:
        return replace(super().declare(config), silent_s=0.0)


class NeedsOpen(Good):
    def make_safe(self) -> None:
        """Stand still, which is safe."""
        if not self.link.ours:
            raise LinkError("the link is not open")


class PlacedConfig(MotorConfig):
    """A motor at an address."""

    host: str = "127.0.0.1"
    """Where it is."""


class Placed(Good):
    Config: ClassVar[type[DriverConfig]] = PlacedConfig

    def open(self) -> None:
        with contextlib.suppress(OSError), socket.socket() as connection:
            connection.connect((self.host(), 9))

    def host(self) -> str:
        return str(self.config.host)  # type: ignore[attr-defined]


class Misplaced(Placed):
    def host(self) -> str:
        return "127.0.0.1"


BAD: list[tuple[str, type[Driver], str]] = [
    ("title", Untitled, "title is ''"),
    ("safe is described", Unsaid, "no docstring"),
    ("safe is described", Unexplained, "no docstring states what safe means"),
    ("options strict", Lax, "unknown option is accepted"),
    ("options documented", Undocumented, "option turns"),
    ("options are read", Unread, "nothing reads option turns_of_winding"),
    ("options have units", Bare, "option gain is a bare float"),
    ("declares", Undeclared, "expected a Declaration"),
    ("declares", Refusing, "fields load, speed; the channels are speed, load"),
    ("declares", Long, "has no field 'status'"),
    ("declares", Short, "fields speed; the channels are speed, load"),
    ("declares", Pondering, "did not return"),
    ("constructor opens nothing", Eager, "LinkError"),
    ("constructor opens nothing", Sleeper, "did not return"),
    ("same again", Fickle, "differ in silent_s"),
    ("status bits", Wordless, "no status word"),
    ("status bits", TakenBit, "'old' is 0x80000000, not within"),
    ("channels", Misnamed, "'Speed'"),
    ("channels", Status, "taken by the status word"),
    ("channels", RawOfNothing, "raw_of 'speed'"),
    ("row is named", Nameless, "names no row"),
    ("row is named", Twofold, "a row and plain_rows"),
    ("setpoints", Unlimited, "range -inf to inf"),
    ("hooks", Unproven, "prove_watchdog"),
    ("hooks", Inert, "actions tare"),
    ("silence", Patient, "silent_s is 0"),
    ("address is used", Misplaced, "host is 127.0.0.2, and open() connects to 127.0.0.1"),
    ("safe and closed before open", NeedsOpen, "make_safe before open raises LinkError"),
]


@each_mistake(BAD)
def test_mistake_is_found_by_its_rule(rule: str, driver: type[Driver], words: str) -> None:
    assert_found(examine_driver(driver, peer=motor, only=[rule]), rule, words)


def test_driver_at_the_address_of_its_file_passes() -> None:
    assert examine_driver(Placed, peer=motor, only=["address is used"]).findings == ()


def test_every_rule_has_a_driver_that_breaks_it() -> None:
    rules = (
        *declared_rules.CLASS_RULES,
        *declared_rules.DECLARES,
        *declared_rules.DECLARED_RULES,
        *declared_rules.UNOPENED_RULES,
    )
    assert {rule.name for rule in rules} == {rule for rule, _, _ in BAD}


def test_all_findings_are_reported_at_once_with_advice() -> None:
    class Several(Patient):
        title = ""

    with pytest.raises(NonConforming) as caught:
        check_driver(Several, peer=motor)
    text = str(caught.value)
    assert "2 rules broken" in text
    assert "title is ''" in text
    assert "give the class a `title` of one line" in text
    assert "silent_s is 0" in text


def test_wrong_use_of_the_suite_is_refused() -> None:
    with pytest.raises(ValueError, match="no rule speed; there are title"):
        examine_driver(Good, only=["speed"])
    with pytest.raises(ValueError, match=r"options .*not accepted"):
        examine_driver(Good, {"speed_range": "1 kg"})
    with pytest.raises(TypeError, match="derives from none of"):
        examine_driver(MotorWire)  # type: ignore[arg-type]

    @contextmanager
    def odd() -> Iterator[Peer]:
        yield Peer(faults={"sleepy": lambda: None})

    with pytest.raises(ValueError, match=r"fault sleepy; .*dead"):
        examine_driver(Good, peer=odd)
