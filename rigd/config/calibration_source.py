"""The shape of a calibration file, documented by its JSON Schema.

Every value stands for itself: it has its own date, operator, instruments and validity, because
values are measured one procedure at a time and grow old apart.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import date
from typing import Annotated, Final, Literal

from pydantic import BeforeValidator, Field, StringConstraints

from rigd.config.source import FileName, Name, QuantityText, Source

#: Where the number of a value comes from.
Origin = Literal["measured", "assumed", "data sheet"]
ShortText = Annotated[str, StringConstraints(min_length=1, max_length=300)]


@dataclass(frozen=True)
class Calibratable:
    """A value that a calibration may hold: its unit, what it is, and what measures it."""

    unit: str
    doc: str
    procedure: str = ""  #: the shipped procedure that measures it; "" where none does
    sign: Literal["positive", "not negative", "any"] = "not negative"


#: Every value that calibrations may hold; a rig family adds its own.
CALIBRATABLE: Final = {
    "torque_scale": Calibratable(
        "N m/V", "torque per volt of (gauge a - gauge b)", "calibrate_torque", "positive"
    ),
    "wheel_scale": Calibratable(
        "rad/V", "angle per volt of the wheel's potentiometer", sign="positive"
    ),
    "platform_scale": Calibratable(
        "m/V", "travel per volt of the platform's potentiometer", sign="positive"
    ),
    "load_scale": Calibratable(
        "1", "true load per load that the scale shows", "calibrate_scale", "positive"
    ),
    "normal_force_scale": Calibratable(
        "N/V", "normal force per volt of the load cell", sign="positive"
    ),
    "normal_force_zero": Calibratable("V", "voltage of the load cell at 0 N", sign="any"),
    "effective_radius": Calibratable(
        "1", "effective over nominal radius of the wheel", sign="positive"
    ),
    "bearing_constant": Calibratable(
        "N m", "torque of the wheel's bearings at rest, without load", "calibrate_friction"
    ),
    "bearing_viscous": Calibratable(
        "N m s/rad", "torque of the wheel's bearings per angular speed", "calibrate_friction"
    ),
    "bearing_load": Calibratable("N m/N", "torque of the wheel's bearings per normal force"),
    "rolling_resistance": Calibratable("1", "moment of rolling resistance over N R"),
    "roller_drag": Calibratable("1", "axial drag of the free rollers over N"),
    "load_rise": Calibratable(
        "1/m", "relative rise of N per travel of the platform", "calibrate_rise", "any"
    ),
    "rail_constant": Calibratable(
        "N", "friction of the rails, whatever load and speed", "calibrate_friction"
    ),
    "rail_load": Calibratable("1", "friction of the rails per load on them"),
    "rail_viscous": Calibratable("N s/m", "friction of the rails per speed", "calibrate_friction"),
}


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
