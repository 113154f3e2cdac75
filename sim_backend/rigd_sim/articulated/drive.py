"""Simulates the drives of the articulated robot: motors under speed control."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, ClassVar, Literal

from annotated_types import Gt, Le

from rigd.sdk import Channel, Declaration, Driver, DriverConfig, In, ProtocolError, Row, accepted
from rigd_sim.articulated.plant import ArticulatedPlant


class DriveConfig(DriverConfig):
    """Which motor it is, and the largest speed that rigd may set."""

    module: str
    """Name of the module in the parameter file."""
    wheel: Literal["front_right", "front_left", "rear_right", "rear_left"]
    """The wheel that the motor turns; of a geared pair either one."""
    speed_range: Annotated[float, In("rad/s"), Gt(0), Le(5000)] = 550.0
    """Largest setpoint of either sign, at the motor."""
    torque_range: Annotated[float, In("N m"), Gt(0), Le(1000)] = 0.1
    """Largest torque that the drive can report, of either sign, at the motor."""


class DriveRow(Row):
    """The motor."""

    speed: float
    torque: float


class ArticulatedDrive(Driver[DriveConfig, ArticulatedPlant]):
    """A motor under speed control, with torque and speed feedback, all on the motor's side.

    Safe means without torque: the robot rolls on until rolling resistance has stopped it. Until
    armed the drive is in that state too.
    """

    Config: ClassVar[type[DriverConfig]] = DriveConfig
    title: ClassVar[str] = "drive of the simulated articulated robot, speed mode"

    def __init__(self, config: DriveConfig, link: ArticulatedPlant) -> None:
        super().__init__(config, link)
        self._spin = 0
        self._enabled = False

    @classmethod
    def declare(cls, config: DriveConfig) -> Declaration:
        """Return speed and torque of the motor, and the speed as setpoint."""
        speed, torque = config.speed_range, config.torque_range
        return Declaration(
            channels=(
                Channel("speed", "rad/s", "speed of the motor", -2 * speed, 2 * speed),
                Channel("torque", "N m", "torque of the motor", -torque, torque),
            ),
            row=DriveRow,
            setpoints=(Channel("speed", "rad/s", "speed of the motor", -speed, speed),),
        )

    def open(self) -> None:
        """Find the motor.

        Raises:
            ProtocolError: the robot has no such module, or no motor at this wheel.

        """
        try:
            self._spin = self.link.spin_of(self.config.module, self.config.wheel)
        except ValueError as error:
            raise ProtocolError(str(error), hint="the parameter file lists the modules") from error
        self.identity = f"simulated drive, {self.link.laws}"

    def arm(self) -> None:
        """Hold the motor at speed zero from now on."""
        self._enabled = True
        self.link.commands[self._spin] = 0.0, 1.0

    def read(self, t_ns: int) -> DriveRow:
        """Return speed and torque."""
        speed, torque = self.link.motors_at(t_ns)[self._spin].tolist()
        return DriveRow.of(speed=speed, torque=torque)

    def write(self, setpoints: Sequence[float]) -> None:
        """Set the motor's speed in rad/s; ignored until armed.

        Raises:
            DeviceError: the setpoint is NaN; the one before it holds.

        """
        speed = accepted(self.declaration.setpoints[0], setpoints[0])
        if self._enabled:
            self.link.commands[self._spin, 0] = speed

    def make_safe(self) -> None:
        """Take the torque off; take no more setpoints."""
        self._enabled = False
        self.link.commands[self._spin] = 0.0

    def close(self) -> None:
        """Leave it safe: there is nothing to close, and opened again it is not armed."""
        self.make_safe()
