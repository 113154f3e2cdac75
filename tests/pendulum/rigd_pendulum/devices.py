"""What stands on the simulated pendulum: a clamp that holds it at an angle, and an encoder."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from rigd.sdk import Channel, Declaration, Driver, DriverConfig, PlantSensor, Row
from rigd_pendulum.plant import PendulumPlant


class ClampConfig(DriverConfig):
    """No options."""


class ClampRow(Row):
    """Whether the clamp holds."""

    held: float


class Clamp(Driver[ClampConfig, PendulumPlant]):
    """Brings the pendulum to an angle and releases it; safe means held at its present angle."""

    Config: ClassVar[type[DriverConfig]] = ClampConfig
    title: ClassVar[str] = "clamp of the simulated pendulum"

    @classmethod
    def declare(cls, config: ClampConfig) -> Declaration:
        """Return whether it holds, angle and clamp as setpoints."""
        return Declaration(
            channels=(Channel("held", "1", "1 while it holds", 0.0, 1.0),),
            row=ClampRow,
            setpoints=(
                Channel("angle", "rad", "where it holds the pendulum", -1.5, 1.5),
                Channel("closed", "1", "1 holds, 0 lets go", 0.0, 1.0),
            ),
        )

    def open(self) -> None:
        """Do nothing: the plant stands as soon as the rig does."""

    def arm(self) -> None:
        """Hold until the first setpoint."""
        self.link.clamped = True

    def read(self, t_ns: int) -> ClampRow:
        """Return whether it holds."""
        self.link.advance(t_ns)
        return ClampRow.of(held=float(self.link.clamped))

    def write(self, setpoints: Sequence[float]) -> None:
        """Set the angle in rad, and close above one half."""
        self.link.clamp_at = setpoints[0]
        self.link.clamped = setpoints[1] > 0.5

    def make_safe(self) -> None:
        """Hold the pendulum at its present angle."""
        self.link.clamp_at = self.link.angle
        self.link.clamped = True


class EncoderConfig(DriverConfig):
    """No options."""


class EncoderRow(Row):
    """The angle as the encoder shows it."""

    angle: float


class Encoder(PlantSensor[EncoderConfig, PendulumPlant]):
    """Shows the angle; moves nothing."""

    Config: ClassVar[type[DriverConfig]] = EncoderConfig
    title: ClassVar[str] = "encoder of the simulated pendulum"

    @classmethod
    def declare(cls, config: EncoderConfig) -> Declaration:
        """Return the angle."""
        channel = Channel("angle", "rad", "from where it hangs", -4.0, 4.0)
        return Declaration(channels=(channel,), row=EncoderRow)

    def read(self, t_ns: int) -> EncoderRow:
        """Return the angle."""
        self.link.advance(t_ns)
        return EncoderRow.of(angle=self.link.shown())
