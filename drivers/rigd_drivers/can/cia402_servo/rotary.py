"""Turns a shaft by a CiA 402 drive in cyclic velocity mode."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, ClassVar

from annotated_types import Gt

from rigd.sdk import Channel, Declaration, DriverConfig, In, Row
from rigd_drivers.can.cia402_servo.velocity import VelocityConfig, VelocityServo


class RotaryServoConfig(VelocityConfig):
    """How the motor's revolutions become those of the shaft."""

    speed_range: Annotated[float, In("rad/s"), Gt(0)]
    """Largest setpoint of either sign, at the shaft."""
    gear_ratio: Annotated[float, In("1"), Gt(0)] = 1.0
    """Turns of the motor per turn of the shaft; 1: all is given at the motor."""
    torque: bool = True
    """Whether the torque is measured (objects 6076 and 6077, which some drives lack)."""

    @property
    def lever(self) -> float:
        """Angle of the shaft in rad per rad of the motor."""
        return 1.0 / self.gear_ratio

    @property
    def measures_torque(self) -> bool:
        """Whether the torque is measured."""
        return self.torque


class ShaftRow(Row):
    """The shaft; status: the drive's statusword (object 6041)."""

    angle: float
    speed: float
    torque: float
    status: int


class TurningRow(Row):
    """The same without the torque."""

    angle: float
    speed: float
    status: int


class RotaryServo(VelocityServo[RotaryServoConfig]):
    """Sets the speed of a shaft; measures its angle, speed and torque at the motor.

    Safe means *switched off*: the motor has no torque, and the shaft runs down, or is held by the
    brake that the drive applies when it is off. What a shaft without torque must not do, such as
    let a load fall, needs such a brake.
    """

    Config: ClassVar[type[DriverConfig]] = RotaryServoConfig
    title = "CiA 402 servo drive on CAN, speed mode, rotary"
    speed_unit, lever_option, torque_option = "rad/s", "gear_ratio", "torque"

    @classmethod
    def declare(cls, config: RotaryServoConfig) -> Declaration:
        """Return the shaft as channels, its speed as setpoint."""
        limit = config.speed_range
        torque = (Channel("torque", "N m", "torque of the motor, as of the shaft, without losses"),)
        speed = Channel("speed", "rad/s", "speed of the shaft", -limit, limit)
        return Declaration(
            channels=(
                Channel("angle", "rad", "angle of the shaft, by the motor"),
                Channel("speed", "rad/s", "speed of the shaft, by the motor"),
                *(torque if config.torque else ()),
            ),
            row=ShaftRow if config.torque else TurningRow,
            setpoints=(speed,),
            silent_s=config.silent_s,
            watchdog_s=config.watchdog_s,
            actions=config.actions,
        )

    def write(self, setpoints: Sequence[float]) -> None:
        """Demand a speed in rad/s, once enabled.

        Raises:
            DeviceError: the setpoint is NaN; the one before it holds.

        """
        speed = self.accepted(self.declaration.setpoints[0], setpoints[0])
        self._send_target(round(speed / self._per_unit))

    def _row(self, values: Sequence[int]) -> ShaftRow | TurningRow:
        status, position, velocity = values[0], values[-2], values[-1]
        angle = (self._unwrap.follow(position) - self._zero) * self._per_count
        speed = velocity * self._per_unit
        if not self.config.torque:
            return TurningRow.of(angle=angle, speed=speed, status=status)
        torque = values[1] * self._per_mille * self.config.gear_ratio
        return ShaftRow.of(angle=angle, speed=speed, torque=torque, status=status)
