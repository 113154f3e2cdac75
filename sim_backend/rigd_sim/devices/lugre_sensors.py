"""Simulated sensors of the LuGre rig: encoders, accelerometer, true states for comparison."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, ClassVar, Final, Literal, Self

from annotated_types import Gt
from pydantic import model_validator

from rigd.sdk import Channel, DriverConfig, In, PlantSensor
from rigd_sim.plants.lugre import layout
from rigd_sim.plants.lugre.plant import LugrePlant

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
            raise ValueError(f"'{min(misplaced)}' belongs to 'axis: {other}'; remove it here")
        return self


class LugreEncoder(PlantSensor):
    """An incremental encoder that starts at zero where the rig was switched on."""

    Config: ClassVar[type[DriverConfig]] = EncoderConfig
    link: LugrePlant
    title: ClassVar[str] = "encoder of the simulated LuGre rig"

    def __init__(self, config: EncoderConfig, link: LugrePlant | None) -> None:
        super().__init__(config, link)
        if config.axis == "wheel":
            self._reading = layout.MOTOR_COUNTS
            self._scale = 1.0 / (config.counts_per_revolution * config.gear_ratio)
            converted = Channel("angle", "rad", "angle of the wheel")
        else:
            self._reading = layout.GUIDE_COUNTS
            self._scale = config.distance_per_count
            converted = Channel("position", "m", "position of the carriage", -0.1, 1.8)
        counts = Channel("counts", "count", "encoder counts", raw_of=converted.name)
        self.channels = (converted, counts)

    def read(self, t_ns: int) -> Sequence[float]:
        """Return the angle in rad (wheel) or position in m (carriage), and the counts."""
        counts = self.link.readings_at(t_ns)[self._reading]
        return counts * self._scale, counts


class AccelerometerConfig(DriverConfig):
    """How the accelerometer's volts become an acceleration."""

    scale: Annotated[float, In("m/s^2/V"), Gt(0)] = 1 / 0.102
    """Acceleration per volt."""
    zero: Annotated[float, In("V")] = 0.0
    """Voltage at rest; its error is a bias that identification takes out from the rest phase."""


class LugreAccelerometer(PlantSensor):
    """An accelerometer on the carriage, along the guide, on a 14-bit card of ±10 V."""

    Config: ClassVar[type[DriverConfig]] = AccelerometerConfig
    link: LugrePlant
    title: ClassVar[str] = "accelerometer of the simulated LuGre rig"
    config: AccelerometerConfig

    def __init__(self, config: AccelerometerConfig, link: LugrePlant | None) -> None:
        super().__init__(config, link)
        span = 10.0 * config.scale
        self.channels = (
            Channel("acceleration", "m/s^2", "acceleration of the carriage", -span, span),
            Channel("acceleration_raw", "V", "output at the card", -10, 10, raw_of="acceleration"),
        )

    def read(self, t_ns: int) -> Sequence[float]:
        """Return the acceleration in m/s^2 and the volts."""
        volts = self.link.readings_at(t_ns)[layout.ACCELERATION_VOLTS]
        return (volts - self.config.zero) * self.config.scale, volts


class LugreTruth(PlantSensor):
    """The hidden state of the plant, for verification; no real rig has it."""

    link: LugrePlant
    title: ClassVar[str] = "hidden state of the simulated LuGre rig"
    channels = tuple(Channel(name, unit, doc) for name, unit, doc in layout.TRUTH)

    def read(self, t_ns: int) -> Sequence[float]:
        """Return the hidden state in the order of ``channels``."""
        return self.link.readings_at(t_ns)[layout.TRUTH_READINGS :]
