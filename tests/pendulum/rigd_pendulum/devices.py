"""What stands on the simulated pendulum: a clamp that holds it at an angle, and an encoder."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from rigd.sdk import Channel, Driver, DriverConfig, PlantSensor
from rigd_pendulum.plant import PendulumPlant


class ClampConfig(DriverConfig):
    """No options."""


class Clamp(Driver):
    """Brings the pendulum to an angle and lets it go; safe means held where it hangs."""

    Config: ClassVar[type[DriverConfig]] = ClampConfig
    title: ClassVar[str] = "clamp of the simulated pendulum"
    setpoints = (
        Channel("angle", "rad", "where it holds the pendulum", -1.5, 1.5),
        Channel("closed", "1", "1 holds, 0 lets go", 0.0, 1.0),
    )
    channels = (Channel("held", "1", "1 while it holds", 0.0, 1.0),)
    link: PendulumPlant

    def open(self) -> None:
        """Do nothing: the plant stands as soon as the rig does."""

    def arm(self) -> None:
        """Hold until the first setpoint."""
        self.link.clamped = True

    def read(self, t_ns: int) -> Sequence[float]:
        """Return whether it holds."""
        self.link.advance(t_ns)
        return (float(self.link.clamped),)

    def write(self, setpoints: Sequence[float]) -> None:
        """Set the angle in rad, and close above one half."""
        self.link.clamp_at = setpoints[0]
        self.link.clamped = setpoints[1] > 0.5

    def make_safe(self) -> None:
        """Catch the pendulum where it is."""
        if self.link is not None:
            self.link.clamp_at = self.link.angle
            self.link.clamped = True


class EncoderConfig(DriverConfig):
    """No options."""


class Encoder(PlantSensor):
    """Shows the angle; moves nothing."""

    Config: ClassVar[type[DriverConfig]] = EncoderConfig
    title: ClassVar[str] = "encoder of the simulated pendulum"
    channels = (Channel("angle", "rad", "from where it hangs", -4.0, 4.0),)
    link: PendulumPlant

    def read(self, t_ns: int) -> Sequence[float]:
        """Return the angle."""
        self.link.advance(t_ns)
        return (self.link.shown(),)
