"""Finds what 1000 per mille of a CiA 402 drive are, from the drive and the rig file together.

Targets and actual values are per mille of a rated torque (6076h) or a rated current (6075h). CiA
402-2 has 6075h in mA and 6076h in mN m. maxon's EPOS4 has 6076h in µN m and further ratings in
3001h (EPOS4 Firmware Specification); other makers keep other data there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from rigd.sdk import ProtocolError
from rigd_drivers.can.canopen import objects
from rigd_drivers.can.cia402_servo.profile import RatedCurrent
from rigd_drivers.can.node import Node

#: Vendor id (1018h:1) of maxon.
MAXON: Final = 0xFB
#: Unit of 6076h, in N m: by CiA 402-2, and of maxon.
TORQUE_UNIT: Final = 1e-3
MAXON_TORQUE_UNIT: Final = 1e-6
#: Unit of 6075h and of 3001h:1, in A.
_CURRENT_UNIT: Final = 1e-3
#: Unit of 3001h:5, in N m/A.
_CONSTANT_UNIT: Final = 1e-6
#: Ratings that differ by less agree: plates round them.
_TOLERANCE: Final = 0.01
#: A unit is advised if it explains a difference as well as this.
_EXPLAINED: Final = 0.05


@dataclass(frozen=True)
class Rating:
    """A rating in SI by one source; ``room`` is what the resolution of the source leaves open.

    ``torque_unit`` is the unit of object 6076 in N m that entered the value; None if none did.
    """

    value: float
    source: str
    room: float = 0.0
    torque_unit: float | None = None

    def agrees_with(self, other: Rating) -> bool:
        """Return whether both may be the same rating."""
        largest = max(self.value, other.value)
        return abs(self.value - other.value) <= _TOLERANCE * largest + self.room + other.room

    def over(self, constant: Rating) -> Rating:
        """Return the current, in A, of this torque with a torque constant in N m/A."""
        value = self.value / constant.value
        room = value * (self.room / self.value + constant.room / constant.value)
        source = f"{self.source} over {constant.source} ({constant.value:.4g} N m/A)"
        return Rating(value, source, room, self.torque_unit)


def rated_torques(node: Node, given: float | None, unit: float | None) -> list[Rating]:
    """Return the rated torque in N m by the rig file (``given``) and by the drive, as far as known.

    ``unit`` is that of object 6076 in N m by the rig file.
    """
    found = [] if given is None else [Rating(given, "`rated_torque`")]
    reported = node.read_optional(objects.RATED_TORQUE)
    if reported:
        used = unit or (MAXON_TORQUE_UNIT if node.vendor == MAXON else TORQUE_UNIT)
        source = f"object 6076 ({reported} x {used:g} N m)"
        found.append(Rating(reported * used, source, used / 2, used))
    return found


def torque_constants(node: Node, given: float | None) -> list[Rating]:
    """Return the torque constant in N m/A by the rig file (``given``) and by a drive of maxon."""
    found = [] if given is None else [Rating(given, "`torque_constant`")]
    if node.vendor == MAXON and (reported := node.read_optional(objects.TORQUE_CONSTANT)):
        value = reported * _CONSTANT_UNIT
        found.append(Rating(value, "object 3001:05", _CONSTANT_UNIT / 2))
    return found


def rated_currents(
    node: Node, given: float | None, chosen: RatedCurrent | None = None
) -> list[Rating]:
    """Return the rated current in A by the rig file (``given``) and by the drive.

    ``chosen`` is the object that the profile of the drive names in place of 6075.
    """
    found = [] if given is None else [Rating(given, "`rated_current`")]
    entries = [(objects.RATED_CURRENT, _CURRENT_UNIT)]
    if chosen is not None:
        entries = [(chosen.entry(objects.RATED_CURRENT.name), chosen.unit)]
    if node.vendor == MAXON:
        entries.append((objects.NOMINAL_CURRENT, _CURRENT_UNIT))
    for entry, unit in entries:
        if reported := node.read_optional(entry):
            where = f"{entry.index:04X}" + (f":{entry.sub:02X}" if entry.sub else "")
            found.append(Rating(reported * unit, f"object {where}", unit / 2))
    return found


def agreed(node: Node, what: str, unit: str, ratings: Sequence[Rating]) -> Rating | None:
    """Return the first of ``ratings``, with which all others agree; None if there is none.

    Raises:
        ProtocolError: two of them contradict each other: every value, and what to write.

    """
    if not ratings:
        return None
    first, *others = ratings
    wrong = next((each for each in others if not each.agrees_with(first)), None)
    if wrong is None:
        return first
    told = ", ".join(f"{each.value:.4g} {unit} by {each.source}" for each in ratings)
    raise ProtocolError(f"{node}: its {what} is contradictory: {told}", hint=_remedy(first, wrong))


def _remedy(first: Rating, wrong: Rating) -> str:
    """Return what to write into the rig file so that two ratings agree."""
    correct = "correct the option that is wrong, or the drive's motor data with the maker's tool"
    suspect = wrong if wrong.torque_unit is not None else first
    if suspect.torque_unit is None:
        return correct
    other = first if suspect is wrong else wrong
    exact = suspect.torque_unit * other.value / suspect.value
    power = 10.0 ** round(math.log10(exact))
    if abs(exact / power - 1) > _EXPLAINED:
        return correct
    return (
        f"if the drive's manual gives object 6076 in units of {power:g} N m, write "
        f"`torque_unit: {power:g} N m`; else {correct}"
    )
