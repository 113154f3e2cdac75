"""Evaluates the tree of an expression with a check of the units, to a value or to rows of a graph.

What is fixed is computed at once; what needs the values of channels becomes rows of a graph, if
there is one (:class:`rigd.computed.derived.graph.Builder`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

from rigd.language.dimensions import alike, is_angle, over, plain, times
from rigd.language.functions import FUNCTIONS, Call, Function, reachable
from rigd.language.number import ExpressionError, Number
from rigd.language.operations import Op
from rigd.language.rows import Rows, operate
from rigd.language.syntax import (
    ComparisonChain,
    FunctionCall,
    Items,
    Literal,
    Name,
    Node,
    Operation,
    Reference,
)
from rigd.model.units import NO_DIMENSION, dimension_text, parse_unit, si_symbol

_MAX_POWER: Final = 4
#: ``find(node)``: returns what a name or a reference stands for.
Find = Callable[[Name | Reference], Number]
_VERBS: Final = {"+": "add", "-": "subtract", "*": "multiply", "/": "divide"}
_OPS: Final = {"+": Op.ADD, "-": Op.SUBTRACT, "*": Op.MULTIPLY, "/": Op.DIVIDE}


def evaluate(node: Node, find: Find, rows: Rows | None = None) -> Number:
    """Return the value of ``node``, or what it is; its rows are added to ``rows``.

    Raises:
        ExpressionError: a unit does not fit, or a name is unknown; with the place.
    """
    return _Evaluator(find, rows).any(node)


class _Evaluator:
    def __init__(self, find: Find, rows: Rows | None) -> None:
        self.find, self.rows = find, rows

    def any(self, node: Node) -> Number:
        match node:
            case Literal(number=number):
                return number
            case Reference() | Name():
                return self.find(node)
            case Operation(sign="**", operands=(base, power)):
                return self.power(node, base, power)
            case Operation(sign="-", operands=(operand,)):
                number = self.number(operand)
                _without_own_zero("negate", node, number)
                return operate(
                    self.rows, Op.NEGATE, number, at=node.start,
                    dimension=number.dimension, of_arc=number.of_arc,
                )  # fmt: skip
            case Operation(sign="not" | "and" | "or" as sign, operands=operands):
                first, *others = [self.condition(item) for item in operands]
                if sign == "not":
                    return operate(self.rows, Op.NOT, first, at=node.start, is_condition=True)
                op = Op.AND if sign == "and" else Op.OR
                return self.joined(op, node, first, others)
            case Operation(sign=sign, operands=(left, right)):
                return self.binary(sign, left, right)
            case ComparisonChain():
                return self.compare(node)
            case FunctionCall():
                return self.call(node)
        hint = "channels, quantities, + - * / **, < >, and, or, not, and functions"
        raise ExpressionError("a formula cannot contain this", node.start, hint)

    def number(self, node: Node) -> Number:
        number = self.any(node)
        if number.is_condition:
            raise ExpressionError(
                "expected a quantity, found a condition", node.start, FUNCTIONS["where"].usage
            )
        return number

    def condition(self, node: Node) -> Number:
        number = self.any(node)
        if not number.is_condition:
            raise ExpressionError(
                "expected a condition, found a quantity", node.start, "compare it: 'x > 5 N'"
            )
        return number

    def joined(self, op: Op, node: Node, first: Number, others: Sequence[Number]) -> Number:
        for other in others:
            first = operate(self.rows, op, first, other, at=node.start, is_condition=True)
        return first

    def binary(self, sign: str, left_node: Node, right_node: Node) -> Number:
        left, right = self.number(left_node), self.number(right_node)
        unit, is_difference = "", None
        if sign in "+-":
            _check_alike(_VERBS[sign], left, right, right_node)
            if sign == "+" and left.is_on_scale and right.is_on_scale:
                _without_own_zero("add", right_node, right)
                _without_own_zero("add", left_node, left)
            is_difference = _is_difference(sign, left, right)
            if not (left.unit and right.unit):
                unit = left.unit or (right.unit if sign == "+" else "")
            same = left.dimension == right.dimension
            dimension = left.dimension if same else plain(left.dimension)
            of_arc = left.of_arc and right.of_arc
        else:
            node = left_node if left.unit else right_node
            _without_own_zero(_VERBS[sign], node, left, right)
            of_arc = left.of_arc or right.of_arc
            if sign == "*":
                dimension = times(left.dimension, right.dimension)
            else:
                dimension = over(left.dimension, right.dimension)
                of_arc = is_angle(left.dimension, right.dimension, of_arc=of_arc)
                if right.is_fixed and right.value == 0:
                    raise ExpressionError("division by zero", right_node.start)
        return operate(
            self.rows, _OPS[sign], left, right, at=left_node.start, dimension=dimension,
            unit=unit, is_difference=is_difference, of_arc=of_arc,
        )  # fmt: skip

    def power(self, node: Node, base_node: Node, power_node: Node) -> Number:
        base, power = self.number(base_node), self.number(power_node)
        _without_own_zero("raise", node, base)
        is_count = power.is_fixed and power.dimension == NO_DIMENSION
        if not is_count or power.value not in range(2, _MAX_POWER + 1):
            raise ExpressionError(
                f"a power is a whole number from 2 to {_MAX_POWER}", power_node.start,
                "write '1 / x' and sqrt(x) for other powers",
            )  # fmt: skip
        number = base
        for _ in range(int(power.value) - 1):
            dimension = times(number.dimension, base.dimension)
            number = operate(
                self.rows, Op.MULTIPLY, number, base, at=node.start, dimension=dimension
            )
        return number

    def compare(self, node: ComparisonChain) -> Number:
        numbers = [self.number(item) for item in node.operands]
        made = []
        for place, sign in enumerate(node.signs):
            left, right = numbers[place : place + 2]
            nodes = node.operands[place : place + 2]
            _check_alike("compare", left, right, nodes[1])
            check_differences((left, right), (left, right), nodes)
            if sign not in ("<", ">", "<=", ">="):
                raise ExpressionError(
                    "compare with '<' or '>'", nodes[1].start,
                    "a measured value never equals a number",
                )  # fmt: skip
            op = Op.NOT_ABOVE if "=" in sign else Op.LESS
            pair = (left, right) if "<" in sign else (right, left)
            made.append(operate(self.rows, op, *pair, at=node.start, is_condition=True))
        return self.joined(Op.AND, node, made[0], made[1:])

    def call(self, node: FunctionCall) -> Number:
        known = FUNCTIONS.get(node.name)
        if known is None:
            message = f"unknown function {node.name!r}"
            raise ExpressionError(message, node.start, reachable(node.name))
        if len(node.items) != len(known.takes):
            raise ExpressionError(
                f"{node.name} takes {len(known.takes)} values, found {len(node.items)}",
                node.start, known.usage,
            )  # fmt: skip
        numbers, nodes, tables = [], [], []
        for kind, item in zip(known.takes, node.items, strict=True):
            if kind == "list":
                if not isinstance(item, Items):
                    raise ExpressionError("expected a list '[...]'", item.start, known.usage)
                tables.append([self.constant(point, known) for point in item.items])
                continue
            nodes.append(item)
            if kind == "condition":
                numbers.append(self.condition(item))
            else:
                number = self.constant(item, known) if kind == "constant" else self.number(item)
                numbers.append(number)
        check_differences(numbers, numbers, nodes)
        if tables and isinstance(node.items[1], Items):
            check_differences(numbers, tables[0], node.items[1].items)
        places = [item.start for item in node.items]
        return known.make(Call(self.rows, places, known.usage, tables), numbers)

    def constant(self, node: Node, known: Function) -> Number:
        number = self.number(node)
        if not number.is_fixed:
            raise ExpressionError("expected a fixed quantity here", node.start, known.usage)
        return number


def _check_alike(verb: str, left: Number, right: Number, node: Node) -> None:
    if alike(left.dimension, right.dimension):
        return
    first, second = dimension_text(left.dimension), dimension_text(right.dimension)
    message = f"cannot {verb} {second} and {first}"
    if verb == "compare":
        message = f"cannot compare {first} with {second}"
    hint = None
    for number, other in ((right, left), (left, right)):
        if number.is_fixed and number.dimension == NO_DIMENSION:
            hint = f"give the number its unit, such as '{si_symbol(other.dimension)}'"
    raise ExpressionError(message, node.start, hint)


def _without_own_zero(verb: str, node: Node, *numbers: Number) -> None:
    """Refuse to ``verb`` a fixed quantity in degC, or another unit with a zero of its own."""
    unit = next((number.unit for number in numbers if number.unit), "")
    if unit:
        difference = parse_unit(unit).difference()
        raise ExpressionError(
            f"cannot {verb} a value in {unit}: it has a zero of its own", node.start,
            f"write the difference in {difference}, or the value in {difference}",
        )  # fmt: skip


def check_differences(
    numbers: Sequence[Number], fixed: Sequence[Number], nodes: Sequence[Node]
) -> None:
    """Refuse degC and such in ``fixed`` quantities beside a difference in ``numbers``."""
    if not any(number.is_difference for number in numbers):
        return
    for item, node in zip(fixed, nodes, strict=True):
        if item.unit:
            unit = parse_unit(item.unit)
            small = unit.difference()
            size, value = small.from_si(item.value - unit.offset), small.from_si(item.value)
            raise ExpressionError(
                f"a difference of two values stands beside a value in {unit}, which has a "
                "zero of its own", node.start,
                f"write {size:g} {small} if the difference is meant, {value:g} {small} if it "
                "is a value",
            )  # fmt: skip


def _is_difference(sign: str, left: Number, right: Number) -> bool:
    """Return whether a sum is a difference; that of two channels counts as one.

    A fixed quantity without a zero of its own is a difference, if the other is one.
    """
    if sign == "-" and right.is_on_scale:
        return True
    both = all(number.is_difference or number.is_plain for number in (left, right))
    return both and (left.is_difference or right.is_difference)
