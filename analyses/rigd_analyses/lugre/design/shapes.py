"""Lists the tests that a design chooses from: shapes of the motor current over a trial."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum

import numpy as np

from rigd.analysis.result import FloatArray

#: Of the largest current: where constant currents, first currents and amplitudes stand.
HOLDS = (0.17, 0.2, 0.23, 0.27, 0.33, 0.4, 0.5, 0.6, 0.8, 1.0)
FIRSTS = (0.4, 0.6, 0.8, 1.0)
SECONDS = (-0.8, -0.6, -0.4, -0.2)
SWINGS = (0.4, 0.6, 0.8, 1.0)
FREQUENCIES_HZ = (0.8, 1.2, 2.0, 3.0)
RAMPS = ((0.2, 0.6), (0.3, 1.0))
STOPS = (0.5, 1.0)  #: of the travel to where the base procedure brakes
CHANGES = (0.15, 0.4)
SECOND_S = 1.0
SWING_S = (1.5, 3.0)
RAMP_S = (1.5, 3.0)
LONGEST_S = 4.0


class Kind(Enum):
    """The shape of the current over a trial."""

    HOLD = "hold"
    CHANGE = "change"
    RAMP = "ramp"
    SWING = "swing"


@dataclass(frozen=True, eq=False)
class Phase:
    """Current in A over the time in s since the phase began, until a position or a time."""

    current: Callable[[FloatArray], FloatArray]
    until_m: float
    lasting_s: float


@dataclass(frozen=True, order=True)
class Shape:
    """One test: a trial of the procedure that is written.

    The first current is held to ``change_at_m`` if the shape has a second one. ``lasting_s`` is the
    longest time of the last part. Every trial ends at ``stop_at_m``.
    """

    kind_name: str
    current_a: float
    stop_at_m: float
    lasting_s: float = LONGEST_S
    second_a: float = 0.0
    change_at_m: float = 0.0
    frequency_hz: float = 1.0

    @property
    def kind(self) -> Kind:
        """The shape of the current."""
        return Kind(self.kind_name)

    @property
    def lowest_a(self) -> float:
        """The lowest current that the motor is told."""
        return -self.current_a if self.kind is Kind.SWING else min(self.current_a, self.second_a)

    @property
    def phases(self) -> tuple[Phase, ...]:
        """The parts of the trial, in turn."""
        first, second, over = self.current_a, self.second_a, self.lasting_s
        if self.kind is Kind.CHANGE:
            return (
                Phase(lambda t: np.full(len(t), first), self.change_at_m, LONGEST_S),
                Phase(lambda t: np.full(len(t), second), self.stop_at_m, over),
            )
        if self.kind is Kind.RAMP:
            return (Phase(lambda t: first + (second - first) * t / over, self.stop_at_m, over),)
        if self.kind is Kind.SWING:
            half = 0.5 / self.frequency_hz
            # A sample at the turn belongs to the next half, however its time is rounded.
            return (
                Phase(
                    lambda t: np.where(np.floor(t / half + 1e-6) % 2 == 0, first, -first),
                    self.stop_at_m, over,
                ),
            )  # fmt: skip
        return (Phase(lambda t: np.full(len(t), first), self.stop_at_m, over),)


def shapes(largest_a: float, travel_m: float) -> tuple[Shape, ...]:
    """Return what can be chosen with currents to ``largest_a`` and ``travel_m`` to the brake."""
    return tuple(_shapes(lambda share: round(share * largest_a, 3), travel_m))


def _shapes(amperes: Callable[[float], float], travel_m: float) -> Iterator[Shape]:
    for share in HOLDS:
        for stop in STOPS:
            yield Shape(Kind.HOLD.value, amperes(share), round(stop * travel_m, 3))
    for first in FIRSTS:
        for second in SECONDS:
            for at in CHANGES:
                yield Shape(
                    Kind.CHANGE.value, amperes(first), travel_m, SECOND_S, amperes(second),
                    round(at * travel_m, 3),
                )  # fmt: skip
    for first, second in RAMPS:
        for lasting in RAMP_S:
            yield Shape(Kind.RAMP.value, amperes(first), travel_m, lasting, amperes(second))
    for share in SWINGS:
        for frequency in FREQUENCIES_HZ:
            for lasting in SWING_S:
                yield Shape(
                    Kind.SWING.value, amperes(share), travel_m, lasting, frequency_hz=frequency
                )
