"""Describes a make of CANopen device as data: its identity, its settings, its objects and PDOs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated, Final, Literal, Self

from annotated_types import Ge, Le
from pydantic import StringConstraints, model_validator

from rigd.sdk import Documented, ProtocolError, wrong_entry
from rigd_drivers.can.canopen.objects import Entry
from rigd_drivers.can.node import Node
from rigd_drivers.device_file import DeviceFile

#: Integers of CiA 301, 7.1.6, as :mod:`struct` writes them.
_CODES: Final = {
    "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I"
}  # fmt: skip
_WRONG: Final = "give the `profile` of this device, or correct the file; without it, leave it out"

Unsigned32 = Annotated[int, Ge(0), Le(0xFFFF_FFFF)]


class ObjectChoice(Documented):
    """An object of the device."""

    object: Annotated[str, StringConstraints(pattern=r"^[0-9A-Fa-f]{4}:[0-9A-Fa-f]{2}$")]
    """Index and sub-index in hexadecimal, as in 6071:00."""
    type: Literal["int8", "uint8", "int16", "uint16", "int32", "uint32"]
    """Type of its value."""

    def entry(self, name: str) -> Entry:
        """Return the object, called ``name`` in messages."""
        index, sub = self.object.split(":")
        return Entry(int(index, 16), int(sub, 16), _CODES[self.type], name)


class Fixed(ObjectChoice):
    """An object and its value."""

    value: int
    """The value."""
    name: str
    """What it is, for a person."""

    @model_validator(mode="after")
    def _fits(self) -> Self:
        try:
            self.entry(self.name).pack(self.value)
        except ValueError as error:
            raise wrong_entry(str(error), "value") from error
        return self

    def pair(self) -> tuple[Entry, int]:
        """Return the object and its value."""
        return self.entry(self.name), self.value


class Startup(Fixed):
    """A value that rigd writes when it opens the device."""

    keeps: bool = True
    """It reads back as written, and is checked to."""


class PdoChoice(Documented):
    """Which PDO carries something, and under which identifier."""

    number: Annotated[int, Ge(1), Le(512)]
    """Number of the PDO, from 1: its parameters are at 1400h or 1800h plus this, less 1."""
    cob_id: Annotated[int, Ge(0x180), Le(0x500)]
    """Its identifier, less the node id: 0x180 is that of TPDO1 by CiA 301."""


#: TPDO1 as CiA 301 has it.
FIRST_TPDO: Final = PdoChoice(number=1, cob_id=0x180)


class NodeProfile(DeviceFile):
    """What rigd must know of a make of CANopen device beyond the standard."""

    vendor: Unsigned32 | None = None
    """Vendor id that the device must have (object 1018:01); none: not known, and not checked."""
    products: tuple[Unsigned32, ...] = ()
    """Product codes that it may have (object 1018:02); none: any."""
    setup: tuple[Startup, ...] = ()
    """Written in this order when it is opened, before its PDOs are mapped."""
    expect: tuple[Fixed, ...] = ()
    """Values that it must have; rigd never writes them."""

    def __str__(self) -> str:
        return f"profile {self.title} ({self.standing})"

    def confirm(self, node: Node) -> None:
        """Check that ``node``, which is open, is a device of this profile.

        Raises:
            LinkError: it does not answer.
            ProtocolError: it is another device, or has another value than expected.

        """
        if self.vendor is not None and node.vendor != self.vendor:
            raise ProtocolError(
                f"{node} has vendor id {_hex(node.vendor)} (object 1018:01), the profile of the "
                f"{self.title} expects {_hex(self.vendor)}",
                hint=_WRONG,
            )
        if self.products and node.product not in self.products:
            known = " or ".join(map(_hex, self.products))
            raise ProtocolError(
                f"{node} has product code {_hex(node.product)} (object 1018:02), the profile of "
                f"the {self.title} expects {known}",
                hint=_WRONG,
            )
        for entry, value in (each.pair() for each in self.expect):
            found = node.read(entry)
            if found != value:
                raise ProtocolError(
                    f"{node}: {node.called(entry)} is {found}, the profile of the {self.title} "
                    f"expects {value}",
                    hint="set it with the maker's tool, or correct `profile`",
                )

    def prepare(self, node: Node) -> None:
        """Write what the device needs, in order, and read it back.

        Raises:
            LinkError: it does not answer.
            ProtocolError: it refuses, or reads back something else.

        """
        for each in self.setup:
            if each.keeps:
                node.ensure(*each.pair())
            else:  # what it does not keep, it may do: twice is not once
                node.write(*each.pair(), once=True)

    def reads(self) -> Iterator[Entry]:
        """Yield the objects that :meth:`confirm` reads."""
        yield from (each.pair()[0] for each in self.expect)

    def writes(self) -> Iterator[tuple[Entry, int]]:
        """Yield what :meth:`prepare` writes."""
        yield from (each.pair() for each in self.setup)


class EncoderProfile(NodeProfile):
    """What rigd must know of a make of CiA 406 encoder beyond the standard."""

    pdo: PdoChoice = FIRST_TPDO
    """The TPDO that carries the position at every SYNC."""


class TransmitterProfile(NodeProfile):
    """What rigd must know of a make of CiA 404 transmitter beyond the standard."""

    value: ObjectChoice = ObjectChoice(object="7130:01", type="int16")
    """Object of the process value: 7130:01 with 16 bits, 9130:01 with 32."""
    status: bool = True
    """Whether the status of the measurement (6150:01) is mapped beside it."""
    tare: bool = True
    """Whether it can be set to zero by object 6125:01."""
    pdo: PdoChoice = FIRST_TPDO
    """The TPDO that carries the value at every SYNC."""


def distinct(pdos: Sequence[PdoChoice], what: str, paths: Sequence[tuple[str | int, ...]]) -> None:
    """Refuse two of ``pdos`` that have the same number; ``paths`` are their keys in the file.

    Raises:
        WrongEntries: there are two.
    """
    numbers = [each.number for each in pdos]
    for place, number in enumerate(numbers):
        if number in numbers[:place]:
            known = ", ".join(map(str, numbers))
            raise wrong_entry(f"two {what} have the same number: {known}", *paths[place], "number")


def _hex(value: int | None) -> str:
    return "none" if value is None else f"0x{value:X}"
