"""Converts between the units of an FMU's model description and SI."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from rigd.model.units import BASES, Dimension, parse_quantity, parse_unit

if TYPE_CHECKING:
    from fmpy.model_description import BaseUnit

_RADIAN: Final = BASES.index("rad")


@dataclass(frozen=True)
class FmuUnit:
    """A unit of an FMU: SI value = ``factor`` times the FMU's number + ``offset``.

    ``dimension`` is over :data:`rigd.model.units.BASES`.
    """

    name: str
    dimension: Dimension
    factor: float = 1.0
    offset: float = 0.0

    def to_si(self, number: float) -> float:
        """Return a number of the FMU in SI."""
        return self.factor * number + self.offset

    def from_si(self, value: float) -> float:
        """Return an SI value as the FMU's number."""
        return (value - self.offset) / self.factor

    def symbol(self) -> str | None:
        """Return the SI unit of a channel in this unit; None if its name is not that of one."""
        try:
            unit = parse_unit(_spelt(self.name))
        except ValueError:
            return None
        same = unit.is_si and unit.dimension == self.dimension
        return unit.symbol if same else None

    def check(self, unit: str) -> None:
        """Do nothing if a channel of the unit ``unit`` can show a variable in this unit.

        Raises:
            ValueError: it is of another kind.
        """
        if parse_unit(unit).dimension != self.dimension:
            raise ValueError(f"the FMU gives '{self.name}', which is no unit of the kind of {unit}")

    def read(self, text: str) -> float:
        """Return the quantity ``text`` (``2 kg``) as the FMU's number.

        Raises:
            ValueError: it is no quantity, has no unit, or one of another kind.
        """
        given = parse_quantity(text)
        if given.unit.dimension != self.dimension:
            if given.unit.symbol == "1":
                raise ValueError(f"{text} has no unit: the FMU takes it in '{self.name}'")
            raise ValueError(f"'{text}' is in {given.unit}, the FMU takes '{self.name}'")
        return self.from_si(given.value)


def as_stated(unit: str) -> FmuUnit:
    """Return the unit that a rig file gives for a variable of which the FMU names none."""
    parsed = parse_unit(unit)
    return FmuUnit(unit, parsed.dimension, parsed.factor, parsed.offset)


def unit_of(name: str | None, base: BaseUnit | None) -> FmuUnit | None:
    """Return the unit called ``name``; None if the FMU gives none that can be converted.

    ``base`` is its definition in SI base units (FMI 2.0.5 and 3.0.2, 2.2.2 and 2.4.3): it decides,
    but may leave out the radian. Without one the name is read: as rigd's units, or as Modelica
    spells them (``N.m``, ``kg.m2``).
    """
    if not name:
        return None
    named = _named(name)
    if base is None:
        return named
    if base.mol or base.cd:
        return None
    exponents = {"kg": base.kg, "m": base.m, "s": base.s, "A": base.A, "K": base.K, "rad": base.rad}
    dimension = tuple(exponents.get(symbol, 0) for symbol in BASES)
    if named is not None and not base.rad:
        dimension = (
            *dimension[:_RADIAN], named.dimension[_RADIAN], *dimension[_RADIAN + 1 :]
        )  # fmt: skip
    return FmuUnit(name, dimension, base.factor, base.offset)


def _named(name: str) -> FmuUnit | None:
    try:
        unit = parse_unit(_spelt(name))
    except ValueError:
        return None
    return FmuUnit(name, unit.dimension, unit.factor, unit.offset)


def _spelt(name: str) -> str:
    """Return a name as Modelica spells it (``kg.m2/s2``) in the spelling of rigd."""
    return name.replace(".", " ").replace("Ohm", "ohm")
