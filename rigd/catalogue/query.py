"""Parses the conditions of ``rigd runs --where``; evaluates nothing.

The grammar::

    any        = all { "or" all }
    all        = not { "and" not }
    not        = "not" not | "(" any ")" | comparison
    comparison = field ( "==" | "!=" | "<" | "<=" | ">" | ">=" | "contains" ) value
               | field "in" "(" value { "," value } ")"
               | field "is" ( "missing" | "known" )
    value      = "text" | date | number [ unit ] | word
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final, TypeAlias

from rigd.catalogue.values import DATE, Period, Value, period_of, value_of
from rigd.model.errors import ConfigError, Place
from rigd.model.units import parse_unit

#: Stands in the place of the file in an error.
SOURCE: Final = "--where"
_MAX_LENGTH: Final = 1000
_MAX_DEPTH: Final = 20
_SIGNS: Final = ("==", "!=", "<=", ">=", "<", ">")
_KEYWORDS: Final = ("and", "or", "not", "in", "is", "contains")
_FACTOR: Final = rf"(?!(?:{'|'.join(_KEYWORDS)})\b)[A-Za-zµμΩ°%]+(?:\^-?\d+|[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+|\d+)?"
_TOKEN: Final = re.compile(
    rf"""(?P<text>"[^"]*"|'[^']*')
    |(?P<date>\d{{4}}-\d{{2}}(?!\d)
        (?:-\d{{2}}(?:[T\ ]\d{{2}}:\d{{2}}(?::\d{{2}})?(?:Z|[+-]\d{{2}}:\d{{2}})?)?)?)
    |(?P<number>[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)
        (?P<unit>[ \t]*(?:1[ \t]*/[ \t]*)?{_FACTOR}(?:(?:[ \t]*[/*·][ \t]*|[ \t]+){_FACTOR})*)?
    |(?P<word>[^\W\d][\w-]*(?:\.[\w-]+)*)
    |(?P<sign>[=!]=|[<>]=?|=|~|&&?|\|\|?|[(),\[\]!])""",
    re.VERBOSE,
)
_SPACE: Final = re.compile(r"\s*")
#: Signs of other languages, and what is written here.
_INSTEAD: Final = {
    "=": "==", "~": "contains", "&": "and", "&&": "and", "|": "or", "||": "or", "!": "not",
    "[": "(", "]": ")",
}  # fmt: skip


@dataclass(frozen=True)
class Operand:
    """A value of a condition; ``period`` if it is a date, ``quoted`` if it stood in quotes."""

    value: Value
    offset: int = 0
    period: Period | None = None
    quoted: bool = True


@dataclass(frozen=True)
class FieldTest:
    """A field beside values; ``sign`` is one of the comparisons, ``contains`` or ``in``."""

    field: str
    sign: str
    values: tuple[Operand, ...]
    offset: int | None = None  #: of the field in its text; None: made by :func:`equal`


@dataclass(frozen=True)
class Presence:
    """Whether a field is stated at all."""

    field: str
    is_known: bool
    offset: int


@dataclass(frozen=True)
class Joined:
    """Conditions of which all must hold, or any."""

    word: str  #: ``and`` or ``or``
    parts: tuple[Condition, ...]


@dataclass(frozen=True)
class Negated:
    """A condition that must not hold."""

    condition: Condition


Condition: TypeAlias = FieldTest | Presence | Joined | Negated


def equal(field: str, text: str) -> FieldTest:
    """Return the condition that a field has a value, as text or as the same quantity."""
    return FieldTest(field, "==", (Operand(value_of(text), 0, period_of(text)),))


def since(start: float) -> FieldTest:
    """Return the condition that a run was recorded at ``start`` (s since 1970, UTC) or later."""
    literal = Operand(Value(str(start), start, DATE), 0, Period(start, start), quoted=False)
    return FieldTest("started", ">=", (literal,))


def wrong(offset: int | None, message: str, hint: str | None = None) -> ConfigError:
    """Return the error of a condition at ``offset`` characters from its start."""
    place = None if offset is None else Place(SOURCE, 1, offset + 1)
    return ConfigError(message, place=place, hint=hint)


def parse_where(text: str) -> Condition:
    """Return the condition written as ``text``.

    Raises:
        ConfigError: it is no condition; names the place.
    """
    if len(text) > _MAX_LENGTH:
        raise wrong(0, f"the condition has {len(text)} letters, at most {_MAX_LENGTH} are allowed")
    parser = _Parser(text)
    condition = parser.any(0)
    token = parser.peek()
    if token is not None:
        raise wrong(parser.start, f"unexpected {token[0]!r}", "join conditions with 'and' or 'or'")
    return condition


class _Parser:
    def __init__(self, text: str) -> None:
        self._text = text
        self._at = 0
        self.start = 0  #: of the token that :meth:`peek` saw

    def peek(self) -> re.Match[str] | None:
        """Return the next token, None at the end."""
        space = _SPACE.match(self._text, self._at)
        self.start = self._at if space is None else space.end()
        if self.start == len(self._text):
            return None
        token = _TOKEN.match(self._text, self.start)
        if token is None:
            rest = self._text[self.start :]
            if rest[0] in "\"'":
                raise wrong(self.start, "a quotation mark is not closed")
            raise wrong(self.start, f"cannot read {rest[:20]!r}")
        sign = token["sign"]
        if sign in _INSTEAD:
            raise wrong(self.start, f"unknown sign {sign!r}", f"write {_INSTEAD[sign]!r}")
        return token

    def take(self, *wanted: str) -> str | None:
        """Return the next token if it is one of ``wanted``, and go on behind it."""
        token = self.peek()
        if token is None or token[0] not in wanted:
            return None
        self._at = token.end()
        return token[0]

    def any(self, depth: int) -> Condition:
        parts = [self.all(depth)]
        while self.take("or"):
            parts.append(self.all(depth))
        return parts[0] if len(parts) == 1 else Joined("or", tuple(parts))

    def all(self, depth: int) -> Condition:
        parts = [self.single(depth)]
        while self.take("and"):
            parts.append(self.single(depth))
        return parts[0] if len(parts) == 1 else Joined("and", tuple(parts))

    def single(self, depth: int) -> Condition:
        if depth > _MAX_DEPTH:
            raise wrong(self._at, f"brackets nest deeper than {_MAX_DEPTH}")
        if self.take("not"):
            return Negated(self.single(depth + 1))
        if self.take("("):
            inside = self.any(depth + 1)
            self.expect(")")
            return inside
        return self.comparison()

    def comparison(self) -> Condition:
        field, offset = self.field()
        if self.take("is"):
            word = self.take("missing", "known")
            if word is None:
                raise self.expected("'missing' or 'known'")
            return Presence(field, word == "known", offset)
        if self.take("in"):
            self.expect("(")
            values = [self.value()]
            while self.take(","):
                values.append(self.value())
            self.expect(")")
            return FieldTest(field, "in", tuple(values), offset)
        sign = self.take(*_SIGNS, "contains")
        if sign is None:
            raise self.expected(f"a comparison after {field!r}", f'such as {field} == "..."')
        return FieldTest(field, sign, (self.value(),), offset)

    def field(self) -> tuple[str, int]:
        token = self.peek()
        if token is None or token["word"] is None or token[0] in _KEYWORDS:
            raise self.expected("the name of a field", 'such as specimen.coating == "PTFE"')
        self._at = token.end()
        return token[0], token.start()

    def value(self) -> Operand:
        token = self.peek()
        if token is None or token["sign"] is not None or token[0] in _KEYWORDS:
            raise self.expected("a value", 'a "text", a date, a number with its unit')
        self._at = token.end()
        start = token.start()
        if token["text"] is not None:
            text = token[0][1:-1]
            return Operand(value_of(text), start, period_of(text))
        if token["word"] is not None:
            return Operand(Value(token[0]), start, quoted=False)
        period = period_of(token[0]) if token["date"] is not None else None
        if token["date"] is not None:
            if period is None:
                raise wrong(start, f"there is no date {token[0]}", "write 2026-09-01")
            return Operand(Value(token[0], period.start, DATE), start, period, quoted=False)
        value = value_of(token[0])
        if value.number is None:
            try:
                parse_unit((token["unit"] or "").strip())
            except ValueError as error:
                raise wrong(token.start("unit"), str(error)) from error
            raise wrong(start, f"cannot read {token[0]!r}")
        return Operand(value, start, quoted=False)

    def expect(self, sign: str) -> None:
        if self.take(sign) is None:
            raise self.expected(repr(sign))

    def expected(self, what: str, hint: str | None = None) -> ConfigError:
        """Return the error that ``what`` is missing here."""
        token = self.peek()
        found = "" if token is None else f", not {token[0]!r}"
        return wrong(self.start, f"expected {what}{found}", hint)
