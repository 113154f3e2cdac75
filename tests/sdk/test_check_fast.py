"""The suite finds every mistake of a fast driver with a device, and none in a good one."""

from __future__ import annotations

import json
import math
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, ClassVar

import pytest
from support.instruments.memory_motor import Good, MotorConfig, MotorRow, MotorWire, WireLink, motor
from support.instruments.memory_wire import assert_found, each_mistake

from rigd.sdk import Declaration, Driver, LinkError, Row
from rigd.sdk.check import Peer, SentReading, check_driver, examine_driver
from rigd.sdk.check.suite import RULES


def test_good_driver_passes_every_rule() -> None:
    report = check_driver(Good, {"speed_range": "1 m/s"}, peer=motor)
    assert report.findings == ()
    assert report.skipped.keys() == {
        "safe while stuck", "ready is true", "watchdog that never acts", "refused",
        "another at open",
    }  # fmt: skip
    assert len(report.checked) > 20


# One bad driver for each rule: each is good but for one mistake.


class Unready(Good):
    def preflight(self) -> Sequence[str]:
        return ("I do not feel like it",)


class Closed(Good):
    def open(self) -> None:
        raise KeyError("port")


class Untyped(Good):
    def read(self, t_ns: int) -> Sequence[float] | None:
        return (0.0, 50.0, 1)


class SwappedRow(Row):
    load: float
    speed: float
    status: int


class Swapped(Good):
    def read(self, t_ns: int) -> Sequence[float] | None:
        return SwappedRow.of(speed=0.0, load=50.0, status=1)


class SwappedByPlace(Good):
    def read(self, t_ns: int) -> Sequence[float] | None:
        return MotorRow.of(50.0, 0.0, 1)  # type: ignore[call-arg]


class LongRow(MotorRow):
    torque: float


class Long(Good):
    def read(self, t_ns: int) -> Sequence[float] | None:
        return LongRow.of(speed=0.0, load=50.0, status=1, torque=0.0)


class ShortRow(Row):
    speed: float
    status: int


class Short(Good):
    def read(self, t_ns: int) -> Sequence[float] | None:
        return ShortRow.of(speed=0.0, status=1)


class PlainShort(Good):
    @classmethod
    def declare(cls, config: MotorConfig) -> Declaration:
        return replace(super().declare(config), row=None, plain_rows=True)

    def read(self, t_ns: int) -> Sequence[float] | None:
        return (0.0, 1)


class Texts(Good):
    def read(self, t_ns: int) -> Any:
        return MotorRow.of(speed="0.0", load=50.0, status=1)  # type: ignore[arg-type]


class FloatStatus(Good):
    def read(self, t_ns: int) -> Sequence[float] | None:
        return MotorRow.of(speed=0.0, load=50.0, status=1.0)  # type: ignore[arg-type]


class OurBit(Good):
    def read(self, t_ns: int) -> Sequence[float] | None:
        return MotorRow.of(speed=0.0, load=50.0, status=1 << 31)


class Undefined(Good):
    def read(self, t_ns: int) -> Sequence[float] | None:
        return MotorRow.of(speed=math.nan, load=50.0, status=1)


class OutOfRange(Good):
    def read(self, t_ns: int) -> Sequence[float] | None:
        return MotorRow.of(speed=1e3, load=50.0, status=1)


class Ahead(Good):
    def read(self, t_ns: int) -> Sequence[float] | None:
        self.taken_ns = t_ns + 10**9
        return super().read(t_ns)


class Standing(Good):
    taken_ns = 1


class Mute(Good):
    def read(self, t_ns: int) -> Sequence[float] | None:
        return None


class Waiting(Good):
    def read(self, t_ns: int) -> Sequence[float] | None:
        time.sleep(0.02)
        return super().read(t_ns)


class Dawdling(Good):
    def arm(self) -> None:
        if self.link.wire.fault == "silent":
            time.sleep(0.4)
        super().arm()


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
    armed = made_safe = False

    def arm(self) -> None:
        self.armed = True

    def make_safe(self) -> None:
        """Be safe, once."""
        if self.made_safe:
            raise RuntimeError("already safe")
        self.made_safe = self.armed


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
    """Gives rows after any failure; never to be believed."""

    def read(self, t_ns: int) -> Sequence[float] | None:
        return self.row()


