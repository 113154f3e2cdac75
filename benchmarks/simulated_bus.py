"""What the simulated CAN devices cost: three servos and two encoders on two buses at 1 kHz.

A bare master, sockets and nothing else, walks the servos up and then sends setpoints and SYNC in
every cycle. Printed: CPU of the process that serves, in cores, and from SYNC to the last answer.

    python benchmarks/simulated_bus.py --seconds 10
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import select
import socket
import statistics
import struct
import tempfile
import time
from multiprocessing.synchronize import Event
from pathlib import Path

from figures import at_most, noted

from rigd_sim.lugre.wire import WireLugre, WireLugreConfig

CAN_FRAME = struct.Struct("<IB3x8s")
PERIOD_S = 1e-3
SERVOS, ENCODERS = (1, 2, 3), (11, 12)
#: Objects by the size of what is mapped: statusword, torque, position; velocity.
FEEDBACK, VELOCITY, POSITION = (0x60410010, 0x60770010, 0x60640020), (0x606C0020,), (0x60040020,)
TORQUE, SPEED = (0x60400010, 0x60710010), (0x60400010, 0x60FF0020)
#: Longer than any stall of a shared machine: a drive that trips answers no more.
WATCHDOG_MS, ANSWER_S = 5000, 10.0
#: TPDOs that answer one SYNC: one of each node, and the velocities of both belts.
ANSWERS = {"servo_bus": 5, "encoder_bus": 2}


def serve(folder: str, ready: Event, end: Event) -> None:
    """Serve the CAN devices alone."""
    config = WireLugreConfig.model_validate(
        {"folder": folder, "accelerometer": None, "scale": None}
    )
    WireLugre(config).serve(lambda _: ready.set(), end.is_set)


class Master:
    """A program on one bus."""

    def __init__(self, path: Path) -> None:
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.socket.connect(str(path))
        self.socket.settimeout(ANSWER_S)

    def send(self, can_id: int, data: bytes) -> None:
        """Send a frame."""
        self.socket.send(CAN_FRAME.pack(can_id, len(data), data))

    def receive(self) -> tuple[int, bytes]:
        """Wait for a frame; return its identifier and data."""
        can_id, length, data = CAN_FRAME.unpack(self.socket.recv(CAN_FRAME.size))
        return can_id, data[:length]

    def write(self, node: int, index: int, sub: int, value: int, size: int) -> None:
        """Write ``size`` bytes by SDO."""
        head = bytes([0x23 | 4 - size << 2]) + index.to_bytes(2, "little") + bytes([sub])
        self.send(0x600 + node, head + value.to_bytes(4, "little"))
        while (answer := self.receive())[0] != 0x580 + node:
            pass
        if answer[1][0] != 0x60:
            raise RuntimeError(f"node {node} refused {index:04X}:{sub}: {answer[1].hex(' ')}")

    def map(self, node: int, base: int, cob_id: int, objects: tuple[int, ...]) -> None:
        """Map a PDO: disable, set, enable; at every SYNC."""
        self.write(node, base, 1, cob_id | 1 << 31, 4)
        self.write(node, base + 0x200, 0, 0, 1)
        for place, item in enumerate(objects, start=1):
            self.write(node, base + 0x200, place, item, 4)
        self.write(node, base + 0x200, 0, len(objects), 1)
        self.write(node, base, 2, 1, 1)
        if base >= 0x1800:
            self.write(node, base, 3, 0, 2)
        self.write(node, base, 1, cob_id, 4)


def set_up(servos: Master, encoders: Master) -> None:
    """Map the PDOs of every node and start them."""
    for node in SERVOS:
        servos.map(node, 0x1800, 0x180 + node, FEEDBACK)
        servos.map(node, 0x1400, 0x200 + node, TORQUE if node == 1 else SPEED)
        servos.write(node, 0x6060, 0, 10 if node == 1 else 9, 1)
        servos.write(node, 0x1016, 1, 127 << 16 | WATCHDOG_MS, 4)
        if node != 1:
            servos.map(node, 0x1801, 0x280 + node, VELOCITY)
    for node in ENCODERS:
        encoders.map(node, 0x1800, 0x180 + node, POSITION)
    for bus in (servos, encoders):
        bus.send(0x000, b"\1\0")


def cycle(servos: Master, encoders: Master, number: int) -> float:
    """Play one cycle; return the time in s from the first SYNC to the last answer."""
    control = (6, 7, 15)[min(number // 20, 2)]
    for node in SERVOS:
        layout = "<Hh" if node == 1 else "<Hi"
        servos.send(0x200 + node, struct.pack(layout, control, 100 if node == 1 else 0))
    begun = time.monotonic()
    servos.send(0x080, b"")
    encoders.send(0x080, b"")
    if number % 20 == 0:
        servos.send(0x77F, b"\5")
    for bus, name in ((servos, "servo_bus"), (encoders, "encoder_bus")):
        left = ANSWERS[name]
        while left:
            left -= 0x180 < bus.receive()[0] < 0x400
    return time.monotonic() - begun


def cpu_s(pid: int) -> float:
    """Return the CPU time that a process has taken, in s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def main() -> None:
    """Serve, cycle, report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=10.0)
    cycles = round(parser.parse_args().seconds / PERIOD_S)
    context = multiprocessing.get_context("spawn")
    ready, end = context.Event(), context.Event()
    with tempfile.TemporaryDirectory(prefix="rigd-", dir="/tmp") as folder:
        process = context.Process(target=serve, args=(folder, ready, end))
        process.start()
        try:
            if not ready.wait(60):
                raise RuntimeError("the simulation did not start within 60 s")
            servos, encoders = (Master(Path(folder) / name) for name in ANSWERS)
            set_up(servos, encoders)
            used, start = cpu_s(process.pid or 0), time.monotonic()
            times = []
            for number in range(cycles):
                wait = start + number * PERIOD_S - time.monotonic()
                if wait > 0:
                    select.select((), (), (), wait)
                times.append(cycle(servos, encoders, number))
            elapsed = time.monotonic() - start
            used = cpu_s(process.pid or 0) - used
        finally:
            end.set()
            process.join(30)
    centiles = statistics.quantiles(times, n=1000)
    noted("cycles per second", cycles / elapsed, "Hz")
    at_most("CPU of the simulated devices", used / elapsed, 0.4, "cores")
    noted("CPU of the simulated devices per cycle", used / cycles * 1e6, "us")
    noted("SYNC to the last answer, p50", centiles[499] * 1e6, "us")
    noted("SYNC to the last answer, p99", centiles[989] * 1e6, "us")
    noted("SYNC to the last answer, p99.9", centiles[998] * 1e6, "us")


if __name__ == "__main__":
    main()
