"""Moves a linear axis, with a belt or a spindle, by a CiA 402 drive in cyclic velocity mode."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, ClassVar, Final, Self

from annotated_types import Ge, Gt, Le
from pydantic import model_validator

from rigd.sdk import Channel, Declaration, DriverConfig, In, LinkConfig, ProtocolError, Row
from rigd_drivers.can_bus import CanBus
from rigd_drivers.can_node import Node
from rigd_drivers.canopen import objects, pdo
from rigd_drivers.canopen.objects import Entry
from rigd_drivers.cia402_servo import plan
from rigd_drivers.cia402_servo.config import ServoConfig
from rigd_drivers.cia402_servo.profile import MILLI_RPM, Choice, speed_choice
from rigd_drivers.cia402_servo.ratings import agreed, rated_torques
from rigd_drivers.cia402_servo.servo import Servo

#: 606Ch and 60FFh have 32 bits with sign.
_LARGEST: Final = (1 << 31) - 1
#: Bit of the status of a row, above the drive's statusword: the clutch is commanded to hold.
CLUTCH_ENGAGED: Final = 1 << 16
#: 60A9h: numerator revolutions, and what they are divided by (CiA 303-2, table of SI units).
_REVOLUTION: Final = 0xB4
_PER: Final = {0x03: 1.0, 0x47: 60.0, 0x48: 3600.0}
_UNIT_TOLERANCE: Final = 1e-6


class SpeedServoConfig(ServoConfig):
    """How the motor's revolutions become travel of the axis."""

    speed_range: Annotated[float, In("m/s"), Gt(0)]
    """Largest setpoint of either sign."""
    travel: Annotated[float, In("m/rad"), Gt(0)]
    """Travel of the axis per revolution of the motor, through gear and pulley: `40 mm/rev`."""
    velocity_unit: Annotated[float, In("rad/s"), Gt(0)] | None = None
    """Unit of the drive's velocities (objects 606C, 60FF); checked against object 60A9. None: as
    `profile` has it, 0.001 rpm without one."""
    force: bool = True
    """Whether the force is measured (objects 6076 and 6077, which some drives lack)."""
    clutch: bool = False
    """Whether a digital output of the drive releases a clutch between belt and axis."""
    clutch_output: Annotated[int, Ge(0), Le(31)] = 16
    """Bit of object 60FE:1 that releases the clutch: 1 is released, 0 is held by its spring."""

    @model_validator(mode="after")
    def _has_the_mode(self) -> Self:
        if self.profile is None:
            return self
        if self.profile.speed is None:
            raise ValueError(
                f"the profile of the {self.profile.title} has no velocity mode: use the driver "
                "cia402-current, or another profile"
            )
        if self.velocity_unit is None and self._profiled_unit() is None:
            raise ValueError(
                f"the profile of the {self.profile.title} does not state the unit of velocities: "
                "give 'velocity_unit', from the drive's manual, such as '1 rpm'"
            )
        return self

    def _profiled_unit(self) -> float | None:
        mode = None if self.profile is None else self.profile.speed
        return None if mode is None else mode.unit(self.counts_per_revolution)

    @property
    def unit(self) -> float:
        """Unit of the drive's velocities in rad/s."""
        return self.velocity_unit or self._profiled_unit() or MILLI_RPM

    def choice(self) -> Choice:
        """Return the mode of operation and its objects."""
        return speed_choice(None if self.profile is None else self.profile.speed)

    def torque_object(self) -> Entry:
        """Return the object of the actual torque."""
        mode = None if self.profile is None else self.profile.torque
        chosen = None if mode is None else mode.actual
        return objects.TORQUE if chosen is None else chosen.entry(objects.TORQUE.name)


class AxisRow(Row):
    """The axis; status: the drive's statusword (object 6041) and :data:`CLUTCH_ENGAGED`."""

    position: float
    speed: float
    force: float
    status: int


class MotionRow(Row):
    """The same without the force."""

    position: float
    speed: float
    status: int


