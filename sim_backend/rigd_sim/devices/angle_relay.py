"""The relay between voltage regulator and motor of the simulated approach-angle rig."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from rigd.sdk import Channel, DeviceError, Driver, DriverConfig, accepted
from rigd_sim.plants.angle.plant import AnglePlant


class AngleRelay(Driver):
    """Puts the motor on its voltage; safe means open: the motor coasts, nothing brakes."""

    title: ClassVar[str] = "relay of the simulated approach-angle rig"
    setpoints = (Channel("closed", "1", "relay: 1 closed, 0 open", 0.0, 1.0),)
    channels = (Channel("closed", "1", "contact: 1 conducts, 0 open", 0.0, 1.0),)
    link: AnglePlant

    def __init__(self, config: DriverConfig, link: AnglePlant | None) -> None:
        super().__init__(config, link)
        self._armed = False

    def open(self) -> None:
        """Do nothing: the plant stands as soon as the rig does."""

    def arm(self) -> None:
        """Take setpoints from now on."""
        self._armed = True

    def read(self, t_ns: int) -> Sequence[float]:
        """Return whether the contact conducts; it follows the command late, and bounces."""
        self.link.advance(t_ns)
        return (float(self.link.closed),)

    def write(self, setpoints: Sequence[float]) -> None:
        """Close from 0.5 on, open below; ignored until armed.

        Raises:
            DeviceError: the setpoint is NaN, or the friction of what is set up is not known; the
                setpoint before it holds.

        """
        closed = accepted(self.setpoints[0], setpoints[0]) >= 0.5
        if not self._armed:
            return
        try:
            self.link.command(closed)
        except ValueError as error:
            raise DeviceError(str(error), hint="mount a published combination") from error

    def make_safe(self) -> None:
        """Open the relay and take no more setpoints."""
        self._armed = False
        if self.link is not None:
            self.link.command(False)
