"""Traffic of devices that are not ours, on simulated CAN buses, by a process of its own.

It knows nothing of rigd: frames are packed here as linux/can.h has them.
"""

from __future__ import annotations

import os
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

CAN_FRAME: Final = struct.Struct("=IB3x8s")
EXTENDED, REMOTE = 0x8000_0000, 0x4000_0000
#: A node that is not in the rig file, and what other masters and nodes send beside ours.
STRANGER: Final = 60
FOREIGN: Final[Sequence[tuple[int, str]]] = (
    (0x3A5, "01 02 03 04 05 06 07 08"),  # TPDO3 of node 37
    (EXTENDED | 0x18FE_F121, "00 ff 00 ff 00 ff 00 ff"),  # J1939
    (REMOTE | 0x700 + STRANGER, ""),  # a master that guards its node
    (0x700 + STRANGER, "85"),  # the answer, with the toggle bit
    (0x700 + STRANGER + 1, "05"),  # a heartbeat
    (0x600 + STRANGER, "40 00 10 00 00 00 00 00"),  # SDO: a request of another client
    (0x580 + STRANGER, "43 00 10 00 92 01 02 00"),  # its answer
    (0x580 + STRANGER, "80 18 10 04 00 00 02 06"),  # an abort
    (0x580 + STRANGER, "01 74 65 73 74 00 00 00"),  # a segment
    (0x080 + STRANGER, "00 10 01 00 00 00 00 00"),  # EMCY
    (0x100, "00 00 00 00 00 00"),  # TIME
    (0x7E4, "5e 00 00 00 00 00 00 00"),  # LSS
    (0x01A, "00 11 22 33"),  # no CANopen
    (EXTENDED | 0x0000_0001, ""),
)  # fmt: skip
#: Between two bursts, in s.
_PAUSE_S: Final = 0.003


def packet(identifier: int, data: str) -> bytes:
    """Return a frame as it goes over the socket."""
    body = bytes.fromhex(data)
    return CAN_FRAME.pack(identifier, len(body), body)


@contextmanager
def foreign_traffic(buses: Sequence[Path], rate_hz: float) -> Iterator[None]:
    """Send ``rate_hz`` foreign frames per second on each of the simulated ``buses`` meanwhile."""
    if not buses or not rate_hz:
        yield
        return
    command = [sys.executable, __file__, str(rate_hz), *map(str, buses)]
    process = subprocess.Popen(command, stdin=subprocess.DEVNULL)
    try:
        yield
    finally:
        process.terminate()
        process.wait()


@contextmanager
def hogs(count: int | None = None) -> Iterator[None]:
    """Keep every processor, or ``count`` of them, busy meanwhile."""
    command = [sys.executable, "-c", "while True: pass"]
    number = os.cpu_count() or 1 if count is None else count
    processes = [subprocess.Popen(command) for _ in range(number)]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()


def _send(rate_hz: float, paths: Sequence[str]) -> None:
    """Send until this process is ended; what the bus brings is thrown away."""
    with suppress(OSError):  # other devices do not wait for programs of this computer
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(60))
    buses = []
    for path in paths:
        bus = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        bus.connect(path)
        bus.setblocking(False)
        buses.append(bus)
    packets = [packet(*frame) for frame in FOREIGN]
    began, sent = time.monotonic(), 0
    while True:
        due = round((time.monotonic() - began) * rate_hz)
        for bus in buses:
            for number in range(sent, due):
                with suppress(BlockingIOError):
                    bus.send(packets[number % len(packets)])
            with suppress(BlockingIOError):
                while bus.recv(CAN_FRAME.size):
                    pass
        sent = due
        time.sleep(_PAUSE_S)


if __name__ == "__main__":
    with suppress(KeyboardInterrupt, ConnectionError):
        _send(float(sys.argv[1]), sys.argv[2:])
