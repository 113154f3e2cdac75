"""Simulates the relay between voltage regulator and motor of the approach-angle rig."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from rigd.sdk import Channel, Declaration, DeviceError, Driver, DriverConfig, Row, accepted
from rigd_sim.approach_angle.plant import AnglePlant


class RelayRow(Row):
    """The contact of the relay."""

    closed: float


class AngleRelay(Driver[DriverConfig, AnglePlant]):
    """Connects the motor to its voltage; safe means open: the motor coasts, nothing brakes."""

    title: ClassVar[str] = "relay of the simulated approach-angle rig"

    def __init__(self, config: DriverConfig, link: AnglePlant) -> None:
        super().__init__(config, link)
        self._armed = False

    @classmethod
    def declare(cls, config: DriverConfig) -> Declaration:
        """Return the contact as channel, the relay as setpoint."""
        return Declaration(
            channels=(Channel("closed", "1", "contact: 1 conducts, 0 open", 0.0, 1.0),),
            row=RelayRow,
            setpoints=(Channel("closed", "1", "relay: 1 closed, 0 open", 0.0, 1.0),),
        )

    def open(self) -> None:
        """Do nothing: the plant stands as soon as the rig does."""

    def arm(self) -> None:
        """Take setpoints from now on."""
        self._armed = True

    def read(self, t_ns: int) -> RelayRow:
        """Return whether the contact conducts; it follows the command late, and bounces."""
        self.link.advance(t_ns)
        return RelayRow.of(closed=float(self.link.closed))

    def write(self, setpoints: Sequence[float]) -> None:
        """Close from 0.5 on, open below; ignored until armed.

        Raises:
            DeviceError: the setpoint is NaN, or the friction of what is set up is not known; the
                setpoint before it holds.

        """
        closed = accepted(self.declaration.setpoints[0], setpoints[0]) >= 0.5
        if not self._armed:
            return
        try:
            self.link.command(closed)
        except ValueError as error:
            raise DeviceError(str(error), hint="mount a published combination") from error

    def make_safe(self) -> None:
        """Open the relay and take no more setpoints."""
        self._armed = False
        self.link.command(False)

    def close(self) -> None:
        """Leave it safe: there is nothing to close, and opened again it is not armed."""
        self.make_safe()
