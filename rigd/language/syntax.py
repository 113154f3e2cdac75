"""Parses expressions and conditions to a tree with places; evaluates nothing.

The grammar, for all that rigd reads::

    any        = all { "or" all }
    all        = not { "and" not }
    not        = "not" not | comparison [ "for" sum ]
    comparison = sum { ( "<" | ">" | "<=" | ">=" | "==" | "!=" | "contains" ) sum }
               | sum "in" "(" sum { "," sum } ")"
               | sum "is" [ "not" ] word
    sum        = product { ( "+" | "-" ) product }
    product    = factor { ( "*" | "/" ) factor }
    factor     = ( "-" | "+" ) factor | part [ "**" factor ]
    part       = number [ unit ] | "${" name "}" | name | name "(" any { "," any } ")" | "(" any ")"
               | "[" any { "," any } "]" | "|" sum "|" | "text" | date

What a reader does not take of it, it refuses at its place: a formula has no text, a search no sum.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import lru_cache
from typing import Final, NamedTuple, TypeAlias

from rigd.language.number import ExpressionError, Number, number_in
from rigd.language.tokens import INSTEAD, KEYWORDS, Token, Tokens
from rigd.model.units import Unit

#: Most characters of an expression; people cannot read a longer one.
MAX_LENGTH: Final = 300
#: How deep an expression may nest.
MAX_DEPTH: Final = 30
_COMPARISONS: Final = frozenset(("<", ">", "<=", ">=", "==", "!=", "contains"))


class Literal(NamedTuple):
    """A quantity, its unit and how it is written; each part has where it begins and ends."""

    start: int
    end: int
    number: Number
    unit: Unit | None
    text: str


class Reference(NamedTuple):
    """``${name}``, whose value is looked up."""

    start: int
    end: int
    name: str


class Name(NamedTuple):
    """A name written bare: ``device.channel``, a field, or a word."""

    start: int
    end: int
    name: str


class Text(NamedTuple):
    """A text in quotes; ``is_date``: a date without them."""

    start: int
    end: int
    text: str
    is_date: bool = False


class Items(NamedTuple):
    """A list in square brackets."""

    start: int
    end: int
    items: tuple[Node, ...]


class FunctionCall(NamedTuple):
    """A function and what it takes; ``|x|`` is ``abs(x)``."""

    start: int
    end: int
    name: str
    items: tuple[Node, ...]


class Operation(NamedTuple):
    """Operands of ``+ - * / **``, ``not``, ``and`` or ``or``; ``-`` has one or two."""

    start: int
    end: int
    sign: str
    operands: tuple[Node, ...]


class ComparisonChain(NamedTuple):
    """Operands with a sign between each two; behind ``in`` all others are what it may be."""

    start: int
    end: int
    signs: tuple[str, ...]
    operands: tuple[Node, ...]


class State(NamedTuple):
    """``x is word``, or ``x is not word``."""

    start: int
    end: int
    subject: Node
    word: Name
    is_so: bool


class HeldCondition(NamedTuple):
    """A condition that holds for a time."""

    start: int
    end: int
    condition: Node
    time: Node


Node: TypeAlias = (
    Literal
    | Reference
    | Name
    | Text
    | Items
    | FunctionCall
    | Operation
    | ComparisonChain
    | State
    | HeldCondition
)


def children(node: Node) -> tuple[Node, ...]:
    """Return the parts of ``node``."""
    match node:
        case Items(items=parts) | FunctionCall(items=parts):
            return parts
        case Operation(operands=parts) | ComparisonChain(operands=parts):
            return parts
        case State(subject=subject, word=word):
            return (subject, word)
        case HeldCondition(condition=condition, time=time):
            return (condition, time)
    return ()


def parts(node: Node) -> Iterator[Node]:
    """Yield ``node`` and all its parts, from left to right."""
    yield node
    for child in children(node):
        yield from parts(child)


@lru_cache(maxsize=4096)
def parse(text: str, longest: int = MAX_LENGTH, *, is_search: bool = False) -> Node:
    """Return the tree of ``text``; ``is_search``: it may have dates, and names with a dash.

    Raises:
        ExpressionError: it is no expression; with the place.
    """
    if len(text) > longest:
        raise ExpressionError(f"{len(text)} characters: an expression has at most {longest}")
    parser = _Parser(text, is_search=is_search)
    node = parser.any(0)
    parser.finish()
    return node


class _Parser(Tokens):
    def finish(self) -> None:
        """Refuse what stands behind the expression."""
        token = self.token
        match token.text:
            case "":
                return
            case "if" | "else":
                hint = "write where(condition, x, y): x while the condition holds, else y"
                raise ExpressionError("'if' is not known here", token.start, hint)
            case ",":
                message = "a ',' stands between the values of a function or a list"
                raise ExpressionError(message, token.start, "a decimal point is a '.'")
            case "|":
                raise ExpressionError("unknown sign '|'", token.start, "write 'or', or '|x|'")
            case sign if sign in INSTEAD:
                write = f"write {INSTEAD[sign]!r}"
                raise ExpressionError(f"unknown sign {sign!r}", token.start, write)
        hint = (
            "names are written as device.channel or ${name}, quantities as '5 N'; join conditions "
            "with 'and' or 'or'"
        )
        raise ExpressionError(f"cannot read {self.text[token.start :][:20]!r}", token.start, hint)

    def take(self, *signs: str) -> Token | None:
        """Return the next token if it is one of ``signs``, and go on behind it."""
        token = self.token
        return self.next() if token.text in signs and token.kind in ("sign", "name") else None

    def expect(self, sign: str) -> Token:
        token = self.take(sign)
        if token is None:
            if self.token.text in (*INSTEAD, "if"):
                self.finish()
            raise ExpressionError(f"a {sign!r} is missing", self.token.start)
        return token

    def any(self, depth: int) -> Node:
        return self._joined("or", self.all, depth)

    def all(self, depth: int) -> Node:
        return self._joined("and", self.negated, depth)

    def _joined(self, word: str, part: Callable[[int], Node], depth: int) -> Node:
        operands = [part(depth)]
        while self.take(word):
            operands.append(part(depth))
        if len(operands) == 1:
            return operands[0]
        return Operation(operands[0].start, operands[-1].end, word, tuple(operands))

    def negated(self, depth: int) -> Node:
        token = self.take("not")
        if token is not None:
            inside = self.negated(self.deeper(depth))
            return Operation(token.start, inside.end, "not", (inside,))
        node = self.comparison(depth)
        if self.take("for") is None:
            return node
        time = self.sum(depth)
        return HeldCondition(node.start, time.end, node, time)

    def comparison(self, depth: int) -> Node:
        left = self.sum(depth)
        if self.take("is"):
            is_so = self.take("not") is None
            token = self.token
            if token.kind != "name" or token.text in KEYWORDS:
                raise ExpressionError("a word is missing after 'is'", token.start)
            self.next()
            word = Name(token.start, token.end, token.text)
            return State(left.start, word.end, left, word, is_so)
        if self.take("in"):
            self.expect("(")
            items, end = self.listed(")", depth)
            return ComparisonChain(left.start, end, ("in",) * len(items), (left, *items))
        operands, signs = [left], []
        while (sign := self.take(*_COMPARISONS)) is not None:
            signs.append(sign.text)
            operands.append(self.sum(depth))
        if not signs:
            return left
        return ComparisonChain(left.start, operands[-1].end, tuple(signs), tuple(operands))

    def sum(self, depth: int) -> Node:
        left = self.product(depth)
        while (sign := self.take("+", "-")) is not None:
            right = self.product(depth)
            left = Operation(left.start, right.end, sign.text, (left, right))
        return left

    def product(self, depth: int) -> Node:
        left = self.factor(depth)
        while (sign := self.take("*", "/")) is not None:
            right = self.factor(depth)
            left = Operation(left.start, right.end, sign.text, (left, right))
        return left

    def factor(self, depth: int) -> Node:
        sign = self.take("-", "+")
        if sign is not None:
            number = self.token
            inside = self.factor(self.deeper(depth))
            if sign.text == "+":
                return inside
            if number.kind == "number" and isinstance(inside, Literal):  # -20 degC is 253.15 K
                return self.literal(number, sign)
            return Operation(sign.start, inside.end, "-", (inside,))
        base = self.part(depth)
        if self.take("**") is None:
            return base
        power = self.factor(self.deeper(depth))
        return Operation(base.start, power.end, "**", (base, power))

    def part(self, depth: int) -> Node:
        token = self.token
        match token.kind:
            case "number":
                self.next()
                return self.literal(token)
            case "reference":
                self.next()
                return Reference(token.start, token.end, token.text)
            case "text" | "date":
                self.next()
                text = token.text if token.kind == "date" else token.text[1:-1]
                return Text(token.start, token.end, text, token.kind == "date")
            case "name" if token.text not in KEYWORDS:
                self.next()
                if self.token.text != "(" or self.token.start != token.end:
                    return Name(token.start, token.end, token.text)
                self.next()
                items, end = self.listed(")", depth)
                return FunctionCall(token.start, end, token.text, items)
            case "sign" if token.text == "(":
                self.next()
                inside = self.any(self.deeper(depth))
                return inside._replace(start=token.start, end=self.expect(")").end)
            case "sign" if token.text == "[":
                self.next()
                items, end = self.listed("]", depth)
                return Items(token.start, end, items)
            case "sign" if token.text == "|":
                self.next()
                inside = self.sum(self.deeper(depth))
                return FunctionCall(token.start, self.expect("|").end, "abs", (inside,))
        if token.text in INSTEAD or token.text == "if":
            self.finish()
        if token.kind == "end":
            raise ExpressionError("a value is missing here", token.start)
        found = self.text[token.start :][:20]
        raise ExpressionError(f"expected a quantity such as '1.5 A', found {found!r}", token.start)

    def literal(self, token: Token, sign: Token | None = None) -> Literal:
        start = token.start if sign is None else sign.start
        number = _number(token, 1.0 if sign is None else -1.0)
        return Literal(start, token.end, number, token.unit, self.text[start : token.end])

    def listed(self, closing: str, depth: int) -> tuple[tuple[Node, ...], int]:
        """Return the values up to the sign ``closing``, and where that ends."""
        end = self.take(closing)
        if end is not None:
            return (), end.end
        items = [self.any(self.deeper(depth))]
        while self.take(","):
            items.append(self.any(self.deeper(depth)))
        return tuple(items), self.expect(closing).end

    def deeper(self, depth: int) -> int:
        if depth >= MAX_DEPTH:
            message = f"the expression nests deeper than {MAX_DEPTH}"
            raise ExpressionError(message, self.token.start)
        return depth + 1


def _number(token: Token, sign: float) -> Number:
    value = sign * token.value
    return Number(value) if token.unit is None else number_in(token.unit.to_si(value), token.unit)
