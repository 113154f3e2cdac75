"""Parses quantities in a file if another part of the file determines their unit."""

from __future__ import annotations

import math

from rigd.config.document import Document, KeyPath
from rigd.config.problems import Problems
from rigd.model.constants import Uncertainty, parse_uncertainty
from rigd.model.limits import rounded_to
from rigd.model.units import Unit, format_quantity, parse_quantity, parse_unit
from rigd.sdk import In


def read_quantity(
    document: Document, path: KeyPath, text: str, unit: str, problems: Problems
) -> float:
    """Return ``text`` in SI, or NaN with the problem noted at ``path``."""
    try:
        return In(unit).read(text)
    except ValueError as error:
        problems.add(document.place(path), str(error))
        return math.nan


def read_difference(
    document: Document, path: KeyPath, text: str, unit: str, problems: Problems
) -> float:
    """Return a tolerance, a noise or a step for values in ``unit``, as :func:`read_quantity`.

    ``2 K`` is one for values in ``degC``, ``2 degC`` is a problem.
    """
    try:
        return In(parse_unit(unit).difference().symbol, difference=True).read(text)
    except ValueError as error:
        problems.add(document.place(path), str(error))
        return math.nan


def read_uncertainty(
    document: Document, path: KeyPath, text: str | None, unit: Unit, problems: Problems
) -> Uncertainty | None:
    """Return the uncertainty of a value in ``unit``, or None with a problem noted at ``path``.

    Also None, without a problem, if ``text`` is None: no uncertainty is given.
    """
    if text is None:
        return None
    try:
        return parse_uncertainty(text, unit)
    except ValueError as error:
        shares = "" if unit.offset else " or '0.2 %'"
        hint = f"give the standard uncertainty (k = 1), such as '0.1 {unit.difference()}'{shares}"
        problems.add(document.place(path), str(error), hint)
        return None


def rate_unit(unit: str) -> str:
    """Return the unit of a change of ``unit`` per second: ``m/s`` gives ``m/s^2``."""
    return f"{unit}^2" if unit.endswith("/s") else f"{unit}/s"


def has_unit_like(text: str, unit: str) -> bool:
    """Return whether ``text`` is a quantity that can be given in ``unit``."""
    try:
        return parse_quantity(text).unit.same_kind(parse_unit(unit))
    except ValueError:
        return False


def check_inside(
    document: Document,
    path: KeyPath,
    value: float,
    bounds: tuple[float, float],
    unit: str,
    owner: str,
    problems: Problems,
) -> float:
    """Return ``value``, at a bound if rounding has brought it beyond (all in SI).

    One that is outside ``bounds`` is noted; NaN was noted when the value was read.
    """
    low, high = bounds
    value = rounded_to(low, value, high)
    if value < low or value > high:
        side, bound = ("below", low) if value < low else ("above", high)
        problems.add(
            document.place(path),
            f"{format_quantity(value, unit)} is {side} {format_quantity(bound, unit)}, "
            f"the limit of {owner}",
            f"stay within {format_quantity(low, unit)} and {format_quantity(high, unit)}",
        )
    return value
