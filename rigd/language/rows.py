"""Computes operations of fixed values at once; a graph makes rows of the others."""

from __future__ import annotations

import math
from typing import Protocol

from rigd.language.number import ExpressionError, Number
from rigd.language.operations import Op, compute
from rigd.model.units import NO_DIMENSION, Dimension


class Rows(Protocol):
    """Where operations go that are computed later, in cycles of ``period_s``."""

    period_s: float

    def add(
        self, op: Op, numbers: tuple[Number, ...], parameters: tuple[float, ...], size: int
    ) -> int:
        """Return the row of an operation."""
        ...


def operate(
    rows: Rows | None,
    op: Op,
    *numbers: Number,
    at: int,
    dimension: Dimension = NO_DIMENSION,
    parameters: tuple[float, ...] = (),
    size: int = 0,
    unit: str = "",
    is_condition: bool = False,
    is_difference: bool | None = None,
    of_arc: bool = False,
) -> Number:
    """Return the result of an operation that stands at ``at``: its value, or its row in ``rows``.

    ``is_difference`` is None if it is one when it has the dimension of one of ``numbers`` that is.

    Raises:
        ExpressionError: the value is no finite number, or there are no rows and it needs one.
    """
    if is_difference is None:
        is_difference = not is_condition and op is not Op.LOOKUP and any(
            number.is_difference and number.dimension == dimension for number in numbers
        )  # fmt: skip
    value = None
    if all(number.row is None for number in numbers) and (rows is None or not is_condition):
        value = compute(op, [number.value for number in numbers], parameters)
    if value is None:
        if rows is None:
            raise over_time(at)
        row = rows.add(op, numbers, parameters, size)
        uses = frozenset[str]().union(*(number.uses for number in numbers))
        return Number(math.nan, dimension, "", is_difference, of_arc, is_condition, row, uses)
    # NaN replaces a value whose problem is reported already: it must not cause a second one.
    if not math.isfinite(value) and all(math.isfinite(number.value) for number in numbers):
        kind = "too large a number" if math.isinf(value) else "no number"
        raise ExpressionError(f"the result is {kind}", at)
    return Number(value, dimension, unit, is_difference, of_arc, is_condition)


def over_time(at: int) -> ExpressionError:
    """Return the error that something at ``at`` has no value at one moment."""
    hint = "give the channel in `derived`, and use its name"
    return ExpressionError("this needs values over time, and one moment is read here", at, hint)
