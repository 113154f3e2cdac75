"""Splits an expression into tokens; a number and its unit are one.

A unit ends before a number, a bracket, a ``$``, a sign other than ``/ * ·``, a channel, a function
and a word of the language, so ``2 m / ${time}`` and ``2 m / cart.speed`` divide.
"""

from __future__ import annotations

import math
import re
from typing import Final, Literal, NamedTuple

from rigd.language.number import ExpressionError
from rigd.model.units import Unit, odd_character, parse_unit

#: Words that are no names.
KEYWORDS: Final = frozenset(
    ("and", "or", "not", "in", "is", "contains", "for", "if", "else", "AND", "OR")
)
#: A reference to a name.
NAME: Final = re.compile(r"\$\{\s*([a-z][a-z0-9_]*(?:\.[a-z][a-z0-9_]*)?)\s*\}")
#: Signs of other languages, and what is written here.
INSTEAD: Final = {
    "=": "==", "~": "contains", "&": "and", "&&": "and", "||": "or", "!": "not", "^": "**",
    "AND": "and", "OR": "or",
}  # fmt: skip

Kind = Literal["number", "reference", "name", "text", "date", "sign", "end"]


class Token(NamedTuple):
    """A token: what it is, its text, where that begins and ends; of a number, it and its unit."""

    kind: Kind
    text: str
    start: int
    end: int
    value: float = math.nan
    unit: Unit | None = None


_SPACE: Final = re.compile(r"\s*")
_NUMBER: Final = r"(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_DATE: Final = r"\d{4}-\d{2}(?!\d)(?:-\d{2}(?:[T ]\d{2}:\d{2}(?::\d{2})?(?:Z|[+-]\d{2}:\d{2})?)?)?"
_OTHERS: Final = rf"""
    |(?P<number>{_NUMBER})
    |\$\{{\s*(?P<reference>[A-Za-z_][\w.]*)\s*\}}
    |(?P<sign>\*\*|[=!<>]=|&&|\|\||[-+*/<>()\[\],|=~&!^])
    |(?P<text>"[^"]*"|'[^']*')"""
_PLAIN: Final = rf"(?P<name>[^\W\d]\w*(?:\.\w+)*){_OTHERS}|(?P<date>(?!))"
#: In a search: dates, and names with a dash.
_SEARCH: Final = rf"(?P<date>{_DATE})|(?P<name>[^\W\d][\w-]*(?:\.[\w-]+)*){_OTHERS}"
_SEPARATED: Final = re.compile(r"\d[\d.]*(?:[eE][-+]?\d+)?_[\d_.]*\d")
_COMMA: Final = re.compile(r"(\d+),(\d+(\s*[A-Za-zµμΩ°%]\S*)?)")
_FACTOR: Final = re.compile(
    rf"(?!(?:{'|'.join(sorted(KEYWORDS))})\b)(?:1[ \t]*/[ \t]*)?[A-Za-zµμΩ°%]+"
    r"(?:\^-?\d+|[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+|\d+)?(?![\w.(])"
)
_JOIN: Final = re.compile(r"[ \t]*[/*·][ \t]*|[ \t]+")


class Tokens:
    """The tokens of ``text``, one by one; ``token`` is the one that is read next.

    Raises:
        ExpressionError: what begins here is no token; with the place.
    """

    def __init__(self, text: str, *, is_search: bool = False) -> None:
        self.text = text
        self._pattern = re.compile(_SEARCH if is_search else _PLAIN, re.VERBOSE)
        self.token = self._at(0)

    def next(self) -> Token:
        """Return the token that is read next, and go on behind it."""
        token = self.token
        self.token = self._at(token.end)
        return token

    def _at(self, at: int) -> Token:
        space = _SPACE.match(self.text, at)
        start = at if space is None else space.end()
        if start == len(self.text):
            return Token("end", "", start, start)
        match = self._pattern.match(self.text, start)
        if match is None:
            raise self._unreadable(start)
        for kind in ("name", "sign", "reference", "text", "date"):
            if match[kind] is not None:
                return Token(kind, match[kind], start, match.end())
        return self._quantity(start, match.end())

    def _unreadable(self, start: int) -> ExpressionError:
        rest = self.text[start : start + 20]
        if rest[0] in "\"'":
            return ExpressionError("a quotation mark is not closed", start)
        hint = "write names as ${name}" if rest[0] == "$" else None
        return ExpressionError(f"cannot read {rest!r}{odd_character(rest[0])}", start, hint)

    def _quantity(self, start: int, end: int) -> Token:
        text = self.text
        separated = _SEPARATED.match(text, start)
        if separated is not None:
            plain = separated[0].replace("_", "")
            message = "a number has no '_' between its digits"
            raise ExpressionError(message, start, f"write {plain}")
        comma = _COMMA.match(text, start)
        if comma is not None and (comma[3] or not re.search(r"[(\[]", text[:start])):
            message = "use a decimal point, not a comma"
            raise ExpressionError(message, comma.end(1), f"write {comma[1]}.{comma[2]}")
        value = float(text[start:end])
        if not math.isfinite(value):
            raise ExpressionError(f"{text[start:end]} is too large a number", start)
        begin, after = self._unit(end)
        if begin == after:
            return Token("number", text[start:end], start, end, value)
        try:
            unit = parse_unit(text[begin:after])
        except ValueError as error:
            raise ExpressionError(str(error), begin) from error
        return Token("number", text[start:after], start, after, value, unit)

    def _unit(self, end: int) -> tuple[int, int]:
        """Return where the unit behind a number begins and ends, which is one place without."""
        begin = end + len(self.text[end:]) - len(self.text[end:].lstrip(" \t"))
        factor = _FACTOR.match(self.text, begin)
        if factor is None:
            return end, end
        while factor is not None:
            after = factor.end()
            join = _JOIN.match(self.text, after)
            factor = None if join is None else _FACTOR.match(self.text, join.end())
            if factor is not None and factor[0].startswith("1"):
                break
        return begin, after
