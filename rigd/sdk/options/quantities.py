"""Defines configuration fields that accept a number with a unit and hold the value in SI."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic_core import CoreSchema, core_schema

from rigd.model.patterns import quantity_schema
from rigd.model.units import parse_quantity, parse_unit, with_unit


@dataclass(frozen=True)
class In:
    """Marks a field given as ``"50 mm"`` and held in SI: ``radius: Annotated[float, In("m")]``.

    A bare number is an error unless the unit is dimensionless; bounds behind the marker
    (``Annotated[float, In("m"), Gt(0)]``) apply to the value in SI.
    """

    unit: str
    difference: bool = False
    """Whether it is a tolerance, a noise or a step: ``2 K``, and not ``2 degC``."""

    def read(self, value: object) -> float:
        """Return ``value`` in SI.

        Raises:
            ValueError: not a quantity of this kind; the message shows the right form.
        """
        expected = parse_unit(self.unit)
        if isinstance(value, bool) or not isinstance(value, str | int | float):
            raise ValueError(f"expected a quantity in {self.unit}, such as '1 {self.unit}'")
        given = parse_quantity(str(value))
        if given.unit.same_kind(expected):
            return given.as_difference().value if self.difference else given.value
        if given.unit.symbol == "1":
            words = (
                f"'{value} {self.unit}'" if self.difference else with_unit(str(value), self.unit)
            )
            raise ValueError(f"{value} has no unit: write {words}")
        raise ValueError(f"'{value}' is in {given.unit}, expected {self.unit}")

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """Read text first, then let pydantic check the float and its bounds."""
        return core_schema.no_info_before_validator_function(self.read, handler(source))

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        """Describe the field to an editor as text (or as a bare number if dimensionless)."""
        kinds = (
            ["string", "number"] if parse_unit(self.unit).same_kind(parse_unit("1")) else "string"
        )
        described = {"type": kinds, "description": f"a quantity in {self.unit}"}
        return quantity_schema(self.unit) | described
