"""Provides the base classes of drivers for CiA 402 drives in cyclic velocity mode."""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Annotated, ClassVar, Final, Self, TypeVar

from annotated_types import Gt
from pydantic import model_validator

from rigd.sdk import In, ProtocolError, wrong_entry
from rigd_drivers.can.bus import CanBus
from rigd_drivers.can.canopen import objects
from rigd_drivers.can.canopen.objects import Entry
from rigd_drivers.can.cia402_servo.config import ServoConfig
from rigd_drivers.can.cia402_servo.profile import MILLI_RPM, Choice, speed_choice
from rigd_drivers.can.cia402_servo.ratings import agreed, rated_torques
from rigd_drivers.can.cia402_servo.servo import Servo
from rigd_drivers.can.node import Node

#: 60A9h: numerator revolutions, and what they are divided by (CiA 303-2, table of SI units).
_REVOLUTION: Final = 0xB4
_PER: Final = {0x03: 1.0, 0x47: 60.0, 0x48: 3600.0}
_UNIT_TOLERANCE: Final = 1e-6


class VelocityConfig(ServoConfig):
    """The unit of the drive's velocities, and how they become that of what moves."""

    speed_range: Annotated[float, Gt(0)]
    """Largest setpoint of either sign."""
    velocity_unit: Annotated[float, In("rad/s"), Gt(0)] | None = None
    """Unit of the drive's velocities (objects 606C, 60FF); checked against object 60A9. None: as
    `profile` has it, else 0.001 rpm, which object 60A9 must confirm."""

    @property
    @abstractmethod
    def lever(self) -> float:
        """What moves per rad of the motor: m for an axis, rad for a shaft."""

    @property
    @abstractmethod
    def measures_torque(self) -> bool:
        """Whether the torque is measured (objects 6076 and 6077)."""

    @model_validator(mode="after")
    def _has_the_mode(self) -> Self:
        if self.profile is None:
            return self
        if self.profile.speed is None:
            raise wrong_entry(
                f"the profile of the {self.profile.title} has no velocity mode: use the driver "
                "cia402-current, or another profile",
                "profile",
            )
        if self.velocity_unit is None and self._profiled_unit() is None:
            raise wrong_entry(
                f"the profile of the {self.profile.title} does not state the unit of velocities: "
                "give 'velocity_unit', from the drive's manual, such as '1 rpm'",
                "profile",
            )
        return self

    def _profiled_unit(self) -> float | None:
        mode = None if self.profile is None else self.profile.speed
        return None if mode is None else mode.unit(self.counts_per_revolution)

    @property
    def given_unit(self) -> float | None:
        """Unit of the drive's velocities in rad/s, as far as rig file or profile know it."""
        return self.velocity_unit or self._profiled_unit()

    @property
    def unit(self) -> float:
        """The same; 0.001 rpm if they do not."""
        return self.given_unit or MILLI_RPM

    def choice(self) -> Choice:
        """Return the mode of operation and its objects."""
        return speed_choice(None if self.profile is None else self.profile.speed)

    def torque_object(self) -> Entry:
        """Return the object of the actual torque."""
        mode = None if self.profile is None else self.profile.torque
        chosen = None if mode is None else mode.actual
        return objects.TORQUE if chosen is None else chosen.entry(objects.TORQUE.name)


VelocityConfigT = TypeVar("VelocityConfigT", bound=VelocityConfig)


class VelocityServo(Servo[VelocityConfigT]):
    """A drive that holds speeds; torque and speed are measured at the motor."""

    range_option = "speed_range"
    #: Unit of setpoint and measured speed, and the options of lever and torque, for messages.
    speed_unit: ClassVar[str]
    lever_option: ClassVar[str]
    torque_option: ClassVar[str]

    def __init__(self, config: VelocityConfigT, link: CanBus) -> None:
        super().__init__(config, link)
        #: Travel or angle per count, speed per unit of velocity, torque in N m per mille.
        self._per_count = self._sign * config.lever / config.counts_per_revolution
        self._per_unit = self._sign * config.lever * config.unit
        self._per_mille = float("nan")

    @classmethod
    def _feedback(cls, config: VelocityConfigT) -> tuple[tuple[Entry, ...], ...]:
        torque = (config.torque_object(),) if config.measures_torque else ()
        return (objects.STATUSWORD, *torque, objects.POSITION), (config.choice().actual,)

    @classmethod
    def _choose(cls, config: VelocityConfigT) -> Choice:
        return config.choice()

    @classmethod
    def _declared_target(cls, config: VelocityConfigT) -> int:
        return round(config.speed_range / (config.lever * config.unit))

    def _largest_target(self) -> int:
        return self._declared_target(self.config)

    def _check_ratings(self, node: Node) -> str:
        scaling = self._check_torque(node) if self.config.measures_torque else ""
        self._check_velocity_unit(node)
        largest = (1 << 8 * self._choice.target.size - 1) - 1
        reach = self.config.lever * self.config.unit * largest
        if self.config.speed_range > reach:
            raise ProtocolError(
                f"{node} takes at most {reach:.3g} {self.speed_unit} in units of `velocity_unit`, "
                f"`speed_range` is {self.config.speed_range:g} {self.speed_unit}",
                hint=f"correct `velocity_unit`, `{self.lever_option}` or `speed_range`",
            )
        return scaling

    def _check_torque(self, node: Node) -> str:
        config = self.config
        torques = rated_torques(node, config.rated_torque, config.unit_of_6076)
        rating = agreed(node, "rated torque", "N m", torques)
        if rating is None:
            raise ProtocolError(
                f"{node} does not report its rated torque (object 6076), of which its torque is "
                "per mille",
                hint="give `rated_torque`, from the motor's plate, or "
                f"`{self.torque_option}: false`",
            )
        self._per_mille = self._sign * rating.value / 1000
        return f"1000 per mille = {rating.value:.4g} N m by {rating.source}"

    def _check_velocity_unit(self, node: Node) -> None:
        code = node.read_optional(objects.VELOCITY_UNIT)
        if not code and self.config.given_unit is None:
            raise ProtocolError(
                f"{node} does not report the unit of its velocities (object 60A9), and it differs "
                "between makers",
                hint="give `velocity_unit`, from the drive's manual, such as '1 rpm'",
            )
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
