"""Defines the settings of a plant that an operator can change, and the values that each takes."""

from __future__ import annotations

import math
from dataclasses import dataclass

from rigd.model.units import format_quantity, parse_unit

#: How far a number may lie from one of ``choices`` and still be it, as a share of the largest.
NEAR = 1e-4


@dataclass(frozen=True)
class Setting:
    """A thing that the operator can set at the bench: words, listed numbers, or a range.

    ``choices``, ``low`` and ``high`` are in ``unit``; "" as the unit makes the choices words.
    ``moves`` if to set it puts bodies elsewhere, as when a robot is laid back to its marks.
    """

    doc: str
    choices: tuple[str, ...] | tuple[float, ...] = ()
    unit: str = ""
    low: float = -math.inf
    high: float = math.inf
    moves: bool = False

    def __str__(self) -> str:
        """Return the values that it takes: ``stone, pvc``, ``0.5 kg to 20 kg``."""
        if self.choices:
            return " ".join((", ".join(map(_shown, self.choices)), self.unit)).strip()
        return f"{self.low:g} {self.unit} to {self.high:g} {self.unit}"

    def accepted(self, name: str, value: float | str) -> float | str:
        """Return ``value`` as it is set, a number in SI; ``name`` is that of the setting.

        Raises:
            ValueError: the setting refuses this value; the message lists the accepted values.
        """
        taken = self._taken(value)
        if taken is not None:
            return taken
        shown = (
            format_quantity(value, self.unit)
            if self.unit and not isinstance(value, str)
            else repr(value)
        )
        raise ValueError(f"{name} cannot be {shown}: it takes {self}")

    def _taken(self, value: float | str) -> float | str | None:
        if not self.unit:
            return value if isinstance(value, str) and value in self.choices else None
        if isinstance(value, str):
            return None
        to_si = parse_unit(self.unit).to_si
        numbers = [to_si(choice) for choice in self.choices if not isinstance(choice, str)]
        if numbers:
            near = NEAR * max(map(abs, numbers))
            return next((number for number in numbers if abs(value - number) <= near), None)
        return float(value) if self._low <= value <= self._high else None

    @property
    def _low(self) -> float:
        return parse_unit(self.unit).to_si(self.low)

    @property
    def _high(self) -> float:
        return parse_unit(self.unit).to_si(self.high)


def _shown(choice: float | str) -> str:
    return choice if isinstance(choice, str) else f"{choice:g}"
