"""Parses and computes expressions such as ``0.5 * ${current} + 0.1 A``, with a check of the units.

The grammar extends a number with its unit::

    sum      = product { ("+" | "-") product }
    product  = factor { ("*" | "/") factor }
    factor   = [ "-" | "+" ] ( quantity | "${" name "}" | "(" sum ")" )
    quantity = number [ unit ]
    name     = parameter | table | "rig." constant

A unit ends before a number, a ``$`` or a bracket, so ``2 m / ${time}`` divides.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Final, TypeAlias

from rigd.computed.derived.dimensions import alike, is_angle, over, plain, times
from rigd.model.units import (
    DECIMAL_COMMA,
    NO_DIMENSION,
    Dimension,
    Unit,
    dimension_text,
    parse_unit,
)

#: How deep brackets may nest.
_MAX_DEPTH: Final = 20
#: Most characters of an expression; people cannot read a longer expression.
_MAX_LENGTH: Final = 300
_NUMBER: Final = re.compile(r"(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_FACTOR = r"[A-Za-zµμΩ°%]+(?:\^-?\d+|[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+|\d+)?"
_UNIT: Final = re.compile(
    rf"[ \t]*(?:1[ \t]*/[ \t]*)?{_FACTOR}(?:(?:[ \t]*[/*·][ \t]*|[ \t]+){_FACTOR})*"
)
#: A reference to a name.
NAME: Final = re.compile(r"\$\{\s*([a-z][a-z0-9_]*(?:\.[a-z][a-z0-9_]*)?)\s*\}")
_SPACE: Final = re.compile(r"\s*")


@dataclass(frozen=True, slots=True)
class Number:
    """A computed quantity: SI value and dimension.

    ``unit`` is not "" if the value was given in a unit with a zero of its own (``degC``). Such a
    value takes part in sums only: it can be moved by a difference, and two give a difference, which
    ``is_difference`` then shows. ``of_arc``: it is an arc over its radius, and may be an angle.
    """

    value: float
    dimension: Dimension = NO_DIMENSION
    unit: str = ""
    is_difference: bool = False
    of_arc: bool = False


def number_in(value: float, unit: Unit) -> Number:
    """Return an SI value that was given in ``unit``."""
    return Number(value, unit.dimension, unit.symbol if unit.offset else "")


#: The value of a name.
Value: TypeAlias = Number | str
#: The names an expression may use.
Scope: TypeAlias = Mapping[str, Value]


class ExpressionError(ValueError):
    """An expression is wrong; ``offset`` counts characters from its start."""

    def __init__(self, message: str, offset: int = 0, hint: str | None = None) -> None:
        super().__init__(message)
        self.offset = offset
        self.hint = hint


class UnknownName(ExpressionError):
    """An expression uses a name that has no value at this place."""

    def __init__(self, name: str, offset: int) -> None:
        super().__init__(f"unknown name '${{{name}}}'", offset)
        self.name = name


@dataclass(frozen=True, slots=True)
class Literal:
    """A number with its unit."""

    number: Number


@dataclass(frozen=True, slots=True)
class Reference:
    """A name, whose value is looked up at evaluation."""

    name: str
    offset: int


@dataclass(frozen=True, slots=True)
class Negation:
    """The negative of an operand."""

    operand: Node


@dataclass(frozen=True, slots=True)
class Operation:
    """Two operands joined by ``+ - * /``."""

    operator: str
    left: Node
    right: Node
    offset: int


Node: TypeAlias = Literal | Reference | Negation | Operation


@dataclass(frozen=True, slots=True)
class Expression:
    """A parsed expression, and the names it uses."""

    root: Node
    names: frozenset[str]

    def value(self, scope: Scope) -> Value:
        """Return the value under ``scope``: text if the expression is a name of a text.

        Raises:
            ExpressionError: an unknown name, mixed units, a division by zero.
        """
        if isinstance(self.root, Reference):
            return _look_up(self.root, scope)
        return _evaluate(self.root, scope)


@lru_cache(maxsize=4096)
def parse_expression(text: str) -> Expression:
    """Return the expression written as ``text``.

    Raises:
        ExpressionError: not an expression; its offset is the place.
    """
    if len(text) > _MAX_LENGTH:
        raise ExpressionError(f"longer than {_MAX_LENGTH} characters")
    parser = _Parser(text)
    root = parser.sum(0)
    parser.skip()
    if parser.at < len(text):
        raise ExpressionError(f"cannot read {text[parser.at :]!r}", parser.at)
    return Expression(root, frozenset(parser.names))


class _Parser:
    def __init__(self, text: str) -> None:
        self.text = text
        self.at = 0
        self.names: set[str] = set()

    def skip(self) -> str:
        """Skip spaces and return the next character, or "" at the end."""
        match = _SPACE.match(self.text, self.at)
        self.at = self.at if match is None else match.end()
        return self.text[self.at : self.at + 1]

    def sum(self, depth: int) -> Node:
        left = self.product(depth)
        while (sign := self.skip()) in ("+", "-") and sign:
            offset = self.at
            self.at += 1
            left = Operation(sign, left, self.product(depth), offset)
        return left

    def product(self, depth: int) -> Node:
        left = self.factor(depth)
        while (sign := self.skip()) in ("*", "/") and sign:
            offset = self.at
            self.at += 1
            left = Operation(sign, left, self.factor(depth), offset)
        return left

    def factor(self, depth: int) -> Node:
        if depth > _MAX_DEPTH:
            raise ExpressionError(f"brackets nest deeper than {_MAX_DEPTH}", self.at)
        first = self.skip()
        if first in ("-", "+") and first:
            self.at += 1
            self.skip()
            if _NUMBER.match(self.text, self.at) is not None:  # -20 degC is 253.15 K
                return self.literal(-1.0 if first == "-" else 1.0)
            operand = self.factor(depth + 1)
            return operand if first == "+" else Negation(operand)
        if first == "(":
            self.at += 1
            inside = self.sum(depth + 1)
            if self.skip() != ")":
                raise ExpressionError("a ')' is missing", self.at)
            self.at += 1
            return inside
        name = NAME.match(self.text, self.at)
        if name is not None:
            reference = Reference(name[1], self.at)
            self.names.add(name[1])
            self.at = name.end()
            return reference
        return self.literal()

    def literal(self, sign: float = 1.0) -> Literal:
        number = _NUMBER.match(self.text, self.at)
        if number is None:
            found = self.text[self.at : self.at + 20]
            raise ExpressionError(
                f"expected a quantity such as '1.5 A', found {found!r}" if found
                else "a quantity is missing here",
                self.at,
                "write names as ${name}" if found[:1].isalpha() or found[:1] == "$" else None,
            )  # fmt: skip
        comma = DECIMAL_COMMA.match(self.text, self.at)
        if comma is not None:
            raise ExpressionError(
                "use a decimal point, not a comma", comma.end(1),
                f"write {comma[1]}.{comma[2]}",
            )  # fmt: skip
        self.at = number.end()
        value = sign * float(number[0])
        if not math.isfinite(value):
            raise ExpressionError(f"{number[0]} is too large a number", number.start())
        match = _UNIT.match(self.text, self.at)
        if match is None:
            return Literal(Number(value))
        try:
            unit = parse_unit(match[0].strip())
        except ValueError as error:
            raise ExpressionError(str(error), self.at) from error
        self.at = match.end()
        return Literal(number_in(unit.to_si(value), unit))


def _look_up(reference: Reference, scope: Scope) -> Value:
    try:
        return scope[reference.name]
    except KeyError:
        raise UnknownName(reference.name, reference.offset) from None


def _evaluate(node: Node, scope: Scope) -> Number:
    if isinstance(node, Literal):
        return node.number
    if isinstance(node, Negation):
        number = _evaluate(node.operand, scope)
        if number.unit:
            raise ExpressionError(f"a value in {number.unit} cannot change its sign")
        return Number(-number.value, number.dimension, of_arc=number.of_arc)
    if isinstance(node, Reference):
        value = _look_up(node, scope)
        if isinstance(value, str):
            raise ExpressionError(
                f"'${{{node.name}}}' is the word {value!r}, not a quantity", node.offset
            )
        return value
    return _join(node, _evaluate(node.left, scope), _evaluate(node.right, scope))


def _own_zero(verb: str, unit: str, node: Operation) -> ExpressionError:
    difference = parse_unit(unit).difference()
    return ExpressionError(
        f"cannot {verb} a value in {unit}: it has a zero of its own",
        node.offset,
        f"write the difference in {difference}, or the value in {difference}",
    )


def _join(node: Operation, left: Number, right: Number) -> Number:
    if node.operator in "+-":
        if not alike(left.dimension, right.dimension):
            verb = "add" if node.operator == "+" else "subtract"
            raise ExpressionError(
                f"cannot {verb} {dimension_text(right.dimension)} and "
                f"{dimension_text(left.dimension)}",
                node.offset,
            )
        sign = 1 if node.operator == "+" else -1
        if left.unit and right.unit:
            if sign == 1:
                raise _own_zero("add", left.unit, node)
            unit, is_difference = "", True
        else:
            unit = left.unit or (right.unit if sign == 1 else "")
            is_difference = not unit and (left.is_difference or right.is_difference)
        same = left.dimension == right.dimension
        joined = Number(
            left.value + sign * right.value,
            left.dimension if same else plain(left.dimension),
            unit,
            is_difference,
            left.of_arc and right.of_arc,
        )
    elif left.unit or right.unit:
        verb = "multiply" if node.operator == "*" else "divide"
        raise _own_zero(verb, left.unit or right.unit, node)
    elif node.operator == "*":
        of_arc = left.of_arc or right.of_arc
        dimension = times(left.dimension, right.dimension)
        joined = Number(left.value * right.value, dimension, of_arc=of_arc)
    elif right.value == 0:
        raise ExpressionError("division by zero", node.offset)
    else:
        of_arc = is_angle(left.dimension, right.dimension, of_arc=left.of_arc or right.of_arc)
        dimension = over(left.dimension, right.dimension)
        joined = Number(left.value / right.value, dimension, of_arc=of_arc)
    # NaN replaces a value whose problem is reported already: it must not cause a second problem.
    if not math.isfinite(joined.value) and math.isfinite(left.value + right.value):
        raise ExpressionError("the result is too large a number", node.offset)
    return joined
