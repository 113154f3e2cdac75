"""Reads the conditions of ``rigd runs --where``: a field beside values, joined by and, or and not.

They are a part of the language of all expressions (:mod:`rigd.language.syntax`), with dates, and
with names that may have a dash.
"""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Final, NamedTuple, TypeAlias

from rigd.catalogue.values import DATE, Period, Value, period_of, value_of
from rigd.language.number import ExpressionError
from rigd.language.syntax import (
    ComparisonChain,
    Literal,
    Name,
    Node,
    Operation,
    State,
    Text,
    parse,
)
from rigd.model.errors import ConfigError, Place
from rigd.model.units import si_symbol

#: Stands in the place of the file in an error.
SOURCE: Final = "--where"
_MAX_LENGTH: Final = 1000
#: A condition that :func:`parse_where` has checked.
Condition: TypeAlias = Operation | ComparisonChain | State
#: Where a part begins that stands in no text.
_NOWHERE: Final = -1


class Operand(NamedTuple):
    """A value of a condition; ``period`` if it is a date, ``quoted`` if it stood in quotes."""

    value: Value
    offset: int
    period: Period | None = None
    quoted: bool = False


def equal(field: str, text: str) -> Condition:
    """Return the condition that a field has a value, as text or as the same quantity."""
    return _test(field, "==", Text(_NOWHERE, _NOWHERE, text))


def since(start: float) -> Condition:
    """Return the condition that a run was recorded at ``start`` (s since 1970, UTC) or later."""
    date = datetime.fromtimestamp(start, UTC).isoformat()
    return _test("started", ">=", Text(_NOWHERE, _NOWHERE, date, is_date=True))


def all_of(conditions: list[Condition]) -> Condition:
    """Return the condition that all of one or more ``conditions`` hold."""
    if len(conditions) == 1:
        return conditions[0]
    return Operation(_NOWHERE, _NOWHERE, "and", tuple(conditions))


def _test(field: str, sign: str, value: Text) -> Condition:
    operands = (Name(_NOWHERE, _NOWHERE, field), value)
    return ComparisonChain(_NOWHERE, _NOWHERE, (sign,), operands)


def wrong(offset: int, message: str, hint: str | None = None) -> ConfigError:
    """Return the error of a condition at ``offset`` characters from its start."""
    place = None if offset == _NOWHERE else Place(SOURCE, 1, offset + 1)
    return ConfigError(message, place=place, hint=hint)


def parse_where(text: str) -> Condition:
    """Return the condition written as ``text``.

    Raises:
        ConfigError: it is no condition; names the place.
    """
    try:
        return _checked(parse(text, _MAX_LENGTH, is_search=True))
    except ExpressionError as error:
        raise wrong(error.offset, str(error), error.hint) from error


def _checked(node: Node) -> Condition:
    match node:
        case Operation(sign="and" | "or" | "not", operands=parts):
            for part in parts:
                _checked(part)
        case State(subject=Name(), word=word):
            if word.name not in ("missing", "known"):
                raise wrong(word.start, f"expected 'missing' or 'known', not {word.name!r}")
        case ComparisonChain(signs=signs, operands=(Name(), *values)):
            if len(signs) > 1 and signs[0] != "in":
                raise wrong(values[1].start, "two comparisons in one", "join them with 'and'")
            for value in values:
                operand(value)
        case Name(name=field, end=end):
            raise wrong(end, f"expected a comparison after {field!r}", f'such as {field} == "..."')
        case _:
            hint = 'such as specimen.coating == "PTFE"'
            raise wrong(node.start, "expected the name of a field", hint)
    return node


def operand(node: Node) -> Operand:
    """Return the value that is written in ``node``.

    Raises:
        ConfigError: it is no value; names the place.
    """
    match node:
        case Name(name=name):
            return Operand(Value(name), node.start)
        case Literal(number=number, text=text):
            return Operand(Value(text, number.value, si_symbol(number.dimension)), node.start)
        case Text(text=text, is_date=False):
            return Operand(value_of(text), node.start, period_of(text), quoted=True)
        case Text(text=text):
            period = period_of(text)
            if period is None:
                raise wrong(node.start, f"there is no date {text}", "write 2026-09-01")
            return Operand(Value(text, period.start, DATE), node.start, period)
    raise wrong(node.start, "expected a value", 'a "text", a date, a number with its unit')
