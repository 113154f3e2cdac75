"""Defines a constant of a rig or of a model: a quantity with its uncertainty and its source."""

from __future__ import annotations

from dataclasses import dataclass

from rigd.model.units import Quantity, Unit, parse_quantity


@dataclass(frozen=True)
class Uncertainty:
    """A standard uncertainty (k = 1): ``size`` in SI or, if ``is_share``, a share of the value."""

    size: float
    is_share: bool = False

    def of(self, value: float) -> float:
        """Return the uncertainty of ``value``, both in SI."""
        return self.size * abs(value) if self.is_share else self.size


@dataclass(frozen=True)
class Constant(Quantity):
    """A quantity of a rig, with its uncertainty (None: not given) and its source."""

    u: Uncertainty | None = None
    source: str = ""


def parse_uncertainty(text: str, unit: Unit) -> Uncertainty:
    """Return the uncertainty written as ``0.1 mm``, or as ``0.2 %`` of the value.

    Raises:
        ValueError: it is not a quantity of the kind of ``unit`` or in ``%``, or it is below 0.
    """
    given = parse_quantity(text).as_difference()
    is_share = given.unit.symbol == "%"
    if is_share and unit.offset:
        raise ValueError(f"{text} of a value in {unit} has no meaning")
    if given.unit.symbol == "1" and not unit.same_kind(given.unit):
        raise ValueError(
            f"the uncertainty {text!r} has no unit: write '{text} {unit.difference()}'"
        )
    if not is_share and not given.unit.same_kind(unit):
        expected = unit.difference() if unit.offset else f"{unit} or %"
        raise ValueError(f"the uncertainty {text!r} is in {given.unit}, expected {expected}")
    if given.value < 0:
        raise ValueError(f"the uncertainty {text!r} is below 0")
    return Uncertainty(given.value, is_share)
