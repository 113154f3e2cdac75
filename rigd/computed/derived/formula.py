"""Reads a formula such as ``derivative(wheel.angle) * 0.03 m - carriage.speed`` into a graph.

Python's own parser reads it; only the nodes and functions that this module names are accepted.
Units are checked through every operation (:mod:`rigd.computed.derived.dimensions`).
"""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

from rigd.computed.derived.dimensions import alike, is_angle, over, plain, times
from rigd.computed.derived.functions import FUNCTIONS, Call, Fixed, reachable
from rigd.computed.derived.graph import Builder, Op, Term
from rigd.computed.derived.quantities import (
    STAND_IN,
    FormulaError,
    Named,
    Prepared,
    no_names,
    prepare,
)
from rigd.model.units import NO_DIMENSION, Dimension, dimension_text, parse_unit, si_symbol

#: Most characters of a formula; people cannot read a longer one.
MAX_LENGTH: Final = 300
#: How deep a formula may nest.
MAX_DEPTH: Final = 30
_MAX_POWER: Final = 4
#: ``find(name, offset)``: returns the term of the channel or constant ``name``.
Find = Callable[[str, int], Term]

_BINARY: Final = {ast.Add: Op.ADD, ast.Sub: Op.SUBTRACT, ast.Mult: Op.MULTIPLY, ast.Div: Op.DIVIDE}
_VERBS: Final = {Op.ADD: "add", Op.SUBTRACT: "subtract"}


def read_formula(
    text: str, builder: Builder, find: Find, period_s: float, named: Named = no_names
) -> Term:
    """Return the term of ``text``; its rows are added to ``builder``.

    ``period_s`` is that of the cycle, ``named`` knows what is written ``${name}``.

    Raises:
        FormulaError: it is no formula, a unit does not fit, or a name is unknown; with the place.
    """
    if len(text) > MAX_LENGTH:
        raise FormulaError(f"a formula has at most {MAX_LENGTH} characters")
    if (taken := re.search(rf"\b{STAND_IN}\d", text)) is not None:
        raise FormulaError(f"unknown name {taken[0]!r}", taken.start())
    prepared = prepare(text, named)
    strange = next((at for at, letter in enumerate(prepared.text) if not letter.isascii()), None)
    if strange is not None:
        raise FormulaError(f"cannot read {prepared.text[strange]!r}", prepared.original(strange))
    lead = len(prepared.text) - len(prepared.text.lstrip())
    try:
        tree = ast.parse(prepared.text.strip(), mode="eval")
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        column = (getattr(error, "offset", None) or 1) - 1 + lead
        found = text[prepared.original(column) :][:20]
        message = (
            f"cannot read the formula at {found!r}" if found else "the formula is not complete"
        )
        raise FormulaError(
            message, min(prepared.original(column), len(text)), _hint(text)
        ) from None
    reader = _Reader(builder, find, period_s, prepared, lead)
    return reader.read(tree.body, 0)


def _hint(text: str) -> str | None:
    if "&" in text or "|" in text or "!" in text:
        return "write 'and', 'or', 'not' and 'abs(...)'"
    return "write channels as device.channel and quantities as '5 N'"


