"""Injects faults into a simulated CAN bus: lost, late or repeated frames, bus-off and others.

The faults act on the frames of the bus and do not depend on what its nodes do.
"""

from __future__ import annotations

import asyncio
import random
import struct
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final

from rigd_sim.wire.can.timing import Frame
from rigd_sim.wire.options import number, take, whole

#: ``struct can_frame``: identifier with flags, length, three bytes of padding, data.
CAN_FRAME: Final = struct.Struct("<IB3x8s")
#: Error frames of the kernel (linux/can/error.h): the flag, and classes in the identifier.
ERROR_FLAG: Final = 0x20000000
ERROR_PROTOCOL: Final = ERROR_FLAG | 0x00000008
ERROR_CONTROLLER: Final = ERROR_FLAG | 0x00000004
RECEIVE_OVERFLOW: Final = 0x01  #: data[1] of it
ERROR_BUS_OFF: Final = ERROR_FLAG | 0x00000040
ERROR_RESTARTED: Final = ERROR_FLAG | 0x00000100
#: Data of an error frame is always 8 bytes.
NO_DETAIL: Final = bytes(8)
#: Error frames that a controller reports before it goes bus-off, in a row.
LAST_WORDS: Final = 4

FAULTS: Final[Mapping[str, str]] = {
    "drop": "frames get lost (probability 0 to 1; id: only this COB-id)",
    "delay": "frames come late by so many seconds (delay_s; jitter_s beside it; id)",
    "jitter": "frames come late by up to so many seconds, in order (jitter_s; id)",
    "reorder": "a frame is overtaken by the next one (probability 0 to 1; id)",
    "duplicate": "frames come twice (probability 0 to 1; id)",
    "babble": "a node sends without a pause (id, rate_hz, length)",
    "bus_off": "error frames, then silence, until cleared",
    "wrong_bitrate": "clients and nodes do not understand each other: frames give error frames",
    "stalled": "no frame of a client is taken, so that its queue fills up",
}


def overflow(count: int) -> bytes:
    """Return the packet of an error frame: the receiver lost ``count`` frames (bytes 4 to 7)."""
    detail = bytes((0, RECEIVE_OVERFLOW, 0, 0)) + count.to_bytes(4, "little")
    return CAN_FRAME.pack(ERROR_CONTROLLER, len(detail), detail)


class Disturbance:
    """The faults that a bus has now: every frame passes through :meth:`submit`.

    ``forward`` takes a frame on to the bus, ``report`` an error frame to the clients.
    """

    def __init__(
        self, forward: Callable[[Frame], None], report: Callable[[int], None], seed: int
    ) -> None:
        self._forward = forward
        self._report = report
        self._random = random.Random(seed)
        self._active: dict[str, dict[str, Any]] = {}
        self._timers: set[asyncio.TimerHandle] = set()
        self._held: Frame | None = None
        self._late: deque[tuple[float, Frame]] = deque()

    @property
    def active(self) -> bool:
        """Whether frames must come by here at all."""
        return bool(self._active)

    @property
    def names(self) -> Iterable[str]:
        """The faults that are shown now."""
        return self._active

    def inject(self, fault: str, options: Mapping[str, Any]) -> None:
        """Show ``fault`` from now on.

        Raises:
            ValueError: an option is missing, unknown, or out of range.

        """
        given = dict(options)
        kept: dict[str, Any] = {}
        if fault in ("drop", "duplicate", "reorder"):
            kept["probability"] = number(given, "probability", 1.0, low=0.0, high=1.0)
        if fault == "delay":
            kept["delay_s"] = number(given, "delay_s", None, low=0.0, high=10.0)
        if fault in ("delay", "jitter"):
            needed = None if fault == "jitter" else 0.0
            kept["jitter_s"] = number(given, "jitter_s", needed, low=0.0, high=10.0)
        if fault == "babble":
            kept["id"] = whole(given, "id", 0x001, low=0, high=0x7FF)
            kept["rate_hz"] = number(given, "rate_hz", 4000.0, low=1.0, high=20000.0)
            kept["length"] = whole(given, "length", 8, low=0, high=8)
        elif fault in ("drop", "delay", "jitter", "reorder", "duplicate"):
            kept["id"] = take(given, "id", None, int)
        if given:
            raise ValueError(f"fault {fault!r} takes no option {', '.join(sorted(given))}")
        self.clear(fault)
        self._active[fault] = kept
        if fault == "bus_off":
            for _ in range(LAST_WORDS):
                self._report(ERROR_PROTOCOL)
            self._report(ERROR_BUS_OFF)
        elif fault == "babble":
            self._babble(kept, asyncio.get_running_loop().time())

    def clear(self, fault: str | None = None) -> None:
        """Stop showing ``fault``, or all of them."""
        names = list(self._active) if fault is None else [fault] if fault in self._active else []
        for name in names:
            del self._active[name]
            if name == "bus_off":
                self._report(ERROR_RESTARTED)
            if name == "reorder":
                self._release()

    def stop(self) -> None:
        """Forget frames that are on their way, without a word."""
        self._active.clear()
        self._held = None
        self._late.clear()
        for timer in self._timers:
            timer.cancel()
        self._timers.clear()

    def submit(self, frame: Frame) -> None:
        """Take a frame to the bus, as far as the faults let it."""
        active = self._active
        if "bus_off" in active:
            return
        if "wrong_bitrate" in active:
            self._report(ERROR_PROTOCOL)
            return
        if self._strikes("drop", frame):
            return
        copies = 2 if self._strikes("duplicate", frame) else 1
        for _ in range(copies):
            self._delayed(frame)

    def _strikes(self, fault: str, frame: Frame) -> bool:
        options = self._active.get(fault)
        return (
            options is not None
            and options["id"] in (None, frame[1])
            and self._random.random() < options["probability"]
        )

    def _delayed(self, frame: Frame) -> None:
        delay = 0.0
        for fault in ("delay", "jitter"):
            options = self._active.get(fault)
            if options is not None and options["id"] in (None, frame[1]):
                delay += options.get("delay_s", 0.0)
                delay += options["jitter_s"] * self._random.random()
        if delay == 0.0:
            self._ordered(frame)
            return
        now = asyncio.get_running_loop().time()
        # Never before the one ahead of it: a bus does not overtake by itself.
        due = max(now + delay, self._late[-1][0] if self._late else 0.0)
        self._late.append((due, frame))
        if len(self._late) == 1:
            self._later(due, self._arrive)

    def _arrive(self) -> None:
        """Let through what is due of the frames that are late."""
        now = asyncio.get_running_loop().time()
        while self._late and self._late[0][0] <= now:
            self._ordered(self._late[0][1])  # in its place until then: answers come behind it
            self._late.popleft()
        if self._late:
            self._later(self._late[0][0], self._arrive)

    def _ordered(self, frame: Frame) -> None:
        if self._held is None and self._strikes("reorder", frame):
            self._held = frame
            return
        self._forward(frame)
        self._release()

    def _release(self) -> None:
        held, self._held = self._held, None
        if held is not None:
            self._forward(held)

    def _babble(self, options: Mapping[str, Any], due: float) -> None:
        if self._active.get("babble") is not options:
            return
        now, period = asyncio.get_running_loop().time(), 1.0 / options["rate_hz"]
        while due <= now:
            self.submit((self, options["id"], bytes(options["length"])))
            due += period
        self._later(due, lambda: self._babble(options, due))

    def _later(self, when: float, action: Callable[[], None]) -> None:
        def act() -> None:
            self._timers.discard(timer)
            action()

        timer = asyncio.get_running_loop().call_at(when, act)
        self._timers.add(timer)
