"""Finds the quantities in a formula (``0.03 m``), which Python's grammar does not know."""

from __future__ import annotations

import keyword
import math
import re
from dataclasses import dataclass
from typing import Final

from rigd.model.units import NO_DIMENSION, Dimension, parse_unit

_NUMBER: Final = re.compile(r"(?<![\w.])(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_FACTOR: Final = re.compile(
    r"(?:1[ \t]*/[ \t]*)?(?P<word>[A-Za-zµμΩ°%]+)(?:\^-?\d+|[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+|\d+)?(?![\w.(])"
)
_JOIN: Final = re.compile(r"[ \t]*[/·][ \t]*|[ \t]+")
_COMMA: Final = re.compile(r"(?<![\w.])(\d+),(\d+)(?=\s*[A-Za-zµμΩ°%])")
#: What stands in place of a quantity; no channel can have this name.
STAND_IN: Final = "_q"


class FormulaError(ValueError):
    """A formula is wrong; ``offset`` counts characters from its start."""

    def __init__(self, message: str, offset: int = 0, hint: str | None = None) -> None:
        super().__init__(message)
        self.offset = offset
        self.hint = hint


@dataclass(frozen=True)
class Prepared:
    """A formula for Python's parser: ``text`` has ``_q0``, ``_q1`` ... in place of quantities.

    ``quantities`` are their values in SI and dimensions; ``spans`` their places: first and end in
    ``text``, first and end in the original.
    """

    text: str
    quantities: tuple[tuple[float, Dimension], ...]
    spans: tuple[tuple[int, int, int, int], ...]

    def original(self, column: int) -> int:
        """Return the offset in the original of a ``column`` of ``text``."""
        shift = 0
        for begin, end, start, stop in self.spans:
            if begin <= column < end:
                return start
            if column >= end:
                shift = stop - end
        return column + shift


def prepare(text: str) -> Prepared:
    """Return ``text`` with its quantities taken out.

    A unit ends before an operator other than ``/``, a channel, a function or a word such as
    ``and``; factors are joined by a space, ``·`` or ``/``: ``2 N m``, ``3 m/s^2``.

    Raises:
        FormulaError: a number with an unknown unit, or with a decimal comma.
    """
    comma = _COMMA.search(text)
    if comma is not None:
        raise FormulaError(
            "use a decimal point, not a comma", comma.end(1), f"write {comma[1]}.{comma[2]}"
        )
    quantities: list[tuple[float, Dimension]] = []
    spans: list[tuple[int, int, int, int]] = []
    out, at = "", 0
    for number in _NUMBER.finditer(text):
        if number.start() < at:  # inside the unit of the number before: the power in m/s2
            continue
        end, unit = _unit(text, number.end())
        value = float(number[0])
        if not math.isfinite(value):
            raise FormulaError(f"{number[0]} is too large a number", number.start())
        factor, dimension = (1.0, NO_DIMENSION) if unit is None else unit
        out += text[at : number.start()]
        name = f"{STAND_IN}{len(quantities)}"
        spans.append((len(out), len(out) + len(name), number.start(), end))
        out += name
        quantities.append((value * factor, dimension))
        at = end
    return Prepared(out + text[at:], tuple(quantities), tuple(spans))


def _unit(text: str, at: int) -> tuple[int, tuple[float, Dimension] | None]:
    """Return where the unit after a number ends, with its factor and dimension, if there is one."""
    begin = at + len(text[at:]) - len(text[at:].lstrip(" \t"))
    first = _FACTOR.match(text, begin)
    if first is None or keyword.iskeyword(first["word"]):
        return at, None
    try:
        parse_unit(first[0])
    except ValueError as error:
        raise FormulaError(str(error), begin) from error
    end = first.end()
    while (join := _JOIN.match(text, end)) is not None:
        factor = _FACTOR.match(text, join.end())
        if factor is None or factor[0].startswith("1") or keyword.iskeyword(factor["word"]):
            break
        try:
            parse_unit(text[begin : factor.end()])
        except ValueError:
            break
        end = factor.end()
    unit = parse_unit(text[begin:end])
    return end, (unit.factor, unit.dimension)
