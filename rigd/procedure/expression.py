"""Computes expressions of procedures such as ``0.5 * ${current} + 0.1 A``.

They have names as ``${name}``: a parameter, a table, or ``${rig.name}``, a constant of the rig.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Final, TypeAlias

from rigd.language.evaluate import evaluate
from rigd.language.functions import FUNCTIONS
from rigd.language.number import ExpressionError, Number, UnknownName
from rigd.language.syntax import Name, Node, Reference, Text, parse, parts

#: The value of a name.
Value: TypeAlias = Number | str
#: The names an expression may use.
Scope: TypeAlias = Mapping[str, Value]
_BARE: Final = re.compile(r"\s*(?=[^\W\d]\w*+(?!\())")


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
        number = evaluate(self.root, lambda node: _number(node, scope))
        if number.is_condition:
            usage = FUNCTIONS["where"].usage
            raise ExpressionError("expected a quantity, found a condition", hint=usage)
        return number


@lru_cache(maxsize=4096)
def parse_expression(text: str) -> Expression:
    """Return the expression written as ``text``.

    Raises:
        ExpressionError: not an expression; its offset is the place.
    """
    bare = _BARE.match(text)
    if bare is not None:
        raise _unexpected(text, bare.end())
    return expression_of(parse(text), text)


def expression_of(root: Node, text: str) -> Expression:
    """Return the expression of the part ``root`` of ``text``.

    Raises:
        ExpressionError: it has names that are not written ``${name}``; its offset is the place.
    """
    for part in parts(root):
        if isinstance(part, Name | Text):
            raise _unexpected(text, part.start)
    return Expression(root, frozenset(p.name for p in parts(root) if isinstance(p, Reference)))


def _unexpected(text: str, at: int) -> ExpressionError:
    message = f"expected a quantity such as '1.5 A', found {text[at:][:20]!r}"
    return ExpressionError(message, at, "write names as ${name}")


def _look_up(reference: Name | Reference, scope: Scope) -> Value:
    try:
        return scope[reference.name]
    except KeyError:
        raise UnknownName(reference.name, reference.start) from None


def _number(reference: Name | Reference, scope: Scope) -> Number:
    value = _look_up(reference, scope)
    if isinstance(value, str):
        message = f"'${{{reference.name}}}' is the word {value!r}, not a quantity"
        raise ExpressionError(message, reference.start)
    return value
