"""Provides the clocks of the control cycle: time slots on a fixed grid, in virtual or real time.

The cycle, the interlocks and the player never ask the operating system for the time themselves.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final, Protocol

#: Lateness of a simulated rig that is made up for, in ns of the wall: stalls of a machine are
#: shorter most times.
CATCH_UP_NS: Final = 50_000_000
#: The pace is judged over this time of the wall, in ns, and reported if it is below this share.
JUDGED_NS: Final = 1_000_000_000
SLOWER: Final = 0.8


class Clock(Protocol):
    """Slots of ``period_ns`` counted from 0; times are ns since the start of the run."""

    period_ns: int
    start_ns: int  #: Unix time of slot 0

    def next_slot(self) -> int:
        """Wait until the next slot is due and return its number; missed slots are left out."""
        ...

    def now(self) -> int:
        """Return the time since the start of the run, in ns."""
        ...


class VirtualClock:
    """Counts slots in virtual time and never waits: each slot is due when the cycle asks for it."""

    def __init__(self, period_ns: int, start_ns: int) -> None:
        self.period_ns = period_ns
        self.start_ns = start_ns
        self._slot = -1

    def next_slot(self) -> int:
        """Return the next slot number, at once."""
        self._slot += 1
        return self._slot

    def now(self) -> int:
        """Return the time at which the present slot was due: in virtual time nothing takes time."""
        return max(self._slot, 0) * self.period_ns


class WallClock:
    """Slots of a simulated rig, ``pace`` times as fast as real time, or as fast as it computes.

    No slot is left out: the plant of a simulated rig must compute the time between two slots, and
    a longer time would take longer again. Slots that are late follow at once. Beyond a lateness of
    :data:`CATCH_UP_NS` the clock slips: the time that is lost is not made up for, and the pace is
    lower than asked. ``on_slower`` is called once, with the pace that was reached, if that is well
    below ``pace``.
    """

    def __init__(
        self,
        period_ns: int,
        pace: float = 1.0,
        earliest_ns: int = 0,
        on_slower: Callable[[float], None] = lambda _: None,
    ) -> None:
        """``earliest_ns`` is the earliest Unix time of a slot: the end of the resumed recording."""
        self.period_ns = period_ns
        self.start_ns = max(time.time_ns(), earliest_ns)
        self.on_slower = on_slower
        self._earliest_ns = earliest_ns
        self._pace = pace
        self._origin: int | None = None  #: monotonic time at which slot 0 would have been due
        self._slot = -1
        self._judged_from: tuple[int, int] | None = None  #: monotonic time, slot; None: it is told

    def next_slot(self) -> int:
        """Sleep until the next slot is due, and return its number."""
        now = time.monotonic_ns()
        self._slot += 1
        if self._origin is None:
            self._origin = now
            self.start_ns = max(time.time_ns(), self._earliest_ns)
            self._judged_from = (now, 0)
        due = self._origin + round(self._slot * self.period_ns / self._pace)
        if now < due:
            time.sleep((due - now) * 1e-9)
        elif now - due > CATCH_UP_NS:
            self._origin += now - due
        self._judge(now)
        return self._slot

    def now(self) -> int:
        """Return the time since the start of the run, in ns of run time (real time × pace)."""
        if self._origin is None:
            return 0
        return int((time.monotonic_ns() - self._origin) * self._pace)

    def _judge(self, now: int) -> None:
        """Report the pace of the last second, once, if it is too low."""
        if self._judged_from is None or now - self._judged_from[0] < JUDGED_NS:
            return
        since, slot = self._judged_from
        reached = (self._slot - slot) * self.period_ns / (now - since)
        self._judged_from = (now, self._slot)
        if reached < SLOWER * self._pace:
            self._judged_from = None
            self.on_slower(reached)


class RealClock:
    """Slots on absolute deadlines of the monotonic clock, shared with other processes.

    ``start_ns`` is the Unix time at ``origin_ns`` of CLOCK_MONOTONIC, when slot 0 is due. The
    first slot is the next one due; a slot that has already passed is skipped (no bursts).
    """

    def __init__(self, period_ns: int, start_ns: int, origin_ns: int) -> None:
        self.period_ns = period_ns
        self.start_ns = start_ns
        self._origin_ns = origin_ns
        self._slot: int | None = None

    def next_slot(self) -> int:
        """Sleep until the next slot that is not past, and return its number."""
        elapsed = time.monotonic_ns() - self._origin_ns
        slot = elapsed // self.period_ns if self._slot is None else self._slot
        slot += 1
        due = slot * self.period_ns
        if elapsed >= due + self.period_ns:
            slot = elapsed // self.period_ns
        elif elapsed < due:
            time.sleep((due - elapsed) * 1e-9)  # clock_nanosleep to an absolute time, PEP 475
        self._slot = slot
        return slot

    def now(self) -> int:
        """Return the time since slot 0, in ns."""
        return time.monotonic_ns() - self._origin_ns


def monotonic_ns() -> int:
    """Return the monotonic clock of the machine, for intervals of waiting for people."""
    return time.monotonic_ns()


def idle(seconds: float) -> None:
    """Let the processor rest while a person is expected to answer."""
    time.sleep(seconds)
