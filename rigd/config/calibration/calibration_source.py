"""Defines the schema of a calibration file: the keys and values that are allowed.

Every value has its own date, operator, instruments and validity, because each procedure measures
some values only, and the values expire at different times.
"""

from __future__ import annotations

from datetime import date
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, StringConstraints

from rigd.config.source import FileName, Name, QuantityText, Source

#: The kind of source of a value.
Origin = Literal["measured", "assumed", "data sheet"]
ShortText = Annotated[str, StringConstraints(min_length=1, max_length=300)]


def _day(value: object) -> object:
    """Return the day in ``value``; pydantic alone would also accept seconds since 1970."""
    if not isinstance(value, str):
        return value
    try:
        return date.fromisoformat(value)
    except ValueError:
        raise ValueError(f"{value!r} is not a day such as 2026-11-21") from None


#: A day as 2026-11-21.
Day = Annotated[date, BeforeValidator(_day)]


class ValueSource(Source):
    """One value of a calibration."""

    value: QuantityText
    """The value, with its unit."""
    u: QuantityText
    """Its standard uncertainty (k = 1), in the same kind of unit."""
    source: Origin
    """Source of the number: `measured`, `assumed` or `data sheet`."""
    origin: Annotated[ShortText, Field(alias="from")]
    """The recording of the measurement, or the reason for the assumption."""
    made: Day
    """Day of the measurement or decision."""
    operator: ShortText
    """The person who is responsible for it."""
    valid_until: Day | None = None
    """Last day on which it may be used; required for a measured value."""
    instruments: dict[Name, ShortText] = Field(default_factory=dict)
    """The identity of each device at the measurement; another device blocks a run."""


class ReplacedSource(ValueSource):
    """A value that was replaced by another value."""

    name: Name
    """Its name."""
    replaced: Day
    """Day of the replacement."""


class CalibrationSource(Source):
    """The measured values of a rig, each with its uncertainty."""

    calibration: FileName
    """Name of the calibration."""
    rigs: Annotated[list[FileName], Field(min_length=1, max_length=16)]
    """Rigs with this calibration; several only if they are rig files of the same bench."""
    values: dict[Name, ValueSource]
    """The values by name."""
    history: list[ReplacedSource] = Field(default_factory=list)
    """Replaced values, the newest first; `rigd calibrate` keeps them."""
