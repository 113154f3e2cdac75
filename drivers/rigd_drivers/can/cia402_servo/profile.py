"""Describes a make of CiA 402 drive as data: modes, objects, units and PDOs.

Without a profile a drive is taken to be as CiA 402-2 has it: the cyclic modes and their objects.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Final, Literal, Self

from annotated_types import Gt, MaxLen, MinLen
from pydantic import model_validator

from rigd.sdk import Documented, In, wrong_entry
from rigd_drivers.can.canopen import objects
from rigd_drivers.can.canopen.cia402 import Mode
from rigd_drivers.can.canopen.objects import Entry
from rigd_drivers.can.profile import NodeProfile, ObjectChoice, PdoChoice, distinct

#: Unit of velocities (606Ch, 60FFh) if nothing else is known: 0.001 rpm, in rad/s.
MILLI_RPM: Final = 2 * math.pi / 60 * 1e-3
#: What a frame of 8 bytes has room for beside statusword (2) and position (4).
_MEASURED_BYTES: Final = 2


@dataclass(frozen=True)
class Choice:
    """What a driver sets up: the mode, the object of its target, and that of its actual value."""

    mode: Mode
    target: Entry
    actual: Entry
    follows_bit: bool


class ModeProfile(Documented):
    """A mode of operation."""

    mode: Literal["cyclic", "profile"] = "cyclic"
    """The cyclic synchronous mode (9 or 10), or the profile mode (3 or 4) of drives without it."""
    target: ObjectChoice | None = None
    """Object of the target; none: 6071:00 for torque, 60FF:00 for velocity."""
    actual: ObjectChoice | None = None
    """Object of the actual value; none: 6077:00 for torque, 606C:00 for velocity."""
    follows_bit: bool | None = None
    """Whether bit 12 of the statusword shows that the drive follows; none: in the cyclic mode."""

    @model_validator(mode="after")
    def _has_a_sign(self) -> Self:
        for key, found in (("target", self.target), ("actual", self.actual)):
            if found is not None and found.type.startswith("u"):
                raise wrong_entry(
                    f"'{key}' {found.object} is of type {found.type}, which has no sign: a drive "
                    "goes both ways",
                    key,
                    "type",
                )
        return self

    def choose(self, modes: tuple[Mode, Mode], target: Entry, actual: Entry) -> Choice:
        """Return what to set up; ``modes`` are the cyclic one and the profile one."""
        cyclic = self.mode == "cyclic"
        follows = cyclic if self.follows_bit is None else self.follows_bit
        return Choice(
            modes[0] if cyclic else modes[1],
            target if self.target is None else self.target.entry(target.name),
            actual if self.actual is None else self.actual.entry(actual.name),
            follows,
        )


class TorqueMode(ModeProfile):
    """How the drive takes torque, in per mille of its rating."""

    measured: Literal["torque", "current"] = "torque"
    """What the drive measures: `torque` is object 6077, `current` object 6078, both per mille."""

    @model_validator(mode="after")
    def _fits_a_frame(self) -> Self:
        if self.actual is not None and self.actual.entry("").size > _MEASURED_BYTES:
            raise wrong_entry(
                f"object {self.actual.object} of type {self.actual.type} does not fit a PDO beside "
                "statusword and position: it may have 16 bits",
                "actual",
                "type",
            )
        return self


class SpeedMode(ModeProfile):
    """How the drive takes velocity."""

    velocity_unit: Annotated[float, In("rad/s"), Gt(0)] | None = None
    """Unit of its velocities, if it is one of angle."""
    velocity_counts: Annotated[float, In("count/s"), Gt(0)] | None = None
    """Unit of its velocities, if it is one of counts of the position (object 6064)."""

    @model_validator(mode="after")
    def _one_unit(self) -> Self:
        if self.velocity_unit is not None and self.velocity_counts is not None:
            raise wrong_entry(
                "give 'velocity_unit' or 'velocity_counts', not both", "velocity_counts"
            )
        return self

    def unit(self, counts_per_radian: float) -> float | None:
        """Return the unit of velocities in rad/s; None if it is not known."""
        if self.velocity_counts is not None:
            return self.velocity_counts / counts_per_radian
        return self.velocity_unit


class RatedCurrent(ObjectChoice):
    """The object that holds the current at 1000 per mille."""

    unit: Annotated[float, In("A"), Gt(0)]
    """Its unit."""


class DrivePdos(Documented):
    """Which PDOs carry the targets, the digital outputs and what the drive measures."""

    command: PdoChoice = PdoChoice(number=1, cob_id=0x200)
    """RPDO with controlword and target."""
    outputs: PdoChoice = PdoChoice(number=2, cob_id=0x300)
    """RPDO with the digital outputs, if they are used."""
    feedback: Annotated[tuple[PdoChoice, ...], MinLen(2), MaxLen(2)] = (
        PdoChoice(number=1, cob_id=0x180),
        PdoChoice(number=2, cob_id=0x280),
    )
    """The two TPDOs with what the drive measures."""

    @model_validator(mode="after")
    def _differ(self) -> Self:
        distinct([self.command, self.outputs], "RPDOs", [("command",), ("outputs",)])
        feedback: list[tuple[str | int, ...]] = [
            ("feedback", place) for place in range(len(self.feedback))
        ]
        distinct(self.feedback, "TPDOs", feedback)
        ids = [each.cob_id for each in (self.command, self.outputs, *self.feedback)]
        paths: list[tuple[str | int, ...]] = [("command",), ("outputs",), *feedback]
        for place, each in enumerate(ids):
            if each in ids[:place]:
                known = ", ".join(map(hex, ids))
                raise wrong_entry(
                    f"two PDOs have the same cob_id: {known}", *paths[place], "cob_id"
                )
        return self


class DriveProfile(NodeProfile):
    """What rigd must know of a make of CiA 402 drive beyond the standard."""

    torque: TorqueMode | None = None
    """For `cia402-current`; none: it has no mode for it."""
    speed: SpeedMode | None = None
    """For `cia402-speed`; none: it has no mode for it."""
    rated_current: RatedCurrent | None = None
    """Object of the current at 1000 per mille; none: 6075:00, whose unit the drive must confirm."""
    torque_unit: Annotated[float, In("N m"), Gt(0)] | None = None
    """Unit of the motor rated torque (object 6076)."""
    homing: Literal[35, 37] | None = None
    """Homing method of the action `home`: 37, or 35 of older drives; none: it has no such action.
    Both set the position where the drive stands to 0. rigd uses no method that moves."""
    pdos: DrivePdos = DrivePdos()
    """Its PDOs, as CiA 301 has them unless given."""


def torque_choice(mode: TorqueMode | None, measured: str) -> Choice:
    """Return what to set up for torque, with the actual value that ``measured`` names."""
    actual = objects.TORQUE if measured == "torque" else objects.CURRENT
    modes = (Mode.CYCLIC_TORQUE, Mode.PROFILE_TORQUE)
    return (mode or TorqueMode()).choose(modes, objects.TARGET_TORQUE, actual)


def speed_choice(mode: SpeedMode | None) -> Choice:
    """Return what to set up for velocity."""
    modes = (Mode.CYCLIC_VELOCITY, Mode.PROFILE_VELOCITY)
    return (mode or SpeedMode()).choose(modes, objects.TARGET_VELOCITY, objects.VELOCITY)
