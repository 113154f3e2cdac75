"""Switches the relay in a thread of its own, so that the cycle never waits for the NI card.

The thread also sends the pulses that keep the one-shot (a retriggerable monostable) of the relay
up. It stops them when the cycle has made no call for ``CYCLE_SILENCE_S``.
"""

from __future__ import annotations

import os
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from typing import Final

from rigd_drivers.cards.ni_relay.lines import RelayLines

#: The one-shot gets no more pulses once no request of the cycle came for so long, in s.
CYCLE_SILENCE_S: Final = 0.1
#: While the one-shot is to drop it is looked at this often, in s.
_DROPPING_S: Final = 0.005
#: A thread that ends waits for one call to the card at most.
_JOIN_S: Final = 1.0


@dataclass(frozen=True)
class Known:
    """What the card has confirmed; times are CLOCK_MONOTONIC."""

    closed: bool
    at_ns: int  #: when it did
    latency_s: float  #: of the last change, from the wish to the confirmation
    wish: int  #: number of the wish that this answers


@dataclass(frozen=True)
class Failed:
    """The last command or read of the card, which failed."""

    wish: int  #: number of the wish that it was about
    why: Exception


@dataclass(frozen=True)
class Seen:
    """The level that the one-shot's line had."""

    up: bool
    looked_ns: int  #: not later than it showed that
    edge_ns: int  #: of the last edge: not earlier than it
    seen_ns: int  #: not earlier than it showed that
    down_ns: int  #: when it was seen down last; 0: never


class Keeper:
    """Sets the lines as the cycle requests, and retriggers the one-shot while the cycle calls.

    Every method but :meth:`start` and :meth:`end` returns at once. What the thread learns is
    handed over whole, in one assignment, so that no thread holds a lock.

    Args:
        lines: open, and the thread's alone from :meth:`start` to :meth:`end`.
        period_s: the card gets a request at least this often.
    """

    def __init__(self, lines: RelayLines, period_s: float) -> None:
        self._lines = lines
        self._period_s = period_s
        self._bell: SimpleQueue[None] = SimpleQueue()
        self._wish = (0, False, 0)  # number, closed, when
        self._called_ns = 0
        self._caller = 0
        self._trigger = False
        self._feeding = False
        self._edge_ns = 0
        self._down_ns = 0
        self._ending = False
        self.known = Known(False, 0, 0.0, 0)
        self.seen: Seen | None = None
        self.failed: Failed | None = None  #: None once a talk has succeeded
        self._thread = threading.Thread(target=self._run, name="ni-relay", daemon=True)

    def start(self) -> None:
        """Begin to talk to the card."""
        self._thread.start()

    def want(self, *, closed: bool, at_once: bool = False) -> int:
        """Request the relay closed or open from now on; return the number of the request.

        ``at_once`` sends it to the card now, even if the request is the same.
        """
        number, before, _ = self._wish
        if at_once or closed != before:
            number += 1
            self._wish = (number, closed, time.monotonic_ns())
            self._bell.put(None)
        return number

    @property
    def wish(self) -> int:
        """Number of the newest wish."""
        return self._wish[0]

    def feed(self) -> None:
        """Keep the one-shot up for a while: the cycle is alive."""
        self._called_ns = time.monotonic_ns()
        self._caller = threading.get_native_id()

    def starve(self) -> None:
        """Let the one-shot drop."""
        self._called_ns = 0

    def end(self) -> None:
        """End the thread, as soon as the card has answered; the lines keep their levels."""
        self._ending = True
        self._bell.put(None)
        if self._thread.ident is not None:
            self._thread.join(_JOIN_S)

    def _run(self) -> None:
        rung = True
        while not self._ending:
            number, closed, wished_ns = self._wish
            try:
                self._put(number, wished_ns, closed=closed)
                if not rung:  # a caller in the cycle has no time for it
                    self._look()
                self.failed = None
            except Exception as error:  # noqa: BLE001 - boundary: the next read() raises it
                self.failed = Failed(number, error)
            rung = self._rung()

    def _rung(self) -> bool:
        """Wait for the bell, a period at most; return whether it rang."""
        dropping = not self._feeding and self.seen is not None and self.seen.up
        try:
            self._bell.get(timeout=_DROPPING_S if dropping else self._period_s)
        except Empty:
            return False
        with suppress(Empty):
            while True:  # the newest wish answers for all before it
                self._bell.get_nowait()
        return True

    def _put(self, number: int, wished_ns: int, *, closed: bool) -> None:
        silent_ns = time.monotonic_ns() - self._called_ns
        feeding = silent_ns < CYCLE_SILENCE_S * 1e9
        if feeding:
            self._keep_pace()
            if not self._feeding:
                self._look()  # it may have dropped meanwhile, which the pulse would hide
            self._trigger = not self._trigger
        self._feeding = feeding
        self._lines.put(closed=closed, trigger=self._trigger)
        now_ns = time.monotonic_ns()
        if feeding:
            self._edge_ns = now_ns
        before = self.known
        latency_s = before.latency_s if number == before.wish else (now_ns - wished_ns) * 1e-9
        self.known = Known(closed, now_ns, latency_s, number)

    def _look(self) -> None:
        looked_ns = time.monotonic_ns()
        up = self._lines.one_shot_up()
        if not up:
            self._down_ns = looked_ns
        self.seen = Seen(up, looked_ns, self._edge_ns, time.monotonic_ns(), self._down_ns)

    def _keep_pace(self) -> None:
        """Run as urgently as the cycle that feeds us.

        Threads of one interpreter wait for each other: were this one kept from the processor by
        others while it holds the interpreter, the cycle would be too. On two busy processors 20 000
        cycles at 1 kHz missed 0 to 13 slots with it, 37 to 98 without.
        """
        caller = self._caller
        with suppress(OSError):  # the caller has ended, or the kernel does not grant it
            policy, urgency = os.sched_getscheduler(caller), os.sched_getparam(caller)
            if policy != os.sched_getscheduler(0) or urgency != os.sched_getparam(0):
                os.sched_setscheduler(0, policy, urgency)
