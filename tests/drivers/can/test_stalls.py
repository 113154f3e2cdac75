"""What was read before this computer stood still is not held against a drive."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import pytest
from support.can.bench import Connect
from support.can.script import ScriptedBus
from support.faults.stalls import standing_still

from rigd.sdk import DeviceError, ProtocolError
from rigd_drivers.can.canopen import objects
from rigd_drivers.can.canopen.cia402 import DriveState, Mode
from rigd_drivers.can.cia402_servo import by_sdo
from rigd_drivers.can.errand import Pause, Read, until
from rigd_drivers.can.ports import Full

#: Statuswords of CiA 402 (6041h).
DISABLED, READY = 0x0250, 0x0231


@pytest.fixture
def stall(monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    return standing_still(monkeypatch)


class Node:
    """A drive that obeys after the first reading, behind which this computer stands still."""

    def __init__(self, first: int, later: int, stall: Callable[[], None]) -> None:
        self._answers = self._give(first, later, stall)
        self.bus = SimpleNamespace(wait=lambda condition, timeout_s: False)
        self.written: list[tuple[Any, int]] = []

    @staticmethod
    def _give(first: int, later: int, stall: Callable[[], None]) -> Iterator[int]:
        stall()
        yield first
        while True:
            yield later

    def read(self, entry: Any) -> int:
        return (
            1 << (Mode.CYCLIC_TORQUE - 1)
            if entry == objects.SUPPORTED_MODES
            else next(self._answers)
        )

    def write(self, entry: Any, value: int) -> None:
        self.written.append((entry, value))


def reached(node: Any) -> bool:
    return by_sdo.reached(node, (DriveState.READY,), 0.5)


def test_state_after_a_stall_is_read_anew(stall: Callable[[], None]) -> None:
    assert reached(Node(DISABLED, READY, stall))


def test_drive_that_stays_disabled_is_not_waited_for(stall: Callable[[], None]) -> None:
    assert not reached(Node(DISABLED, DISABLED, stall))


def test_mode_after_a_stall_is_read_anew(stall: Callable[[], None]) -> None:
    drive: Any = Node(Mode.PROFILE_VELOCITY, Mode.CYCLIC_TORQUE, stall)
    by_sdo.set_mode(drive, Mode.CYCLIC_TORQUE)
    assert drive.written == [(objects.MODE, Mode.CYCLIC_TORQUE)]


def test_mode_that_stays_is_refused_after_a_stall(stall: Callable[[], None]) -> None:
    drive: Any = Node(Mode.PROFILE_VELOCITY, Mode.PROFILE_VELOCITY, stall)
    with pytest.raises(ProtocolError, match="shows mode"):
        by_sdo.set_mode(drive, Mode.CYCLIC_TORQUE)


def test_errand_reads_once_more_after_a_stall(stall: Callable[[], None]) -> None:
    errand = until(objects.POSITION, lambda count: count == 0, 0.5, "it is not zero")
    assert isinstance(next(errand), Read)
    stall()
    assert isinstance(errand.send(7), Pause)
    assert isinstance(next(errand), Read)
    assert isinstance(errand.send(7), Pause)
    with pytest.raises(DeviceError, match="is 7 after"):
        next(errand)


def test_frame_of_a_stall_is_heard(connect: Connect, stall: Callable[[], None]) -> None:
    bus, port = connect()
    looks: list[int] = []

    def heard() -> bool:
        looks.append(bus.foreign)
        if len(looks) == 1:  # this computer stands still while nobody looks
            stall()
            port.say(0x123, b"1")
        return bus.foreign > 0

    assert bus.wait(heard, 0.1)


def test_queue_that_empties_in_a_stall_takes_frame(stall: Callable[[], None]) -> None:
    class Emptying(ScriptedBus):
        def send(self, identifier: int, data: bytes) -> None:
            if not self.full:
                self.full = True
                stall()
                raise Full("its queue is full")
            self.sent.append((identifier, data))

    port = Emptying()
    port.press(0x123, b"1")
    assert port.sent == [(0x123, b"1")]