@dataclass
class _Reader:
    builder: Builder
    find: Find
    period_s: float
    prepared: Prepared
    lead: int

    def at(self, node: ast.AST) -> int:
        column: int = getattr(node, "col_offset", 0)
        return self.prepared.original(column + self.lead)

    def read(self, node: ast.expr, depth: int) -> Term:
        if depth > MAX_DEPTH:
            raise FormulaError(f"the formula nests deeper than {MAX_DEPTH}", self.at(node))
        match node:
            case ast.Name(id=name) if name.startswith(STAND_IN):
                return self.builder.constant(*self.prepared.quantities[int(name[len(STAND_IN) :])])
            case ast.Name(id=name):
                hint = "channels are written as device.channel"
                if name in FUNCTIONS:
                    hint = f"it is a function: {FUNCTIONS[name].usage}"
                raise FormulaError(f"unknown name {name!r}", self.at(node), hint)
            case ast.Attribute(value=ast.Name(id=device), attr=channel):
                return self.find(f"{device}.{channel}", self.at(node))
            case ast.BinOp(op=ast.Pow()):
                return self.power(node, depth)
            case ast.BinOp(op=operator) if type(operator) in _BINARY:
                return self.binary(node, _BINARY[type(operator)], depth)
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                term = self.number(operand, depth)
                if term.unit and isinstance(operand, ast.Name):  # -20 degC is 253.15 K
                    below = 2 * parse_unit(term.unit).offset - (term.constant or 0.0)
                    return self.builder.constant(below, term.dimension, term.unit)
                self.without_own_zero("negate", node, term)
                return self.fold(Op.NEGATE, (term,), term.dimension)
            case ast.UnaryOp(op=ast.UAdd(), operand=operand):
                return self.number(operand, depth)
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                return self.builder.add(Op.NOT, self.condition(operand, depth), is_condition=True)
            case ast.Compare():
                return self.compare(node, depth)
            case ast.BoolOp(op=operator, values=values):
                op = Op.AND if isinstance(operator, ast.And) else Op.OR
                term, *others = [self.condition(value, depth) for value in values]
                for other in others:
                    term = self.builder.add(op, term, other, is_condition=True)
                return term
            case ast.Call(func=ast.Name(id=name)):
                return self.call(name, node, depth)
            case ast.IfExp():
                raise FormulaError(
                    "'if' is not known here", self.at(node), FUNCTIONS["where"].usage
                )
        raise FormulaError("a formula cannot contain this", self.at(node), _hint_for(node))

    def number(self, node: ast.expr, depth: int) -> Term:
        term = self.read(node, depth + 1)
        if term.is_condition:
            raise FormulaError(
                "expected a quantity, found a condition", self.at(node), FUNCTIONS["where"].usage
            )
        return term

    def condition(self, node: ast.expr, depth: int) -> Term:
        term = self.read(node, depth + 1)
        if not term.is_condition:
            raise FormulaError(
                "expected a condition, found a quantity", self.at(node), "compare it: 'x > 5 N'"
            )
        return term

    def fold(self, op: Op, terms: Sequence[Term], dimension: Dimension) -> Term:
        """Return the term of ``op``; of constants, its value, computed now."""
        values = [term.constant for term in terms]
        known = [value for value in values if value is not None]
        if len(known) == len(values):
            return self.builder.constant(_value(op, known), dimension)
        return self.builder.add(op, *terms, dimension=dimension)

    def binary(self, node: ast.BinOp, op: Op, depth: int) -> Term:
        left, right = self.number(node.left, depth), self.number(node.right, depth)
        of_arc = left.of_arc or right.of_arc
        if op in _VERBS:
            if not alike(left.dimension, right.dimension):
                raise FormulaError(
                    f"cannot {_VERBS[op]} {dimension_text(right.dimension)} and "
                    f"{dimension_text(left.dimension)}",
                    self.at(node.right), _missing(left, right),
                )  # fmt: skip
            if op is Op.ADD and not left.is_difference and (left.unit or left.constant is None):
                self.without_own_zero("add", node.right, right)
            if op is Op.ADD and not right.is_difference and right.constant is None:
                self.without_own_zero("add", node.left, left)
            same = left.dimension == right.dimension
            dimension = left.dimension if same else plain(left.dimension)
            of_arc = left.of_arc and right.of_arc
        elif op is Op.MULTIPLY:
            self.without_own_zero("multiply", node, left, right)
            dimension = times(left.dimension, right.dimension)
        elif right.constant == 0:
            raise FormulaError("division by zero", self.at(node.right))
        else:
            self.without_own_zero("divide", node, left, right)
            dimension = over(left.dimension, right.dimension)
            of_arc = is_angle(left.dimension, right.dimension, of_arc=of_arc)
        term = replace(self.fold(op, (left, right), dimension), of_arc=of_arc)
        if op in _VERBS:
            term = replace(term, is_difference=_is_difference(op, left, right))
        if term.constant is not None and bool(left.unit) != bool(right.unit):
            return replace(term, unit=left.unit or right.unit)
        return term

    def without_own_zero(self, verb: str, node: ast.expr, *terms: Term) -> None:
        """Refuse to ``verb`` a fixed quantity in degC, or another unit with a zero of its own."""
        unit = next((term.unit for term in terms if term.unit), "")
        if unit:
            difference = parse_unit(unit).difference()
            raise FormulaError(
                f"cannot {verb} a value in {unit}: it has a zero of its own", self.at(node),
                f"write the difference in {difference}, or the value in {difference}",
            )  # fmt: skip

    def without_difference(
        self, terms: Sequence[Term], fixed: Sequence[Fixed], nodes: Sequence[ast.expr]
    ) -> None:
        """Refuse degC and such in ``fixed`` quantities beside a difference in ``terms``."""
        for item, node in zip(fixed, nodes, strict=True):
            if item.unit and any(term.is_difference for term in terms):
                unit = parse_unit(item.unit)
                small = unit.difference()
                size, value = small.from_si(item.value - unit.offset), small.from_si(item.value)
                raise FormulaError(
                    f"a difference of two channels stands beside a value in {unit}, which has a "
                    "zero of its own", self.at(node),
                    f"write {size:g} {small} if the difference is meant, {value:g} {small} if it "
                    "is a value",
                )  # fmt: skip

    def power(self, node: ast.BinOp, depth: int) -> Term:
        base, power = self.number(node.left, depth), self.number(node.right, depth)
        self.without_own_zero("raise", node, base)
        count = power.constant
        fits = count is not None and power.dimension == NO_DIMENSION
        if count is None or not fits or count not in range(2, _MAX_POWER + 1):
            raise FormulaError(
                f"a power is a whole number from 2 to {_MAX_POWER}", self.at(node.right),
                "write '1 / x' and sqrt(x) for other powers",
            )  # fmt: skip
        term = base
        for _ in range(int(count) - 1):
            term = self.fold(Op.MULTIPLY, (term, base), times(term.dimension, base.dimension))
        return term

    def compare(self, node: ast.Compare, depth: int) -> Term:
        terms = [self.number(item, depth) for item in (node.left, *node.comparators)]
        parts = []
        for place, operator in enumerate(node.ops):
            left, right = terms[place], terms[place + 1]
            if not alike(left.dimension, right.dimension):
                raise FormulaError(
                    f"cannot compare {dimension_text(left.dimension)} with "
                    f"{dimension_text(right.dimension)}",
                    self.at(node.comparators[place]), _missing(left, right),
                )  # fmt: skip
            items = (node.left, *node.comparators)[place : place + 2]
            self.without_difference((left, right), [_fixed(left), _fixed(right)], items)
            match operator:
                case ast.Lt():
                    parts.append(self.builder.add(Op.LESS, left, right, is_condition=True))
                case ast.Gt():
                    parts.append(self.builder.add(Op.LESS, right, left, is_condition=True))
                case ast.LtE():
                    parts.append(self.builder.add(Op.NOT_ABOVE, left, right, is_condition=True))
                case ast.GtE():
                    parts.append(self.builder.add(Op.NOT_ABOVE, right, left, is_condition=True))
                case _:
                    raise FormulaError(
                        "compare with '<' or '>'", self.at(node.comparators[place]),
                        "a measured value never equals a number",
                    )  # fmt: skip
        term, *others = parts
        for other in others:
            term = self.builder.add(Op.AND, term, other, is_condition=True)
        return term

    def call(self, name: str, node: ast.Call, depth: int) -> Term:
        known = FUNCTIONS.get(name)
        if known is None:
            raise FormulaError(f"unknown function {name!r}", self.at(node), reachable(name))
        if node.keywords or any(isinstance(item, ast.Starred) for item in node.args):
            raise FormulaError(f"{name} takes values only", self.at(node), known.usage)
        if len(node.args) != len(known.takes):
            raise FormulaError(
                f"{name} takes {len(known.takes)} values, found {len(node.args)}",
                self.at(node), known.usage,
            )  # fmt: skip
        terms: list[Term] = []
        nodes: list[ast.expr] = []
        tables: list[list[Fixed]] = []
        points: list[ast.expr] = []
        for kind, item in zip(known.takes, node.args, strict=True):
            if kind != "list":
                nodes.append(item)
            if kind == "condition":
                terms.append(self.condition(item, depth))
            elif kind == "list":
                if not isinstance(item, ast.List):
                    raise FormulaError("expected a list '[...]'", self.at(item), known.usage)
                tables.append([self.fixed(point, depth, known.usage) for point in item.elts])
                points = points or item.elts
            elif kind == "constant":
                terms.append(self.constant(item, depth, known.usage))
            else:
                terms.append(self.number(item, depth))
        places = [self.at(item) for item in node.args]
        call = Call(self.builder, self.period_s, self.at(node), places, known.usage, tables)
        self.without_difference(terms, [_fixed(term) for term in terms], nodes)
        if tables:
            self.without_difference(terms, tables[0], points)
        return known.make(call, terms)

    def fixed(self, node: ast.expr, depth: int, usage: str) -> Fixed:
        term = self.constant(node, depth, usage)
        return _fixed(term)

    def constant(self, node: ast.expr, depth: int, usage: str) -> Term:
        term = self.number(node, depth)
        if term.constant is None:
            raise FormulaError("expected a fixed quantity here", self.at(node), usage)
        return term


