"""The sensor as its manual describes it, on a UDP port of this machine, and how it fails."""

from __future__ import annotations

import socket
import struct
import threading
import time
import zlib
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial

from rigd.sdk.check import FAULTS, Observed, Peer

COUNTS = -152_400
RAW = -32_768  # at the end of its range


class Simulated:
    """An encoder and a load cell; ``fault`` is "" or one that check_driver knows."""

    def __init__(self) -> None:
        self.fault = ""
        self.sent = 0
        self.port = 0
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

    def fail(self, fault: str) -> None:
        """Simulate ``fault`` from now on; "" is none."""
        before, self.fault = self.fault, fault
        if fault == "dead":
            self.stop()
        elif before == "dead":
            self._start()

    def _serve(self) -> None:
        late: deque[tuple[float, bytes, tuple[str, int]]] = deque()
        while not self._ends.is_set():
            now_s = time.monotonic()
            while late and late[0][0] <= now_s:
                _, answer, client = late.popleft()
                self._socket.sendto(answer, client)
            try:
                frame, client = self._socket.recvfrom(64)
            except TimeoutError:
                continue
            if len(frame) != 2 or frame[:1] != b"Q" or self.fault == "silent":
                continue
            body = b"P" + struct.pack("<BBih", frame[1], 3, COUNTS, RAW)
            answer = body + struct.pack("<I", zlib.crc32(body))
            if self.fault == "frozen":
                answer = self._last or answer
            self._last = answer
            self.sent += 1
            if self.fault == "garbled":
                answer = bytes([answer[0], answer[1] ^ 1, *answer[2:]])
            if self.fault == "late":
                late.append((now_s + 1.0, answer, client))
            else:
                self._socket.sendto(answer, client)


def observed(device: Simulated) -> Observed:
    """Return what an observer at the bench sees."""
    return Observed(
        measured={"position": COUNTS * 1e-6, "force": RAW * 1.25e-3, "status": 3},
        sent=device.sent,
    )


@contextmanager
def simulated() -> Iterator[Peer]:
    """Yield the sensor and how it fails."""
    device = Simulated()
    try:
        yield Peer(
            options={"port": device.port, "resolution": "1 um"},
            faults={name: partial(device.fail, name) for name in FAULTS},
            mend=partial(device.fail, ""),
            observed=partial(observed, device),
        )
    finally:
        device.stop()
