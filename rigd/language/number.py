"""Defines what a part of an expression is: a value in SI and its dimension."""

from __future__ import annotations

from dataclasses import dataclass

from rigd.model.units import NO_DIMENSION, Dimension, Unit


class ExpressionError(ValueError):
    """An expression is wrong; ``offset`` counts characters from its start.

    ``lacks`` is the channel or constant that the rig does not have, if that is what is wrong.
    """

    def __init__(
        self, message: str, offset: int = 0, hint: str | None = None, *, lacks: str = ""
    ) -> None:
        super().__init__(message)
        self.offset = offset
        self.hint = hint
        self.lacks = lacks


class UnknownName(ExpressionError):
    """An expression uses ``${name}``, which has no value at this place."""

    def __init__(self, name: str, offset: int) -> None:
        super().__init__(f"unknown name '${{{name}}}'", offset)
        self.name = name


@dataclass(frozen=True, slots=True)
class Number:
    """A quantity: SI value and dimension.

    ``unit`` is not "" if the value was given in a unit with a zero of its own (``degC``). Such a
    value takes part in sums only: it can be moved by a difference, and two give a difference, which
    ``is_difference`` then shows. ``of_arc``: it is an arc over its radius, and may be an angle.
    ``is_condition``: it is 1 or 0, true or false.

    ``row`` is not None for what the cycle computes: the row of a graph that has its value;
    ``value`` is then NaN, and ``uses`` are the channels of devices in it.
    """

    value: float
    dimension: Dimension = NO_DIMENSION
    unit: str = ""
    is_difference: bool = False
    of_arc: bool = False
    is_condition: bool = False
    row: int | None = None
    uses: frozenset[str] = frozenset()

    @property
    def is_fixed(self) -> bool:
        """Whether its value never changes."""
        return self.row is None

    @property
    def is_plain(self) -> bool:
        """Whether it is fixed and no unit tells whether it is a value or a difference."""
        return self.row is None and not self.unit and not self.is_difference

    @property
    def is_on_scale(self) -> bool:
        """Whether it is a value, and no difference: of a channel, or in ``degC``."""
        return bool(self.unit) or (self.row is not None and not self.is_difference)


def number_in(value: float, unit: Unit) -> Number:
    """Return an SI value that was given in ``unit``."""
    return Number(value, unit.dimension, unit.symbol if unit.offset else "")
