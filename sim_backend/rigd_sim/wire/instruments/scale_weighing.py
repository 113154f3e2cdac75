"""Simulates the inside of a scale: load cell that settles, display that rounds, tare and zero."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from typing import Final

#: Mass that one unit of the display stands for, in kg; newtons at standard gravity 9.80665 m/s²
#: (3rd CGPM, 1901), as a scale shows them.
DISPLAY_UNITS: Final = {
    "g": 0.001, "kg": 1.0, "lb": 0.45359237, "oz": 0.028349523125, "N": 1 / 9.80665,
}  # fmt: skip
#: A scale zeroes within ±2 % of its capacity (OIML R 76-1, 4.5.1: 4 % in all).
ZERO_RANGE: Final = 0.02
#: Overload begins 9 divisions above the capacity, underload 20 below zero (R 76-1, 4.2.3).
OVER_DIVISIONS: Final = 9
UNDER_DIVISIONS: Final = 20


class Weighing:
    """The weight as a scale sees it; times in s, masses in kg.

    The cell follows the load with the time constant ``settling_s``. The weight is stable once it
    has stayed within one division for three of them, and what lies on it keeps still (``rests``).
    """

    def __init__(
        self, *, capacity_kg: float, division_kg: float, noise_kg: float, settling_s: float,
        unit: str, seed: int, rests: Callable[[], bool] | None = None,
    ) -> None:  # fmt: skip
        self.capacity_kg = capacity_kg
        self.division_kg = division_kg
        self.noise_kg = noise_kg
        self.settling_s = settling_s
        self.unit = unit
        self.tare_kg = 0.0
        self.never_stable = False
        self._rests = rests
        self.beyond: int = 0  #: 1: shows overload with any load, -1: underload
        self._random = random.Random(seed)
        self._cell_kg: float | None = None
        self._zero_kg = 0.0
        self._anchor_kg = math.inf  # where the weight was when it last moved
        self._moved_s = 0.0
        self._now_s = 0.0

    def advance(self, now_s: float, load_kg: float) -> None:
        """Bring the cell to ``now_s``, with ``load_kg`` on it since the last call."""
        if self._cell_kg is None:
            self._cell_kg = load_kg  # it was switched on with this load
            self._moved_s = -math.inf
            self._anchor_kg = load_kg
        else:
            share = -math.expm1(-(now_s - self._now_s) / self.settling_s)
            self._cell_kg += (load_kg - self._cell_kg) * share
        self._now_s = now_s
        if abs(self._cell_kg - self._anchor_kg) > self.division_kg:
            self._anchor_kg = self._cell_kg
            self._moved_s = now_s

    @property
    def gross_kg(self) -> float:
        """Weight above the zero point, before noise and rounding."""
        return (self._cell_kg or 0.0) - self._zero_kg

    @property
    def stable(self) -> bool:
        """Whether the weight rests."""
        if self._rests is not None and not self._rests():
            return False
        return not self.never_stable and self._now_s - self._moved_s >= 3 * self.settling_s

    @property
    def overload(self) -> bool:
        """Whether the load is beyond the capacity."""
        limit = self.capacity_kg + OVER_DIVISIONS * self.division_kg
        return self.beyond > 0 or self.gross_kg > limit

    @property
    def underload(self) -> bool:
        """Whether the pan is lifted off."""
        return self.beyond < 0 or self.gross_kg < -UNDER_DIVISIONS * self.division_kg

    def net_kg(self) -> float:
        """Return the net weight with the noise of this moment, rounded to the division."""
        noise = self._random.gauss(0.0, self.noise_kg)
        return self._rounded(self.gross_kg - self.tare_kg + noise)

    def shown(self) -> str:
        """Return the net weight as the display shows it, in its unit: ``12.35`` or ``-0.01``."""
        return self.text(self.net_kg())

    def text(self, mass_kg: float) -> str:
        """Return a mass as the display would show it."""
        per_unit = DISPLAY_UNITS[self.unit]
        decimals = max(0, math.ceil(-math.log10(self.division_kg / per_unit) - 1e-9))
        text = f"{mass_kg / per_unit:.{decimals}f}"
        return text.removeprefix("-") if float(text) == 0 else text

    def tare(self) -> None:
        """Take the gross weight as tare."""
        self.tare_kg = self.gross_kg

    def zero(self) -> bool:
        """Set the zero point, and clear the tare; False if the load is out of range for it."""
        if abs(self.gross_kg) > ZERO_RANGE * self.capacity_kg:
            return False
        self._zero_kg += self.gross_kg
        self.tare_kg = 0.0
        return True

    def _rounded(self, mass_kg: float) -> float:
        return round(mass_kg / self.division_kg) * self.division_kg
