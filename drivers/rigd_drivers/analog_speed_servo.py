"""A drive in speed mode with analogue set value, for a linear axis behind a clutch."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, ClassVar, Self

from annotated_types import Ge, Gt, Le
from pydantic import model_validator

from rigd.sdk import Channel, DriverConfig, In
from rigd_drivers.analog_drive import AnalogDrive, AnalogDriveConfig, accepted, check_reach
from rigd_drivers.card import Card
from rigd_drivers.card_counter import EncoderCounter


class AnalogSpeedServoConfig(AnalogDriveConfig):
    """How speeds, volts and counts belong together, and how fast the axis may be asked to run."""

    speed_range: Annotated[float, In("m/s"), Gt(0), Le(10)]
    """Largest setpoint of either sign."""
    set_scale: Annotated[float, In("m/s/V"), Gt(0)]
    """Speed per volt of the set value."""
    monitor_scale: Annotated[float, In("m/s/V"), Gt(0)]
    """Speed per volt of the monitor (tachometer)."""
    monitor_inverted: bool = False
    """Whether a positive speed gives a negative voltage."""
    encoder: Annotated[int, Ge(0)]
    """Encoder input of the card that counts the axis."""
    distance_per_count: Annotated[float, In("m/count"), Gt(0)]
    """Travel of the axis per count."""
    encoder_inverted: bool = False
    """Whether the count falls as the position grows."""
    fastest: Annotated[float, In("count/s"), Gt(0)] = 1e6
    """Count rate that the axis cannot reach; more between two cycles is no motion."""
    clutch_output: Annotated[int, Ge(0)] | None = None
    """Digital output that releases a spring-applied clutch while it is not at rest; by default
    there is no clutch."""

    @model_validator(mode="after")
    def _within_reach(self) -> Self:
        check_reach("speed_range", self.speed_range, self.set_scale)
        return self


class AnalogSpeedServo(AnalogDrive):
    """Sets the speed of a linear axis.

    Safe means 0 V, disabled, the clutch engaged: its spring does that without power. The drive's
    own holding brake must take over where the axis could coast too far.
    """

    Config: ClassVar[type[DriverConfig]] = AnalogSpeedServoConfig
    title: ClassVar[str] = "analogue servo drive in speed mode, on a card"
    config: AnalogSpeedServoConfig

    def __init__(self, config: AnalogSpeedServoConfig, link: Card | None) -> None:
        largest = config.speed_range
        setpoint = Channel("speed", "m/s", "speed of the axis", -largest, largest)
        super().__init__(
            config,
            link,
            setpoint=setpoint,
            set_scale=config.set_scale,
            monitor_scale=config.monitor_scale,
        )
        clutch = Channel("engaged", "1", "clutch: 1 engaged, 0 released (no force)", 0.0, 1.0)
        self._clutched = config.clutch_output is not None
        self.setpoints = (setpoint, clutch) if self._clutched else (setpoint,)
        self.channels = (
            Channel("position", "m", "position of the axis since it was opened"),
            Channel("counts", "count", "encoder counts", raw_of="position"),
            *self.monitor_channels,
        )
        self._counter = EncoderCounter(config.encoder, config.fastest)
        distance = config.distance_per_count
        self._distance = -distance if config.encoder_inverted else distance

    def open(self) -> None:
        """Take the outputs and inputs on the card; the position starts at zero."""
        super().open()
        config, card = self.config, self.link
        if config.clutch_output is not None:
            card.take_outputs(lines=(config.clutch_output,))
        self._counter.open(card, at_zero=True)

    def read(self, t_ns: int) -> Sequence[float]:
        """Return position, counts, speed, monitor volts, status (:mod:`rigd_drivers.analog_drive`).

        Raises:
            DeviceError: the drive was enabled, and is not any more; or the count jumped.

        """
        counts = self._counter.take(self.link)
        return counts * self._distance, float(counts), *self._monitor()

    def write(self, setpoints: Sequence[float]) -> None:
        """Demand a speed in m/s and set the clutch (above one half: engaged).

        Raises:
            DeviceError: a setpoint is NaN; those before it hold.

        """
        engaged = not self._clutched or accepted(self.setpoints[1], setpoints[1]) > 0.5
        self._demand(setpoints[0])
        if self._armed:
            self._set_clutch(engaged=engaged)

    def _rest(self) -> None:
        super()._rest()
        self._set_clutch(engaged=True)

    def _set_clutch(self, *, engaged: bool) -> None:
        line = self.config.clutch_output
        if line is not None:
            self.link.set_line(line, high=self.link.rests_high(line) == engaged)
