"""What an EDS costs a CAN drive: nothing in the cycle, some milliseconds when it is opened.

Two drives of the same kind on buses in memory, one of them with an EDS: enabled, then cycled as a
run does it (take in, read, write, send), in CPU time of this thread, interleaved, medians of
rounds. Their opening is timed apart: there each object is looked up before it is written.

    python benchmarks/can_cycle.py
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from unittest.mock import patch

from figures import at_most, noted

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
from support.can.bench import wheel
from support.can.eds import SHIPPED
from support.can.script import ScriptedBus, number, servo

from rigd_drivers.can.bus import CanBus, CanBusConfig
from rigd_drivers.can.canopen.sheet import read_sheet
from rigd_drivers.can.cia402_servo.current import CurrentServo

ROUNDS, CYCLES, OPENINGS = 60, 400, 16
EDS = SHIPPED / "rigd_servo.eds"
STATES = (0x0250, 0x0231, 0x0233, 0x1237)
#: The node's, which the drive must hear while it is cycled.
HEARTBEAT = (0x701, b"\5")


def opened(eds: str | None) -> tuple[CurrentServo, ScriptedBus]:
    """Return a drive, opened, and the port that leads to its node."""
    drive = servo()
    drive.objects[0x1018, 1] = number(0x52494744, 4)  # the vendor in the EDS
    port = ScriptedBus(drive)
    with patch("rigd_drivers.can.bus.open_port", lambda *_: port):
        bus = CanBus(CanBusConfig(interface="scripted"))
        bus.open_second()
    driver = wheel(bus, eds=eds, rated_current="1.5 A")
    driver.open()
    return driver, port


def cycling(eds: str | None) -> Callable[[], None]:
    """Return one cycle of a drive that is enabled."""
    driver, port = opened(eds)
    frames = [number(status, 2) + number(667, 2) + number(1024, 4) for status in STATES]

    def once(frame: bytes = frames[-1]) -> None:
        port.say(*HEARTBEAT)
        port.say(0x181, frame)
        driver.link.begin(0)
        driver.read(0)
        driver.write((1.0,))
        driver.link.end(0)
        port.sent.clear()

    once(frames[0])
    driver.arm()
    for frame in frames:
        once(frame)
    assert driver.ready()
    return once


def microseconds(once: Callable[[], object], times: int) -> float:
    """Return the CPU time of one call."""
    begun = time.thread_time_ns()
    for _ in range(times):
        once()
    return (time.thread_time_ns() - begun) / times / 1e3


def compared(pair: Sequence[Callable[[], object]], rounds: int, times: int) -> tuple[float, ...]:
    """Return the medians of both in us, and that of their ratio, round by round."""
    found = []
    for _ in range(rounds // 2):  # each first in half of the rounds
        found.append([microseconds(once, times) for once in pair])
        found.append([microseconds(once, times) for once in reversed(pair)][::-1])
    before, after = (statistics.median(each) for each in zip(*found, strict=True))
    return before, after, statistics.median(new / old for old, new in found)


def main() -> None:
    """Compare cycles and openings with and without an EDS."""
    without, with_eds, ratio = compared((cycling(None), cycling(str(EDS))), ROUNDS, CYCLES)
    noted("cycle of a CAN drive without EDS", without, "us")
    noted("cycle of a CAN drive with EDS", with_eds, "us")
    at_most("cycle of a CAN drive, with / without EDS", ratio, 1.03)
    pair = (lambda: opened(None), lambda: opened(str(EDS)))
    without, with_eds, _ = compared(pair, OPENINGS, 1)
    noted("opening a CAN drive without EDS", without / 1e3, "ms")
    noted("opening a CAN drive with EDS, read before", with_eds / 1e3, "ms")
    read_sheet.__globals__["_read"].cache_clear()
    begun = time.thread_time_ns()
    read_sheet(EDS)
    noted("reading an EDS of 152 values", (time.thread_time_ns() - begun) / 1e6, "ms")


if __name__ == "__main__":
    main()
