"""Simulates a counter of an NI card that times pulses into a buffer; no gRPC.

If NI's documents leave a behaviour open, it takes the worst case for the driver: the first period
runs from the start of the task and not from an edge, and one that is longer than the counter of 32
bits at 100 MHz (43 s) has wrapped.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from rigd_sim.wire.cards.ni_card import DaqFault

_TICK_S: Final = 1e-8
_WRAP: Final = 2**32


@dataclass(frozen=True)
class PulseSource:
    """What is wired to the counter: pulses made so far, and the part of a period at high level."""

    made: Callable[[], int]
    duty: Callable[[], float]


class PulseTimer:
    """The periods of the pulses at one counter, from its start.

    The pulses that came between two calls of :meth:`advance` are spread evenly over that time.

    Args:
        source: the pulses.
        buffer: so many periods are kept until they are read.
        clock_ns: CLOCK_MONOTONIC.
    """

    def __init__(self, source: PulseSource, buffer: int, clock_ns: Callable[[], int]) -> None:
        self._source = source
        self._buffer = buffer
        self._clock_ns = clock_ns
        self._made = source.made()
        self._looked_ns: float = clock_ns()
        self._edge_ns: float = self._looked_ns
        self._periods: deque[tuple[float, float]] = deque()
        self._overrun = False

    @property
    def waiting(self) -> int:
        """How many periods can be read."""
        return len(self._periods)

    def advance(self) -> None:
        """Time what has come until now."""
        now_ns, made = self._clock_ns(), self._source.made()
        count, duty = abs(made - self._made), self._source.duty()
        for pulse in range(1, count + 1):
            edge_ns = self._looked_ns + (now_ns - self._looked_ns) * pulse / count
            ticks = round((edge_ns - self._edge_ns) * 1e-9 / _TICK_S) % _WRAP
            self._edge_ns = edge_ns
            if len(self._periods) >= self._buffer:
                self._overrun = True
                break
            self._periods.append((ticks * _TICK_S * duty, ticks * _TICK_S * (1.0 - duty)))
        self._made, self._looked_ns = made, now_ns

    def take(self, count: int) -> list[tuple[float, float]]:
        """Return high and low time of the next ``count`` periods, in s.

        Raises:
            DaqFault: there are fewer, or some are lost.
        """
        if self._overrun:
            raise DaqFault(-200279, "The application is not able to keep up with the hardware.")
        if count > len(self._periods):
            raise DaqFault(-200284, "Some or all of the samples have not yet been acquired.")
        return [self._periods.popleft() for _ in range(count)]
