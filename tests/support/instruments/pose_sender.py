"""A tracker written from the format alone: sends poses as a lab's program does, from a thread."""

from __future__ import annotations

import json
import math
import socket
import threading
import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

from rigd.sdk.check import Observed, Peer, SentReading
from rigd_drivers.trackers.pose_tracker.link import PoseTracker, PoseTrackerConfig

#: Where the body of the conformance tests stands.
POSE = {"x": 0.25, "y": -0.5, "heading": 1.5}


def line(**fields: Any) -> bytes:
    """Return a line of the format with these fields; None removes one."""
    whole = {"format": "poses-1", "units": ["m", "rad"]} | fields
    return json.dumps({key: value for key, value in whole.items() if value is not None}).encode()


def free_port() -> int:
    """Return a UDP port of this machine that no program has at present."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own:
        own.bind(("127.0.0.1", 0))
        return int(own.getsockname()[1])


class Sender:
    """Sends a frame in each ``period_s`` to ``port``, until it is stopped."""

    def __init__(self, port: int, period_s: float = 0.02) -> None:
        self.readings: list[SentReading] = []
        self.fault = ""
        self._to = "127.0.0.1", port
        self._period_s = period_s
        self._ended = threading.Event()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._queue: deque[tuple[float, SentReading, bytes]] = deque()
        self._thread = threading.Thread(target=self._run, name="tracker", daemon=True)
        self._thread.start()

    def show(self, fault: str) -> None:
        self.fault = fault

    def stop(self) -> None:
        self._ended.set()
        self._thread.join(10)
        self._socket.close()

    def _run(self) -> None:
        frame, last = 0, b""
        while not self._ended.wait(self._period_s):
            frame += 1
            now_s, pose = time.monotonic(), {**POSE, "x": frame * 37 % 1000 / 500 - 1.0}
            shown = {**pose, "x": math.nan} if self.fault == "garbled" else pose
            data = line(frame=frame, time=now_s, bodies={"cart": shown, "other": None})
            if self.fault == "frozen":
                data = last
            last = data
            if self.fault == "garbled" and frame % 2:
                data = data[:-20]
            late_s = 1.0 if self.fault == "late" else 0.0
            self._queue.append((now_s + late_s, SentReading(now_s, pose), data))
            while self._queue and self._queue[0][0] <= time.monotonic():
                _, reading, due = self._queue.popleft()
                if self.fault not in ("dead", "silent"):
                    self.readings.append(reading)
                    self._socket.sendto(due, self._to)


@contextmanager
def sending() -> Iterator[Peer]:
    """The peer of the conformance suite."""
    port = free_port()
    sender = Sender(port)
    try:
        yield Peer(
            options={"body": "cart", "silence": "1 s"},
            link=lambda: PoseTracker(PoseTrackerConfig(port=port)),
            faults={
                name: partial(sender.show, name)
                for name in ("dead", "silent", "late", "garbled", "frozen")
            },
            observed=Observed,
            mend=partial(sender.show, ""),
            readings=sender.readings,
        )
    finally:
        sender.stop()
