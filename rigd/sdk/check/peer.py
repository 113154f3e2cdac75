"""Defines the simulated device (peer) that a driver is checked against, and its faults."""

from __future__ import annotations

import asyncio
import random
import threading
from collections.abc import Callable, Collection, Coroutine, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple, Protocol, TypeVar

T = TypeVar("T")

#: Faults that the suite asks a peer for, by name.
FAULTS: Final[Mapping[str, str]] = {
    "dead": "the connection is gone, as by a pulled plug",
    "silent": "it is connected and sends nothing",
    "late": "it answers, but a second or so too late",
    "garbled": "all that it sends is damaged",
    "frozen": "it sends the same frame again and again; for a protocol that counts its frames",
    "lossy": "a part of what it sends is lost, once; for a device that sends blocks",
    "stuck": "it answers, and its actuator stays energised, like a relay that is welded",
    "refusing": "it answers, and refuses what it is told, with the error of its manual",
    "locked": "it answers, and does not enable its actuator: its enable input is open",
    "unguarded": "its watchdog never acts",
    "cut": "its connection ends within an answer, once; it takes another",
    "flooding": "it answers with hundreds of frames, or bytes, for one",
    "another": "another device is at its address, and answers as it does",
}


class SentReading(NamedTuple):
    """A reading that a device has sent, as its frame has it."""

    #: When it was measured, on CLOCK_MONOTONIC in s.
    taken_s: float
    #: By channel in its unit, rounded as the device rounds them; status bits by their names, 0 or
    #: 1, or the whole word as "status".
    values: Mapping[str, float]


@dataclass(frozen=True)
class Observed:
    """What an observer at the bench sees of a simulated device now; it never goes over the link.

    The suite compares with it what the driver sets and reports. What a device does not have stays
    as it is here.
    """

    #: What the actuator of each setpoint is driven with, in the order and the units of the
    #: declaration; while it is safe, what safe means (0 for a drive that is switched off).
    driven: Sequence[float] = ()
    #: Whether an actuator is in another state than the safe one.
    energised: bool = False
    #: The time that is set at its watchdog, in s; None: it has none.
    watchdog_s: float | None = None
    #: How often its watchdog has acted since it was started; None: it does not count.
    trips: int | None = None
    #: The actions that it has done, in their order; None: it does not count them.
    acted: Sequence[str] | None = None
    #: What each would be driven with if it were switched on at the device itself, as at its front
    #: panel; () if it cannot be.
    ordered: Sequence[float] = ()
    #: What tells this device from others of its make: its serial number.
    identity: str = ""
    #: The smallest step of what each actuator is driven with, as the manual of the device has it; 0
    #: if it takes a number in single precision; (): not known, and 0.4 % of a range are near.
    resolution: Sequence[float] = ()


@dataclass(frozen=True)
class Peer:
    """A running simulated device: its address, the ways to make it fail, and what it does.

    The author of a driver gives the suite a function, used as a context manager, that starts a
    fresh one::

        @contextmanager
        def simulated_acme() -> Iterator[Peer]:
            device = FakeAcme()
            try:
                yield Peer(
                    options={"port": device.port},
                    faults={"dead": device.unplug},
                    observed=lambda: Observed(driven=(device.speed,), energised=device.enabled),
                )
            finally:
                device.close()
    """

    #: Options that give the driver its address, beside those given to the suite.
    options: Mapping[str, Any] = field(default_factory=dict)
    #: Makes the link of the driver, not opened yet; a plant for a device in process.
    link: Callable[[], Any] = lambda: None
    #: Functions that begin each of :data:`FAULTS`, without those that it cannot show.
    faults: Mapping[str, Callable[[], object]] = field(default_factory=dict)
    #: All that the device has sent, in turn, each added before it is sent; None: not kept.
    readings: Sequence[SentReading] | None = None
    #: Draws, before a driver opens it, in what this device differs from others of its make: serial
    #: number, rate, time of its watchdog, size of frames, texts of errors. It may alter `options`.
    #: Such devices must be able to stand beside each other: a driver is also tried beside another.
    vary: Callable[[random.Random], object] | None = None
    #: Has the device measure other values, by channel in its unit, and status bits by name, as far
    #: as it can; None if it cannot.
    measure: Callable[[Mapping[str, float]], object] | None = None
    #: Ends the fault that was begun, but not those that last; None if it cannot.
    mend: Callable[[], object] | None = None
    lasts: Collection[str] = ()
    #: Returns what the device does now, from any thread, whatever its fault is.
    observed: Callable[[], Observed] | None = None

    def mended(self, fault: str) -> bool:
        """End ``fault``, and return whether it has ended."""
        if self.mend is None or fault in self.lasts:
            return False
        self.mend()
        return True

    def look(self) -> Observed:
        """Return what the device does now; nothing, if that is not shown."""
        return Observed() if self.observed is None else self.observed()


class RunOnLoop(Protocol):
    """Runs a coroutine on a loop in another thread and returns its result."""

    def __call__(self, coroutine: Coroutine[Any, Any, T], /) -> T:
        """Wait for ``coroutine``."""


@contextmanager
def background_loop() -> Iterator[RunOnLoop]:
    """Run an event loop in a thread, for peers that are servers on asyncio.

    ::

        with background_loop() as run:
            run(server.start())
    """
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever, name="peer", daemon=True)
    thread.start()

    def run(coroutine: Coroutine[Any, Any, T], /) -> T:
        return asyncio.run_coroutine_threadsafe(coroutine, loop).result(timeout=30)

    try:
        yield run
    finally:
        loop.call_soon_threadsafe(loop.stop)
        thread.join(timeout=30)
        loop.close()
