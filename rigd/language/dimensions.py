"""Compares dimensions as formulas and procedures do: a radian beside a length counts as 1.

So an arc (``0.03 m * wheel.angle``) is a length, and torque times angle an energy; an angle alone
keeps its dimension, so that it is never added to a plain number. An arc over its radius, in which
the lengths cancel, is an angle where one is asked for.
"""

from __future__ import annotations

from typing import Final

from rigd.model.units import BASES, Dimension

_RAD: Final = BASES.index("rad")
_LENGTH: Final = BASES.index("m")
_TIME: Final = BASES.index("s")
_METRE: Final[Dimension] = tuple(int(base == "m") for base in BASES)


def plain(dimension: Dimension) -> Dimension:
    """Return ``dimension`` without its radians if it has a length too."""
    if dimension[_LENGTH] == 0:
        return dimension
    return tuple(0 if base == _RAD else power for base, power in enumerate(dimension))


def alike(first: Dimension, second: Dimension) -> bool:
    """Return whether quantities of these dimensions can be added or compared."""
    return plain(first) == plain(second)


def is_angle(above: Dimension, below: Dimension, *, of_arc: bool = False) -> bool:
    """Return whether a quotient is an arc, or its rate, over its radius: ``m/s`` over ``m``.

    ``of_arc``: an operand is an angle already, as in ``${arc} / ${radius} / ${time}``.
    """
    way = tuple(0 if base == _TIME else power for base, power in enumerate(above))
    return of_arc or (below == _METRE and way == _METRE)


def fits(given: Dimension, wanted: Dimension, *, of_arc: bool) -> bool:
    """Return whether a quantity can stand for one of dimension ``wanted``.

    ``of_arc``: it is an arc over its radius, and may be the angle that is wanted.
    """
    bare = tuple(0 if base == _RAD else power for base, power in enumerate(wanted))
    return alike(given, wanted) or (of_arc and given == bare)


def times(first: Dimension, second: Dimension) -> Dimension:
    """Return the dimension of a product."""
    return tuple(a + b for a, b in zip(first, second, strict=True))


def over(first: Dimension, second: Dimension) -> Dimension:
    """Return the dimension of a quotient."""
    return tuple(a - b for a, b in zip(first, second, strict=True))
