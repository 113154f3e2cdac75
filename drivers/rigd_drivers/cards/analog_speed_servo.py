"""Moves a linear axis behind a clutch, through a drive in speed mode with an analogue set value."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, ClassVar, Self

from annotated_types import Ge, Gt, Le
from pydantic import model_validator

from rigd.sdk import Channel, Declaration, DriverConfig, In, Row, about_entry
from rigd_drivers.cards.analog_drive import AnalogDrive, AnalogDriveConfig, accepted, check_reach
from rigd_drivers.cards.card import Card
from rigd_drivers.cards.counter import EncoderCounter


class AnalogSpeedServoConfig(AnalogDriveConfig):
    """How speeds and counts are converted, and the largest speed that rigd may set."""

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


class AxisRow(Row):
    """Axis and monitor; the status word of :mod:`rigd_drivers.cards.analog_drive`."""

    position: float
    counts: float
    speed: float
    speed_raw: float
    status: int


class AnalogSpeedServo(AnalogDrive[AnalogSpeedServoConfig]):
    """Sets the speed of a linear axis.

    Safe means 0 V, disabled, the clutch engaged: its spring engages it without power. If the axis
    could coast too far, the drive's own holding brake must stop it.
    """

    Config: ClassVar[type[DriverConfig]] = AnalogSpeedServoConfig
    title: ClassVar[str] = "analogue servo drive in speed mode, on a card"

    def __init__(self, config: AnalogSpeedServoConfig, link: Card) -> None:
        super().__init__(
            config, link, set_scale=config.set_scale, monitor_scale=config.monitor_scale
        )
        self._counter = EncoderCounter(config.encoder, config.fastest)
        distance = config.distance_per_count
        self._distance = -distance if config.encoder_inverted else distance

    @classmethod
    def declare(cls, config: AnalogSpeedServoConfig) -> Declaration:
        """Return axis and monitor as channels, speed and clutch as setpoints."""
        largest = config.speed_range
        speed = Channel("speed", "m/s", "speed of the axis", -largest, largest)
        clutch = Channel("engaged", "1", "clutch: 1 engaged, 0 released (no force)", 0.0, 1.0)
        return Declaration(
            channels=(
                Channel("position", "m", "position of the axis since it was opened"),
                Channel("counts", "count", "encoder counts", raw_of="position"),
                *config.monitor_channels(speed, config.monitor_scale),
            ),
            row=AxisRow,
            setpoints=(speed,) if config.clutch_output is None else (speed, clutch),
        )

    def open(self) -> None:
        """Take the outputs and inputs on the card; the position starts at zero."""
        super().open()
        self._counter.open(self.link, at_zero=True)

    def reserve(self) -> None:
        """See :class:`AnyDriver`: also the output of the clutch, and the encoder."""
        super().reserve()
        if self.config.clutch_output is not None:
            with about_entry("clutch_output"):
                self.link.take_outputs(lines=(self.config.clutch_output,))
        with about_entry("encoder"):
            self.link.use_inputs(encoders=(self.config.encoder,))

    def read(self, t_ns: int) -> AxisRow:
        """Return position, counts, speed, monitor volts and status.

        Raises:
            DeviceError: the drive was enabled, and is not any more; or the count jumped.

        """
        counts = self._counter.take(self.link)
        speed, volts, status = self._monitor()
        return AxisRow.of(
            position=counts * self._distance,
            counts=float(counts),
            speed=speed,
            speed_raw=volts,
            status=status,
        )

    def write(self, setpoints: Sequence[float]) -> None:
        """Demand a speed in m/s and set the clutch (above one half: engaged).

        Raises:
            DeviceError: a setpoint is NaN; those before it hold.

        """
        clutch = self.declaration.setpoints[1:]
        engaged = not clutch or accepted(clutch[0], setpoints[1]) > 0.5
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
