"""Gives the values of recordings and of conditions one form, in which they are compared.

Each value is a text. A quantity is a number in SI too, with its SI unit (``1`` for a plain number);
a date is the seconds since 1970 (UTC), with the unit :data:`DATE`.
"""

from __future__ import annotations

import re
from datetime import UTC, datetime
from functools import lru_cache
from typing import Final, NamedTuple

from rigd.model.units import parse_quantity, si_symbol

#: Stands in the place of a unit for dates.
DATE: Final = "date"
#: Two numbers are equal within so much of the larger, as 150 mA and 0.15 A are.
NEAR: Final = 1e-9
#: What begins like a quantity; other texts are not tried.
_NUMERIC: Final = re.compile(r"\s*[-+]?\.?\d")
_DATE: Final = re.compile(
    r"\d{4}-\d{2}(?:-\d{2}(?:[T ]\d{2}:\d{2}(?::\d{2}(?:\.\d+)?)?(?:Z|[+-]\d{2}:\d{2})?)?)?"
)


class Value(NamedTuple):
    """A value as text, and as a number if it is a quantity or a date."""

    text: str
    number: float | None = None
    unit: str = ""


class Period(NamedTuple):
    """A date as written: from ``start`` until before ``end``, in s since 1970 (UTC)."""

    start: float
    end: float


def begins_with_number(text: str) -> bool:
    """Return whether a text begins as a number or a date does: ``62 HRC``, ``100Cr6``."""
    return _NUMERIC.match(text) is not None


@lru_cache(maxsize=4096)
def value_of(text: str) -> Value:
    """Return a text with its number, if it is a quantity or a date."""
    if not begins_with_number(text):
        return Value(text)
    period = period_of(text)
    if period is not None:
        return Value(text, period.start, DATE)
    try:
        quantity = parse_quantity(text)
    except ValueError:
        return Value(text)
    return Value(text, quantity.value, si_symbol(quantity.unit.dimension))


def period_of(text: str) -> Period | None:
    """Return the time that a date means: a month, a day, a minute or a second; else None."""
    if _DATE.fullmatch(text) is None:
        return None
    try:
        if len(text) == len("2026-09"):
            begin = datetime.fromisoformat(f"{text}-01").replace(tzinfo=UTC)
            year, month = divmod(begin.month, 12)
            after = begin.replace(year=begin.year + year, month=month + 1)
            return Period(begin.timestamp(), after.timestamp())
        moment = datetime.fromisoformat(text)
    except (ValueError, OverflowError):
        return None
    if moment.tzinfo is None:
        moment = moment.replace(tzinfo=UTC)
    clock = text[len("2026-09-01T") : len("2026-09-01T10:00:00")]  # a zone has a colon too
    lasts = 86400.0 if not clock else 1.0 if clock.count(":") > 1 else 60.0
    return Period(moment.timestamp(), moment.timestamp() + lasts)
