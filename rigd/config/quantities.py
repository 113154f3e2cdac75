"""Parses quantities of a file in the unit that another part of the file determines."""

from __future__ import annotations

import math

from rigd.config.document import Document, Path_
from rigd.config.problems import Problems
from rigd.model.units import format_quantity
from rigd.sdk import In


def read_quantity(
    document: Document, path: Path_, text: str, unit: str, problems: Problems
) -> float:
    """Return ``text`` in SI, or NaN with the problem noted at ``path``."""
    try:
        return In(unit).read(text)
    except ValueError as error:
        problems.add(document.place(path), str(error))
        return math.nan


def rate_unit(unit: str) -> str:
    """Return the unit of a change of ``unit`` per second: ``m/s`` gives ``m/s^2``."""
    return f"{unit}^2" if unit.endswith("/s") else f"{unit}/s"


def check_inside(
    document: Document,
    path: Path_,
    value: float,
    bounds: tuple[float, float],
    unit: str,
    owner: str,
    problems: Problems,
) -> None:
    """Note a ``value`` outside ``bounds`` (all in SI); NaN was noted when it was read."""
    low, high = bounds
    if value < low or value > high:
        side, bound = ("below", low) if value < low else ("above", high)
        problems.add(
            document.place(path),
            f"{format_quantity(value, unit)} is {side} {format_quantity(bound, unit)}, "
            f"the limit of {owner}",
            f"stay within {format_quantity(low, unit)} and {format_quantity(high, unit)}",
        )
