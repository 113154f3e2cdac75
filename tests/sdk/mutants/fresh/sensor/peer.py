"""The sensor as its manual describes it, on a UDP port of this machine, and how it fails."""

from __future__ import annotations

import random
import socket
import struct
import threading
import time
import zlib
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial

from rigd.sdk.check import Peer, SentReading

FAULTS = ("dead", "silent", "late", "garbled", "frozen", "flooding")


class Simulated:
    """An encoder and a load cell; ``fault`` is "" or one that check_driver knows."""

    def __init__(self) -> None:
        self.fault = ""
        self.readings: list[SentReading] = []
        self.port = 0
        self.resolution_um = 1
        self.counts, self.raw = -152_400, -32_768  # at the end of its range
        self.at_rail, self.referenced = True, True
        self.thinks_s = 0.0  # until it answers
        self._last = b""
        self._start()

    def _start(self) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", self.port))
        self._socket.settimeout(0.005)
        self.port = self._socket.getsockname()[1]
        self._ends = threading.Event()
        self._thread = threading.Thread(target=self._serve, name="simulated sensor")
        self._thread.start()

    def stop(self) -> None:
        """Stop serving; the port is closed then."""
        self._ends.set()
        self._thread.join()
        self._socket.close()

    def measure(self, values: Mapping[str, float]) -> None:
        """Measure these from now on, rounded to counts."""
        self.counts = round(values["position"] / (self.resolution_um * 1e-6))
        self.raw = max(-32_768, min(32_767, round(values["force"] / 1.25e-3)))
        self.at_rail, self.referenced = bool(values["force_at_rail"]), bool(values["referenced"])

    def _reading(self) -> SentReading:
        return SentReading(
            time.monotonic(),
            {
                "position": self.counts * self.resolution_um * 1e-6,
                "force": self.raw * 1.25e-3,
                "force_at_rail": self.at_rail,
                "referenced": self.referenced,
            },
        )

    def fail(self, fault: str) -> None:
        """Simulate ``fault`` from now on; "" is none."""
        before, self.fault = self.fault, fault
        if fault == "dead":
            self.stop()
        elif before == "dead":
            self._start()

    def _serve(self) -> None:
        late: deque[tuple[float, SentReading, bytes, tuple[str, int]]] = deque()
        while not self._ends.is_set():
            now_s = time.monotonic()
            while late and late[0][0] <= now_s:
                _, reading, answer, client = late.popleft()
                self.readings.append(reading)
                self._socket.sendto(answer, client)
            try:
                frame, client = self._socket.recvfrom(64)
            except TimeoutError:
                continue
            if len(frame) != 2 or frame[:1] != b"Q" or self.fault == "silent":
                continue
            status = self.at_rail + 2 * self.referenced
            reading = self._reading()
            body = b"P" + struct.pack("<BBih", frame[1], status, self.counts, self.raw)
            answer = body + struct.pack("<I", zlib.crc32(body))
            if self.fault == "frozen":
                answer = self._last or answer
            self._last = answer
            if self.fault == "garbled":
                answer = bytes([answer[0], answer[1] ^ 1, *answer[2:]])
            if self.fault == "late" or self.thinks_s:
                wait_s = 1.0 if self.fault == "late" else self.thinks_s
                late.append((time.monotonic() + wait_s, reading, answer, client))
                continue
            self.readings.append(reading)
            for _ in range(200 if self.fault == "flooding" else 1):
                self._socket.sendto(answer, client)


@contextmanager
def simulated() -> Iterator[Peer]:
    """Yield the sensor and how it fails."""
    device = Simulated()
    options = {"port": device.port, "resolution": "1 um"}

    def vary(rng: random.Random) -> None:
        device.resolution_um = rng.choice((1, 2, 5))
        device.thinks_s = rng.choice((0.0, 0.006))
        options["resolution"] = f"{device.resolution_um} um"

    try:
        yield Peer(
            options=options,
            faults={name: partial(device.fail, name) for name in FAULTS},
            mend=partial(device.fail, ""),
            readings=device.readings,
            measure=device.measure,
            vary=vary,
        )
    finally:
        device.stop()
