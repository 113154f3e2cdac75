"""Builds the patterns by which the JSON Schema checks quantities and conditions in an editor.

A pattern refuses simple mistakes, and nothing that ``rigd check`` accepts. A text that is more than
a number and one symbol may be an expression; ``rigd check`` checks such a text.
"""

from __future__ import annotations

import re
from functools import cache
from typing import Any, Final

from rigd.model.units import NO_DIMENSION, PREFIXES, parse_unit, symbols

_NUMBER: Final = r"[-+\s]*(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?"
#: What a condition must contain, and what it never contains.
_CONDITION: Final = r"^(?![\s\S]*(?:=|&|\|\||\s[oO][rR]\s))(?=[\s\S]*(?:[<>]|\sis\s))"


@cache
def quantity_schema(unit: str | None = None) -> dict[str, Any]:
    """Return the schema of a quantity of the kind of ``unit``, or of any kind.

    If ``unit`` has a dimension, the bare number that an editor reads from ``0.5`` is refused; so
    are a symbol of another kind or of none, and a decimal comma.
    """
    prefixed, bare = symbols(unit)
    found = f"[{''.join(PREFIXES)}]?(?:{_any_of(prefixed)})"
    known = "|".join(filter(None, [found if prefixed else "", _any_of(bare)]))
    is_bare = unit is None or parse_unit(unit).dimension == NO_DIMENSION
    optional = "?" if is_bare else ""
    pattern = (
        rf"^{_NUMBER}[ \t]*(?:{known}){optional}\s*$"
        rf"|^(?!{_NUMBER}[ \t]*[A-Za-zµμΩ°%]*\s*$)[^,]*(?:\([\s\S]*)?$"
    )
    description = "a number with its unit, such as '1.5 A'"
    if unit is not None:
        description = f"a number with a unit of the kind of {unit}, such as '1 {unit}'"
    return {
        "type": ["string", "number"] if is_bare else "string",
        "pattern": pattern,
        "patternErrorMessage": f"{description}, or an expression",
    }


def condition_schema() -> dict[str, Any]:
    """Return the schema of an end condition."""
    return {
        "pattern": _CONDITION,
        "patternErrorMessage": "such as 'carriage.position > 1.15 m' or 'scale is stable', joined "
        "by 'and'; a list ends with any of its conditions",
    }


def _any_of(words: list[str]) -> str:
    return "|".join(map(re.escape, words))
