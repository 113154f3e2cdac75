"""Simulates the encoders and the accelerometer of the LuGre rig, and gives its true states."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, ClassVar, Final, Literal, Self

from annotated_types import Gt
from pydantic import model_validator

from rigd.sdk import Channel, Declaration, DriverConfig, In, PlantSensor, Row, wrong_entry
from rigd_sim.lugre import layout
from rigd_sim.lugre.plant import LugrePlant

#: Options of :class:`EncoderConfig` that only one axis has.
_OPTIONS: Final = {
    "wheel": ("counts_per_revolution", "gear_ratio"),
    "carriage": ("distance_per_count",),
}


class EncoderConfig(DriverConfig):
    """Which encoder, and how its counts become an angle or a position."""

    axis: Literal["wheel", "carriage"]
    """The one on the wheel's motor, or that of the measuring wheel on the guide."""
    counts_per_revolution: Annotated[float, In("count/rad"), Gt(0)] = 1024 / (2 * math.pi)
    """Counts per revolution of the motor shaft (wheel only)."""
    gear_ratio: Annotated[float, In("1"), Gt(0)] = 20.25
    """Turns of the motor per turn of the wheel (wheel only)."""
    distance_per_count: Annotated[float, In("m/count"), Gt(0)] = 2 * math.pi * 0.02 / 4096
    """Travel of the carriage per count (carriage only)."""

    @model_validator(mode="after")
    def _only_options_of_the_axis(self) -> Self:
        other = "carriage" if self.axis == "wheel" else "wheel"
        misplaced = self.model_fields_set.intersection(_OPTIONS[other])
        if misplaced:
            raise wrong_entry(
                f"'{min(misplaced)}' belongs to 'axis: {other}'; remove it here", min(misplaced)
            )
        return self


class AngleRow(Row):
    """The wheel."""

    angle: float
    counts: float


class PositionRow(Row):
    """The carriage along the guide."""

    position: float
    counts: float


class LugreEncoder(PlantSensor[EncoderConfig, LugrePlant]):
    """An incremental encoder that starts at zero where the rig was switched on."""

    Config: ClassVar[type[DriverConfig]] = EncoderConfig
    title: ClassVar[str] = "encoder of the simulated LuGre rig"

    def __init__(self, config: EncoderConfig, link: LugrePlant) -> None:
        super().__init__(config, link)
        self._is_angle = config.axis == "wheel"
        if self._is_angle:
            self._reading = layout.MOTOR_COUNTS
            self._scale = 1.0 / (config.counts_per_revolution * config.gear_ratio)
        else:
            self._reading = layout.GUIDE_COUNTS
            self._scale = config.distance_per_count

    @classmethod
    def declare(cls, config: EncoderConfig) -> Declaration:
        """Return the angle (wheel) or the position (carriage), and the counts."""
        row: type[Row]
        if config.axis == "wheel":
            row, converted = AngleRow, Channel("angle", "rad", "angle of the wheel")
        else:
            converted = Channel("position", "m", "position of the carriage", -0.1, 1.8)
            row = PositionRow
        counts = Channel("counts", "count", "encoder counts", raw_of=converted.name)
        return Declaration(channels=(converted, counts), row=row)

    def read(self, t_ns: int) -> AngleRow | PositionRow:
        """Return the angle in rad (wheel) or position in m (carriage), and the counts."""
        counts = self.link.readings_at(t_ns)[self._reading]
        if self._is_angle:
            return AngleRow.of(angle=counts * self._scale, counts=counts)
        return PositionRow.of(position=counts * self._scale, counts=counts)


class AccelerometerConfig(DriverConfig):
    """How the accelerometer's volts become an acceleration."""

    scale: Annotated[float, In("m/s^2/V"), Gt(0)] = 1 / 0.102
    """Acceleration per volt."""
    zero: Annotated[float, In("V")] = 0.0
    """Voltage at rest; its error is a bias that identification takes out from the rest phase."""


class AccelerationRow(Row):
    """The carriage along the guide, and the volts at the card."""

    acceleration: float
    acceleration_raw: float


class LugreAccelerometer(PlantSensor[AccelerometerConfig, LugrePlant]):
    """An accelerometer on the carriage, along the guide, on a 14-bit card of ±10 V."""

    Config: ClassVar[type[DriverConfig]] = AccelerometerConfig
    title: ClassVar[str] = "accelerometer of the simulated LuGre rig"

    @classmethod
    def declare(cls, config: AccelerometerConfig) -> Declaration:
        """Return the acceleration and the volts."""
        span = 10.0 * config.scale
        raw = Channel("acceleration_raw", "V", "output at the card", -10, 10, raw_of="acceleration")
        return Declaration(
            channels=(
                Channel("acceleration", "m/s^2", "acceleration of the carriage", -span, span),
                raw,
            ),
            row=AccelerationRow,
        )

    def read(self, t_ns: int) -> AccelerationRow:
        """Return the acceleration in m/s^2 and the volts."""
        volts = self.link.readings_at(t_ns)[layout.ACCELERATION_VOLTS]
        acceleration = (volts - self.config.zero) * self.config.scale
        return AccelerationRow.of(acceleration=acceleration, acceleration_raw=volts)


class LugreTruth(PlantSensor[DriverConfig, LugrePlant]):
    """The hidden state of the plant, for verification; no real rig has it."""

    title: ClassVar[str] = "hidden state of the simulated LuGre rig"

    @classmethod
    def declare(cls, config: DriverConfig) -> Declaration:
        """Return the hidden state that the plant lists."""
        channels = tuple(Channel(name, unit, doc) for name, unit, doc in layout.TRUTH)
        return Declaration(channels=channels, plain_rows=True)

    def read(self, t_ns: int) -> Sequence[float]:
        """Return the hidden state in the order of ``layout.TRUTH``."""
        return self.link.readings_at(t_ns)[layout.TRUTH_READINGS :]
