"""Evaluates the expressions of a procedure and reports errors at their position."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from rigd.config.document import Document, KeyPath
from rigd.config.problems import Problems, suggest
from rigd.language.dimensions import fits
from rigd.language.number import ExpressionError, Number, UnknownName
from rigd.language.tokens import NAME
from rigd.model.units import dimension_text, format_quantity, parse_unit, with_unit
from rigd.procedure.expression import Expression, Scope, Value, parse_expression

#: What stands for a value in a text, its name written wrongly too.
_ANY_NAME = re.compile(r"\$\{\s*([^{}]*?)\s*\}")
_ONLY_NAME = re.compile(rf"\s*{NAME.pattern}\s*$")


@dataclass
class Reader:
    """Reads values of one document; ``units`` are the displayed units of named quantities.

    ``swept`` are the names that have a value only inside a trial.
    """

    document: Document
    problems: Problems
    units: Mapping[str, str] = field(default_factory=dict)
    swept: frozenset[str] = frozenset()

    def note(self, path: KeyPath, message: str, hint: str | None = None) -> None:
        """Note a problem with the value at ``path``."""
        self.problems.add(self.document.place(path), message, hint)

    def note_key(self, path: KeyPath, message: str, hint: str | None = None) -> None:
        """Note a problem with the key at ``path``."""
        self.problems.add(self.document.key_place(path), message, hint)

    def parse(self, path: KeyPath, text: str, offset: int = 0) -> Expression | None:
        """Return ``text`` as an expression, or None with the problem noted."""
        try:
            return parse_expression(text)
        except ExpressionError as error:
            self._note_inside(path, error, offset, {})
            return None

    def value(self, path: KeyPath, text: str, scope: Scope, offset: int = 0) -> Value | None:
        """Return the value of ``text``, or None with the problem noted.

        ``offset`` is the index at which ``text`` begins within the value at ``path``.
        """
        try:
            return parse_expression(text).value(scope)
        except ExpressionError as error:
            self._note_inside(path, error, offset, scope)
            return None

    def difference(self, path: KeyPath, text: str, unit: str, scope: Scope) -> float:
        """Return a difference of values in ``unit``, in SI, or NaN with the problem noted.

        ``2 K`` is one for values in ``degC``, ``2 degC`` is a problem.
        """
        wanted = parse_unit(unit).difference().symbol
        value = self.value(path, text, scope)
        if isinstance(value, Number) and value.unit:
            own = parse_unit(value.unit)
            size = format_quantity(value.value - own.offset, own.difference().symbol)
            self.note(path, f"{text!r} is a value on a scale with a zero of its own, and a "
                            "difference is expected here", f"write '{size}'")  # fmt: skip
            return math.nan
        return (
            math.nan if value is None else self.number(path, text, wanted, scope, difference=True)
        )

    def number(
        self,
        path: KeyPath,
        text: str,
        unit: str,
        scope: Scope,
        offset: int = 0,
        *,
        difference: bool = False,
    ) -> float:
        """Return the value of ``text`` in SI, or NaN with the problem noted."""
        value = self.value(path, text, scope, offset)
        if value is None:
            return math.nan
        place = self.document.inside(path, offset)
        expected = parse_unit(unit)
        if isinstance(value, str):
            self.problems.add(place, f"{value!r} is a word, expected a quantity in {unit}")
            return math.nan
        if not fits(value.dimension, expected.dimension, of_arc=value.of_arc):
            if any(value.dimension):
                message = f"{text!r} is in {dimension_text(value.dimension)}, expected {unit}"
                hint = f"such as '1 {unit}'" if unit != "1" else "a plain number"
            else:
                message = f"{text!r} has no unit, expected {unit}"
                bare = f"'{text} {unit}'" if difference else with_unit(text, unit)
                hint = f"such as {bare}"
            self.problems.add(place, message, hint)
            return math.nan
        if value.is_difference and not difference:
            message = f"{text!r} is the difference of two values on a scale with a zero of its own"
            hint = f"subtract a difference, such as '1 {unit}', if a value is meant"
            self.problems.add(place, message, hint)
            return math.nan
        return value.value

    def time(self, path: KeyPath, text: str | None, scope: Scope) -> float | None:
        """Return the time at ``path`` in s, above zero; None if no time is given."""
        if text is None:
            return None
        value = self.number(path, text, "s", scope)
        if value <= 0:
            self.note(path, f"{text} must be above 0 s")
        return value

    def word(self, path: KeyPath, text: str, scope: Scope) -> str | None:
        """Return a word, written directly or as ``${name}``, or None with the problem noted."""
        if _ONLY_NAME.match(text) is None:
            return text
        value = self.value(path, text, scope)
        if isinstance(value, Number):
            self.note(path, f"{text} is a quantity, expected a word")
            return None
        return value

    def text(self, path: KeyPath, template: str, scope: Scope) -> str:
        """Return ``template`` with every ``${name}`` replaced by its value, units included."""

        def replace(match: re.Match[str]) -> str:
            value = scope.get(match[1])
            if value is None:
                error = UnknownName(match[1], match.start())
                self._note_inside(path, error, 0, scope)
                return match[0]
            if isinstance(value, str):
                return value
            unit = self.units.get(match[1])
            return format_quantity(value.value, unit or describe_unit(value))

        return _ANY_NAME.sub(replace, template)

    def _note_inside(
        self, path: KeyPath, error: ExpressionError, offset: int, scope: Scope
    ) -> None:
        hint, lacks = error.hint, ""
        if isinstance(error, UnknownName):
            hint = suggest(error.name, scope)
            lacks = error.name if error.name.startswith("rig.") else ""
            if error.name in self.swept:
                hint = f"the sweep varies {error.name}: it has a value only inside 'trial'"
        place = self.document.inside(path, offset + error.offset)
        self.problems.add(place, str(error), hint, lacks=lacks)


def describe_unit(value: Number) -> str:
    """Return the SI unit of ``value`` as text that :func:`parse_unit` reads."""
    return dimension_text(value.dimension) if any(value.dimension) else "1"