class BadWords(Good):
    def read(self, t_ns: int) -> Sequence[float] | None:
        if self.link.wire.fault:
            raise OSError(5, "Input/output error")
        return self.row()


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
    ("any order of calls", Closed, "KeyError"),
    ("any order of calls", Unready, "I do not feel like it"),
    (
        "any order of calls",
        Untyped,
        "a row is (0.0, 50.0, 1), expected MotorRow(speed, load, status)",
    ),
    (
        "any order of calls",
        Swapped,
        "a row is SwappedRow(load=50.0, speed=0.0, status=1), expected MotorRow",
    ),
    ("any order of calls", SwappedByPlace, "positional argument"),
    ("any order of calls", Long, "a row is LongRow"),
    ("any order of calls", Short, "a row is ShortRow"),
    ("any order of calls", PlainShort, "expected 3 numbers"),
    ("any order of calls", Texts, "speed is '0.0'"),
    ("any order of calls", FloatStatus, "expected an int"),
    ("any order of calls", OurBit, "bits are 0 to 30"),
    ("any order of calls", Undefined, "speed is nan"),
    ("any order of calls", OutOfRange, "beyond its range"),
    ("any order of calls", Ahead, "taken_ns of a row is after the cycle"),
    ("any order of calls", Standing, "taken_ns of a row is not after that of the row before"),
    ("any order of calls", Mute, "gave no row"),
    ("bounded", Waiting, "read takes"),
    ("silent", Dawdling, "arm() takes 0."),
    ("bounded", Hanging, "did not return"),
    ("any order of calls", TakesNan, "nan"),
    ("any order of calls", Brittle, "KeyError"),
    ("any order of calls", SafeOnce, "make_safe again raises RuntimeError"),
    ("any order of calls", OpenOnce, "RuntimeError"),
    ("any order of calls", Clinging, "busy"),
    ("any order of calls", Boasting, "returns 99.0 s"),
    ("any order of calls", Helpless, "no way"),
    ("dead", Inventive, "still gives rows"),
    ("dead", BadWords, "a cycle raises OSError"),
    ("dead", Stubborn, "close raises OSError"),
    ("silent", Inventive, "still gives rows"),
    ("frozen", Inventive, "still gives rows"),
    ("late", WaitsForLate, "read takes"),
    ("silent at open", Startled, "UnicodeDecodeError"),
    ("garbled at open", Startled, "UnicodeDecodeError"),
    ("garbled", BelievesGarbage, "expected MotorRow"),
]


@each_mistake(BAD)
def test_mistake_is_found_by_its_rule(rule: str, driver: type[Driver], words: str) -> None:
    assert_found(examine_driver(driver, peer=motor, only=[rule]), rule, words)


class Dropping(Good):
    """Makes a dictionary in each read, and drops it."""

    def read(self, t_ns: int) -> Sequence[float] | None:
        values = dict.fromkeys(MotorRow.fields, 50.0)
        return MotorRow.of(speed=0.0, load=values["load"], status=1)


def test_what_the_device_keeps_is_no_leak() -> None:
    kept: list[SentReading] = []  # in memory that the driver has given back

    class Keeping(MotorWire):
        def __setattr__(self, name: str, value: object) -> None:
            super().__setattr__(name, value)
            kept.append(SentReading(0.0, json.loads('{"speed": 0, "load": 50}')))

    @contextmanager
    def keeping() -> Iterator[Peer]:
        wire = Keeping()
        yield replace(wire.peer(lambda: WireLink(wire)), readings=kept)

    assert not examine_driver(Dropping, peer=keeping, only=["bounded"]).findings
    assert kept


class Pretending(WireLink):
    """A link that reports being open in any state."""

    def open(self) -> None:
        pass


class Curt(WireLink):
    def open(self) -> None:
        raise LinkError("no")


@pytest.mark.parametrize(
    ("link", "words"), [(Pretending, "open() succeeds"), (Curt, "without a hint")]
)
def test_missing_device_must_raise_link_error(link: type[WireLink], words: str) -> None:
    @contextmanager
    def peer() -> Iterator[Peer]:
        wire = MotorWire()
        yield Peer(link=lambda: link(wire), faults={"dead": lambda: wire.begin("dead")})

    finding, *_ = examine_driver(Good, peer=peer, only=["not there"]).findings
    assert words in finding.problem


def test_every_rule_has_a_driver_that_breaks_it() -> None:
    of_actuators = {
        "safe while stuck", "ready is true", "watchdog that never acts", "refused"
    }  # fmt: skip
    assert {rule.name for rule in RULES[Driver]} - of_actuators == {
        "not there", "as often as asked", "another at open", *(rule for rule, _, _ in BAD)
    }  # fmt: skip


def test_skipped_rules_are_reported_with_the_reason() -> None:
    report = examine_driver(Good)
    assert report.findings == ()
    assert report.skipped["bounded"] == "no peer was given"

    @contextmanager
    def healthy() -> Iterator[Peer]:
        yield Peer(link=lambda: WireLink(MotorWire()))

    report = examine_driver(Good, peer=healthy, only=["bounded", "dead"])
    assert report.skipped == {"dead": "the peer has no fault 'dead'"}
    report = examine_driver(Closed, peer=motor)
    assert {finding.rule for finding in report.findings} == {"any order of calls"}
    assert report.skipped["bounded"] == "correct the findings above first"