class SpeedServo(Servo[SpeedServoConfig]):
    """Sets the speed of an axis; measures its travel, speed and force at the motor.

    Safe means *switched off with the clutch engaged*: the motor has no torque, and the axis is
    held to the belt, and by the brake that the drive applies when it is off. A released axis would
    run on; so the clutch must be held by its spring without power, as the brake must be.
    """

    Config: ClassVar[type[DriverConfig]] = SpeedServoConfig
    title = "CiA 402 servo drive on CAN, speed mode, linear axis"
    range_option = "speed_range"

    def __init__(self, config: SpeedServoConfig, link: CanBus) -> None:
        super().__init__(config, link)
        self._outputs = plan.outputs(config)
        self._released = False
        self._metres = self._sign * config.travel / config.counts_per_revolution
        self._metres_per_s = self._sign * config.travel * config.unit
        self._newtons = float("nan")

    @classmethod
    def declare(cls, config: SpeedServoConfig) -> Declaration:
        """Return the axis as channels, speed and clutch as setpoints."""
        limit = config.speed_range
        force = (Channel("force", "N", "force of the motor on the axis, by its torque"),)
        speed = Channel("speed", "m/s", "speed of the axis", -limit, limit)
        clutch = Channel("engaged", "1", "clutch: 1 engaged, 0 released (no force)", 0.0, 1.0)
        return Declaration(
            channels=(
                Channel("position", "m", "travel of the axis, by the motor"),
                Channel("speed", "m/s", "speed of the axis, by the motor"),
                *(force if config.force else ()),
            ),
            row=AxisRow if config.force else MotionRow,
            setpoints=(speed, clutch) if config.clutch else (speed,),
            watchdog_s=config.watchdog_s,
        )

    def arm(self) -> None:
        """Begin to enable the drive at standstill, with the clutch engaged."""
        super().arm()
        self._release(False)

    def write(self, setpoints: Sequence[float]) -> None:
        """Demand a speed in m/s and the clutch (above one half: engaged), once enabled.

        Raises:
            DeviceError: a setpoint is NaN; those before it hold.

        """
        declared = self.declaration.setpoints
        speed = self.accepted(declared[0], setpoints[0])
        if self.config.clutch:
            engaged = self.accepted(declared[1], setpoints[1]) > 0.5
            released = self._enabled and not engaged
            if released is not self._released:
                self._release(released)
        self._send_target(round(speed / self._metres_per_s))

    def _row(self, values: Sequence[int]) -> AxisRow | MotionRow:
        status, position, velocity = values[0], values[-2], values[-1]
        if not self._released:
            status |= CLUTCH_ENGAGED
        travel = (self._unwrap.follow(position) - self._zero) * self._metres
        speed = velocity * self._metres_per_s
        if not self.config.force:
            return MotionRow.of(position=travel, speed=speed, status=status)
        force = values[1] * self._newtons
        return AxisRow.of(position=travel, speed=speed, force=force, status=status)

    @classmethod
    def _feedback(cls, config: SpeedServoConfig) -> tuple[tuple[Entry, ...], ...]:
        torque = (config.torque_object(),) if config.force else ()
        return (objects.STATUSWORD, *torque, objects.POSITION), (config.choice().actual,)

    @classmethod
    def _choose(cls, config: SpeedServoConfig) -> Choice:
        return config.choice()

    @classmethod
    def _pdos(cls, config: SpeedServoConfig) -> tuple[pdo.Pdo, ...]:
        pdos = super()._pdos(config)
        return (*pdos, plan.outputs(config)) if config.clutch else pdos

    def _map(self, node: Node) -> None:
        super()._map(node)
        if self.config.clutch:
            node.ensure_optional(objects.OUTPUTS_MASK, 1 << self.config.clutch_output)
            node.ensure(objects.OUTPUTS, 0)
            self._released = False

    @classmethod
    def _writes(cls, config: SpeedServoConfig, link: LinkConfig | None) -> list[tuple[Entry, int]]:
        writes = super()._writes(config, link)
        return [*writes, (objects.OUTPUTS, 0)] if config.clutch else writes

    @classmethod
    def _declared_target(cls, config: SpeedServoConfig) -> int:
        return round(config.speed_range / (config.travel * config.unit))

    def _largest_target(self) -> int:
        return self._declared_target(self.config)

    def _check_ratings(self, node: Node) -> str:
        scaling = self._check_force(node) if self.config.force else ""
        self._check_velocity_unit(node)
        reach = abs(self._metres_per_s) * _LARGEST
        if self.config.speed_range > reach:
            raise ProtocolError(
                f"{node} takes at most {reach:.3g} m/s in units of `velocity_unit`, `speed_range` "
                f"is {self.config.speed_range:g} m/s",
                hint="correct `velocity_unit`, `travel` or `speed_range`",
            )
        return scaling

    def _check_force(self, node: Node) -> str:
        config = self.config
        torques = rated_torques(node, config.rated_torque, config.unit_of_6076)
        rating = agreed(node, "rated torque", "N m", torques)
        if rating is None:
            raise ProtocolError(
                f"{node} does not report its rated torque (object 6076), of which its torque is "
                "per mille",
                hint="give `rated_torque`, from the motor's plate, or `force: false`",
            )
        self._newtons = self._sign * rating.value / 1000 / config.travel
        return f"1000 per mille = {rating.value:.4g} N m by {rating.source}"

    def _check_velocity_unit(self, node: Node) -> None:
        code = node.read_optional(objects.VELOCITY_UNIT)
        if not code:
            return  # older drives have one unit only, that of their manual
        unit = velocity_unit(code)
        if unit is None or abs(unit / self.config.unit - 1) > _UNIT_TOLERANCE:
            found = "unknown" if unit is None else f"{unit * 60 / (2 * math.pi):g} rpm"
            raise ProtocolError(
                f"{node} gives velocities in units of {found} (object 60A9 is 0x{code:08X}), the "
                f"rig file has {self.config.unit * 60 / (2 * math.pi):g} rpm",
                hint="correct `velocity_unit`, or object 60A9 with the maker's tool",
            )

    def _put_safe_outputs(self) -> None:
        if self.config.clutch:
            self._release(False)

    def _release(self, released: bool) -> None:
        self._released = released
        word = released << self.config.clutch_output
        self.link.put(self._outputs.identifier, objects.OUTPUTS.pack(word))


def velocity_unit(code: int) -> float | None:
    """Return the velocity, in rad/s, that object 60A9 gives as unit; None if not revolutions.

    Bytes from the top: prefix as a power of ten (FDh is 10^-3), numerator, denominator, reserved
    (CiA 402-2, object 60A9h; codes in CiA 303-2).
    """
    exponent, numerator, denominator, _ = code.to_bytes(4, "big")
    if numerator != _REVOLUTION or denominator not in _PER:
        return None
    power = exponent - 256 if exponent > 127 else exponent
    return float(10.0**power * 2 * math.pi / _PER[denominator])
