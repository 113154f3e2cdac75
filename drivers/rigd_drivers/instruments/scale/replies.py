"""Defines the replies of a scale in one form for all protocols."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from typing import Final, Literal

#: Units that a scale may show.
UnitName = Literal["g", "kg", "lb", "oz", "N"]

#: Factor to SI (kg, or N for newtons). Pound and ounce: international avoirdupois pound,
#: exactly 0.45359237 kg (agreement of 1959; NIST SP 811, B.8), and its sixteenth.
UNITS: Final[dict[str, float]] = {
    "mg": 1e-6, "g": 1e-3, "kg": 1.0, "t": 1e3, "lb": 0.45359237, "oz": 0.45359237 / 16, "N": 1.0,
}  # fmt: skip


class Load(Enum):
    """What a weight reply reports about the load besides its value."""

    STABLE = "stable"
    DYNAMIC = "not yet stable"
    OVERLOAD = "overload"
    UNDERLOAD = "underload"


@dataclass(frozen=True)
class Reading:
    """A weight: ``value`` in ``unit`` as shown; NaN and "" if over- or underloaded."""

    load: Load
    value: float = math.nan
    unit: str = ""


@dataclass(frozen=True)
class Refusal:
    """The scale understood the command but did not carry it out; ``reason`` is for a person."""

    code: str
    reason: str


@dataclass(frozen=True)
class Done:
    """A command was carried out; ``text`` is what the scale added, such as the tare weight."""

    text: str = ""


@dataclass(frozen=True)
class Info:
    """A line of an answer about the scale itself; more lines follow unless ``last``."""

    texts: tuple[str, ...]
    last: bool
