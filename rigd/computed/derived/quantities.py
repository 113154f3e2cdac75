"""Finds what Python's grammar does not know in a formula: ``0.03 m`` and ``${stroke}``."""

from __future__ import annotations

import keyword
import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from rigd.model.units import NO_DIMENSION, Dimension, Unit, parse_unit

_VALUE: Final = re.compile(
    r"\$\{\s*(?P<name>[A-Za-z_][\w.]*)\s*\}|(?<![\w.])(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
)
_FACTOR: Final = re.compile(
    r"(?:1[ \t]*/[ \t]*)?(?P<word>[A-Za-zµμΩ°%]+)(?:\^-?\d+|[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+|\d+)?(?![\w.(])"
)
_JOIN: Final = re.compile(r"[ \t]*[/·][ \t]*|[ \t]+")
_COMMA: Final = re.compile(r"(?<![\w.])(\d+),(\d+)(?=\s*[A-Za-zµμΩ°%])")
_SEPARATED: Final = re.compile(r"(?<![\w.])\d[\d.]*(?:[eE][-+]?\d+)?_[\d_.]*\d")
#: What stands in place of a quantity; no channel can have this name.
STAND_IN: Final = "_q"


class FormulaError(ValueError):
    """A formula is wrong; ``offset`` counts characters from its start.

    ``lacks`` is the channel or constant that the rig does not have, if that is what is wrong.
    """

    def __init__(
        self, message: str, offset: int = 0, hint: str | None = None, *, lacks: str = ""
    ) -> None:
        super().__init__(message)
        self.offset = offset
        self.hint = hint
        self.lacks = lacks


#: A quantity: value in SI, dimension, and the unit if that has a zero of its own (``degC``), or "".
Stated = tuple[float, Dimension, str]
#: ``named(name, offset)``: returns the quantity that is written ``${name}``.
Named = Callable[[str, int], Stated]


def stated(value: float, unit: Unit) -> Stated:
    """Return an SI value that was given in ``unit``."""
    return value, unit.dimension, unit.symbol if unit.offset else ""


def no_names(name: str, offset: int) -> Stated:
    """Refuse ``${name}``: a rig file has no parameters.

    Raises:
        FormulaError: always.
    """
    hint = "channels are written bare, as device.channel; constants as rig.NAME"
    raise FormulaError(f"unknown name '${{{name}}}'", offset, hint)


@dataclass(frozen=True)
class Prepared:
    """A formula for Python's parser: ``text`` has ``_q0``, ``_q1`` ... in place of quantities.

    ``quantities`` are what they are; ``spans`` their places: first and end in
    ``text``, first and end in the original.
    """

    text: str
    quantities: tuple[Stated, ...]
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


def prepare(text: str, named: Named = no_names) -> Prepared:
    """Return ``text`` with its quantities taken out, and what ``named`` knows by ``${name}``.

    A unit ends before an operator other than ``/``, a channel, a function or a word such as
    ``and``; factors are joined by a space, ``·`` or ``/``: ``2 N m``, ``3 m/s^2``.

    Raises:
        FormulaError: a number with an unknown unit, with a decimal comma, or with ``_`` between its
            digits; an unknown name.
    """
    separated = _SEPARATED.search(text)
    if separated is not None:
        raise FormulaError(
            "a number has no '_' between its digits", separated.start(),
            f"write {separated[0].replace('_', '')}",
        )  # fmt: skip
    comma = _COMMA.search(text)
    if comma is not None:
        raise FormulaError(
            "use a decimal point, not a comma", comma.end(1), f"write {comma[1]}.{comma[2]}"
        )
    quantities: list[Stated] = []
    spans: list[tuple[int, int, int, int]] = []
    out, at = "", 0
    for found in _VALUE.finditer(text):
        if found.start() < at:  # inside the unit of the number before: the power in m/s2
            continue
        if found["name"] is None:
            quantity, end = _quantity(text, found)
        else:
            quantity, end = named(found["name"], found.start()), found.end()
        out += text[at : found.start()]
        name = f"{STAND_IN}{len(quantities)}"
        spans.append((len(out), len(out) + len(name), found.start(), end))
        out += name
        quantities.append(quantity)
        at = end
    return Prepared(out + text[at:], tuple(quantities), tuple(spans))


def _quantity(text: str, number: re.Match[str]) -> tuple[Stated, int]:
    """Return the quantity that begins with ``number``, and where it ends."""
    end, unit = _unit(text, number.end())
    value = float(number[0])
    if not math.isfinite(value):
        raise FormulaError(f"{number[0]} is too large a number", number.start())
    if unit is None:
        return (value, NO_DIMENSION, ""), end
    return stated(unit.to_si(value), unit), end


def _unit(text: str, at: int) -> tuple[int, Unit | None]:
    """Return where the unit after a number ends, and the unit, if there is one."""
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
    return end, parse_unit(text[begin:end])
