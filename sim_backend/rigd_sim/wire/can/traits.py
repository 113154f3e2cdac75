"""Describes what a make of drive is like at the wire, as data, for the simulated drive.

The files in ``makes`` are written from the makers' documents, and not from what the drivers of rigd
know of them: a mistake of the one shall not be hidden by the other.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Final, Literal, Self

from annotated_types import Ge, Gt, Le, MinLen
from pydantic import StringConstraints, model_validator

from rigd.model.errors import ConfigError
from rigd.model.units import parse_quantity
from rigd.sdk import Documented, In, wrong_entry
from rigd.sdk.parameters import load_parameters
from rigd_sim.wire.can.canopen.dictionary import Dictionary, Entry, Kind

_FOLDER: Final = Path(__file__).parent / "makes"
_KINDS: Final = {
    "int8": Kind.I8, "uint8": Kind.U8, "int16": Kind.I16, "uint16": Kind.U16,
    "int32": Kind.I32, "uint32": Kind.U32,
}  # fmt: skip

Unsigned32 = Annotated[int, Ge(0), Le(0xFFFF_FFFF)]
Address = Annotated[str, StringConstraints(pattern=r"^[0-9A-F]{4}:[0-9A-F]{2}$")]
#: What is known of the motor, in SI: A, A, N m/A, N m.
Quantity = Literal["nominal_current", "current_limit", "torque_constant", "rated_torque"]


class OwnObject(Documented):
    """An object that the make has, or has otherwise than the standard."""

    object: Address
    """Index and sub-index in hexadecimal, as in 3001:01."""
    type: Literal["int8", "uint8", "int16", "uint16", "int32", "uint32"]
    """Type of its value."""
    value: int = 0
    """Its value at power-on."""
    quantity: Quantity | None = None
    """What of the motor it holds, in place of a value."""
    unit: str = "1"
    """Unit of the quantity, as in 1 mA."""
    writable: bool = False
    """Whether an SDO may write it."""
    mappable: bool = False
    """Whether a PDO can carry it."""

    @model_validator(mode="after")
    def _has_a_unit(self) -> Self:
        try:
            parse_quantity(self.unit)
        except ValueError as error:
            raise wrong_entry(str(error), "unit") from error
        return self

    def entry(self, motor: Mapping[str, float]) -> Entry:
        """Return the object for a ``motor`` with these quantities."""
        index, sub = (int(part, 16) for part in self.object.split(":"))
        value = self.value
        if self.quantity is not None:
            value = round(motor[self.quantity] / parse_quantity(self.unit).value)
        kind = _KINDS[self.type]
        return Entry(index, sub, kind, value, writable=self.writable, mappable=self.mappable)


class DriveTraits(Documented):
    """What a make of CiA 402 drive is like at the wire."""

    title: str
    """What it is."""
    source: str
    """What the identity, objects, units and modes are taken from."""
    name: str
    """Its name (object 1008)."""
    vendor: Unsigned32
    """Vendor id (object 1018:01)."""
    product: Unsigned32
    """Product code (object 1018:02)."""
    revision: Unsigned32 = 0x0001_0000
    """Revision number (object 1018:03)."""
    modes: Annotated[tuple[Annotated[int, Ge(1), Le(32)], ...], MinLen(1)]
    """Modes of operation that it offers (object 6502)."""
    velocity_unit: Annotated[float, In("rad/s"), Gt(0)] | None = None
    """Unit of velocities (606C, 60FF) if it is one of angle."""
    velocity_counts: Annotated[float, In("count/s"), Gt(0)] | None = None
    """Unit of velocities if it is one of counts."""
    velocity_code: Unsigned32 | None = None
    """Object 60A9; none: it has no such object."""
    absent: tuple[Address, ...] = ()
    """Objects of the standard drive that it lacks: reading one is aborted with 06020000."""
    objects: tuple[OwnObject, ...] = ()
    """Objects that it has beside the standard ones, or in place of them."""
    scan: Annotated[float, In("s"), Ge(0), Le(0.1)] = 0.001
    """It looks at controlword, mode and target once in so long; what came between is not seen."""
    boots_twice: bool = True
    """It sends its boot-up message twice."""
    boot_emergencies: tuple[Annotated[int, Ge(0), Le(0xFFFF)], ...] = (0x3120, 0x0000)
    """Emergencies that it sends after boot-up, such as low mains voltage and its end."""
    segmented: bool = True
    """It answers each SDO upload in segments, short ones too, as CiA 301 allows."""

    @model_validator(mode="after")
    def _one_unit(self) -> Self:
        if (self.velocity_unit is None) is (self.velocity_counts is None):
            raise wrong_entry(
                "give one of 'velocity_unit' and 'velocity_counts'", "velocity_counts"
            )
        return self

    def velocity_per_rad_s(self, counts_per_turn: int) -> float:
        """Return the units of velocity in 1 rad/s of a motor with ``counts_per_turn``."""
        if self.velocity_unit is not None:
            return 1 / self.velocity_unit
        # counts of a radian over counts per second of a unit; 1 count/s is held as such
        return counts_per_turn / _TURN / (self.velocity_counts or 1.0)

    def change(self, dictionary: Dictionary, motor: Mapping[str, float]) -> None:
        """Take what it lacks from ``dictionary``, and add what it has."""
        for address in self.absent:
            index, sub = (int(part, 16) for part in address.split(":"))
            dictionary.remove(index, sub)
        for index, entries in self._by_index(motor).items():
            if any(entry.sub for entry in entries):
                dictionary.array(index, entries)
            else:
                dictionary.add(entries[0])

    def _by_index(self, motor: Mapping[str, float]) -> dict[int, list[Entry]]:
        found: dict[int, list[Entry]] = {}
        for each in self.objects:
            entry = each.entry(motor)
            found.setdefault(entry.index, []).append(entry)
        return found


_TURN: Final = parse_quantity("1 rev").value


def known_makes() -> list[str]:
    """Return the names of the makes that can be simulated."""
    return sorted(path.stem for path in _FOLDER.glob("*.yaml"))


@lru_cache
def read_make(name: str) -> DriveTraits:
    """Return the traits of the make of that name.

    Raises:
        ValueError: there is none, or its file is wrong.

    """
    if name not in known_makes():
        raise ValueError(f"no make is called {name!r}; there are {', '.join(known_makes())}")
    path = _FOLDER / f"{name}.yaml"
    try:
        return load_parameters(path, DriveTraits, path)
    except ConfigError as error:
        raise ValueError(str(error)) from error


def as_make(value: Any) -> Any:
    """Return the traits if ``value`` is the name of a make; else ``value``."""
    return read_make(value) if isinstance(value, str) else value
