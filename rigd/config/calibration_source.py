"""Schema of a calibration file: the keys and values that are allowed.

Every value stands for itself: it has its own date, operator, instruments and validity, because
values are measured one procedure at a time and grow old apart.
"""

from __future__ import annotations

from datetime import date
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, StringConstraints

from rigd.config.source import FileName, Name, QuantityText, Source

#: Where the number of a value comes from.
Origin = Literal["measured", "assumed", "data sheet"]
ShortText = Annotated[str, StringConstraints(min_length=1, max_length=300)]


def _day(value: object) -> object:
    """Return the day that ``value`` writes; pydantic alone would also take seconds since 1970."""
    if not isinstance(value, str):
        return value
    try:
        return date.fromisoformat(value)
    except ValueError:
        raise ValueError(f"{value!r} is no day such as 2026-11-21") from None


#: A day as 2026-11-21.
Day = Annotated[date, BeforeValidator(_day)]


class ValueSource(Source):
    """One value of a calibration."""

    value: QuantityText
    """The value, with its unit."""
    u: QuantityText
    """Its standard uncertainty (k = 1), in the same kind of unit."""
    source: Origin
    """Where the number comes from: `measured`, `assumed` or `data sheet`."""
    origin: Annotated[ShortText, Field(alias="from")]
    """The recording it was measured with, or why it is assumed."""
    made: Day
    """Day it was measured or decided."""
    operator: ShortText
    """Who answers for it."""
    valid_until: Day | None = None
    """Last day it may be used; what is measured must have one."""
    instruments: dict[Name, ShortText] = Field(default_factory=dict)
    """What each device said it was when this was measured; another one blocks a run."""


class ReplacedSource(ValueSource):
    """A value that another has replaced."""

    name: Name
    """Name it had."""
    replaced: Day
    """Day it was replaced."""


class CalibrationSource(Source):
    """What is known of a rig by measuring it: one value each, with its uncertainty."""

    calibration: FileName
    """Name of the calibration."""
    rigs: Annotated[list[FileName], Field(min_length=1, max_length=16)]
    """The rigs it belongs to; several only where they are rig files of the same bench."""
    values: dict[Name, ValueSource]
    """The values by name."""
    history: list[ReplacedSource] = Field(default_factory=list)
    """What was replaced, the newest first; `rigd calibrate` keeps it."""
