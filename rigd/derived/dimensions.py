"""Compares dimensions as formulas do: a radian beside a length counts as 1.

So an arc (``0.03 m * wheel.angle``) is a length, and torque times angle an energy; an angle alone
keeps its dimension, so that it is never added to a plain number.
"""

from __future__ import annotations

from typing import Final

from rigd.model.units import BASES, Dimension

_RAD: Final = BASES.index("rad")
_LENGTH: Final = BASES.index("m")


def plain(dimension: Dimension) -> Dimension:
    """Return ``dimension`` without its radians if it has a length too."""
    if dimension[_LENGTH] == 0:
        return dimension
    return tuple(0 if base == _RAD else power for base, power in enumerate(dimension))


def alike(first: Dimension, second: Dimension) -> bool:
    """Return whether quantities of these dimensions can be added or compared."""
    return plain(first) == plain(second)


def times(first: Dimension, second: Dimension) -> Dimension:
    """Return the dimension of a product."""
    return tuple(a + b for a, b in zip(first, second, strict=True))


def over(first: Dimension, second: Dimension) -> Dimension:
    """Return the dimension of a quotient."""
    return tuple(a - b for a, b in zip(first, second, strict=True))
