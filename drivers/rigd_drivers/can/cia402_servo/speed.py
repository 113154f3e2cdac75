"""Moves a linear axis, with a belt or a spindle, by a CiA 402 drive in cyclic velocity mode."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, ClassVar, Final

from annotated_types import Ge, Gt, Le

from rigd.sdk import Channel, Declaration, DriverConfig, In, LinkConfig, Row
from rigd_drivers.can.bus import CanBus
from rigd_drivers.can.canopen import objects, pdo
from rigd_drivers.can.canopen.objects import Entry
from rigd_drivers.can.cia402_servo import plan
from rigd_drivers.can.cia402_servo.velocity import VelocityConfig, VelocityServo
from rigd_drivers.can.node import Node

#: Bit of the status of a row, above the drive's statusword: the clutch is commanded to hold.
CLUTCH_ENGAGED: Final = 1 << 16


class SpeedServoConfig(VelocityConfig):
    """How the motor's revolutions become travel of the axis."""

    speed_range: Annotated[float, In("m/s"), Gt(0)]
    """Largest setpoint of either sign."""
    travel: Annotated[float, In("m/rad"), Gt(0)]
    """Travel of the axis per revolution of the motor, through gear and pulley: `40 mm/rev`."""
    force: bool = True
    """Whether the force is measured (objects 6076 and 6077, which some drives lack)."""
    clutch: bool = False
    """Whether a digital output of the drive releases a clutch between belt and axis."""
    clutch_output: Annotated[int, Ge(0), Le(31)] = 16
    """Bit of object 60FE:1 that releases the clutch: 1 is released, 0 is held by its spring."""

    @property
    def lever(self) -> float:
        """Travel of the axis in m per rad of the motor."""
        return self.travel

    @property
    def measures_torque(self) -> bool:
        """Whether the force is measured."""
        return self.force


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


class SpeedServo(VelocityServo[SpeedServoConfig]):
    """Sets the speed of an axis; measures its travel, speed and force at the motor.

    Safe means *switched off with the clutch engaged*: the motor has no torque, and the axis is
    held to the belt, and by the brake that the drive applies when it is off. A released axis would
    run on; so the clutch must be held by its spring without power, as the brake must be.
    """

    Config: ClassVar[type[DriverConfig]] = SpeedServoConfig
    title = "CiA 402 servo drive on CAN, speed mode, linear axis"
    speed_unit, lever_option, torque_option = "m/s", "travel", "force"

    def __init__(self, config: SpeedServoConfig, link: CanBus) -> None:
        super().__init__(config, link)
        self._outputs = plan.outputs(config)
        self._released = False

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
            silent_s=config.silent_s,
            watchdog_s=config.watchdog_s,
            actions=config.actions,
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
        self._send_target(round(speed / self._per_unit))

    def _row(self, values: Sequence[int]) -> AxisRow | MotionRow:
        status, position, velocity = values[0], values[-2], values[-1]
        if not self._released:
            status |= CLUTCH_ENGAGED
        travel = (self._unwrap.follow(position) - self._zero) * self._per_count
        speed = velocity * self._per_unit
        if not self.config.force:
            return MotionRow.of(position=travel, speed=speed, status=status)
        force = values[1] * self._per_mille / self.config.travel
        return AxisRow.of(position=travel, speed=speed, force=force, status=status)

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

    def _put_safe_outputs(self) -> None:
        if self.config.clutch:
            self._release(False)

    def _release(self, released: bool) -> None:
        self._released = released
        word = released << self.config.clutch_output
        self.link.put(self._outputs.identifier, objects.OUTPUTS.pack(word))