def _fixed(term: Term) -> Fixed:
    value = math.nan if term.constant is None else term.constant
    return Fixed(value, term.dimension, term.unit)


def _is_difference(op: Op, left: Term, right: Term) -> bool:
    """Return whether a sum or difference is a difference; that of two channels counts as one."""
    if op is Op.SUBTRACT and not right.is_difference:
        return left.is_difference or bool(right.unit) or right.constant is None
    if op is Op.SUBTRACT:
        return left.is_difference
    # A fixed quantity without a zero of its own is a difference, if the other is one.
    left_is = left.is_difference or (left.constant is not None and not left.unit)
    right_is = right.is_difference or (right.constant is not None and not right.unit)
    return left_is and right_is


def _hint_for(node: ast.expr) -> str | None:
    match node:
        case ast.Tuple():
            return "use a decimal point, not a comma"
        case ast.BinOp(op=ast.BitXor()):
            return "write a power as 'x ** 2'"
        case ast.BinOp(op=ast.BitAnd() | ast.BitOr()):
            return "write 'and', 'or' and 'abs(...)'"
    return "channels, quantities, + - * / **, < >, and, or, not, and functions"


def _missing(left: Term, right: Term) -> str | None:
    """Return a hint if a fixed number beside a quantity has no unit."""
    for number, other in ((left, right), (right, left)):
        if number.constant is not None and number.dimension == NO_DIMENSION:
            return f"give the number its unit, such as '{si_symbol(other.dimension)}'"
    return None


def _value(op: Op, values: Sequence[float]) -> float:
    first, second = (*values, 0.0)[:2]
    match op:
        case Op.ADD:
            return first + second
        case Op.SUBTRACT:
            return first - second
        case Op.MULTIPLY:
            return first * second
        case Op.DIVIDE:
            return first / second if second else math.nan
        case Op.NEGATE:
            return -first
    raise ValueError(f"{op.name} is not folded")
