"""Reads whole numbers that are text, as every scalar of a rig file is.

Pydantic reads ``"2"`` as a whole number, but not as one of the choices of ``Literal[1, 2]`` or of
an ``Enum`` with numbers, and no ``"0x40"``, which is how manuals give registers and objects.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from pydantic_core import CoreSchema, core_schema


def accept_text(schema: CoreSchema, resolve: Callable[[CoreSchema], CoreSchema]) -> CoreSchema:
    """Return ``schema`` with each choice of numbers and each whole number in it read from text.

    ``resolve`` returns the schema that a reference stands for.
    """
    return _read(schema, resolve)  # type: ignore[no-any-return]  # a schema is made of plain data


def _read(part: Any, resolve: Callable[[CoreSchema], CoreSchema]) -> Any:
    match part:
        case {"type": "function-before", "function": {"function": partial(func=done)}} if (
            done is _number
        ):
            return part  # of a model within this one, which has been here
        case {"type": "literal", "expected": choices}:
            return _numbered(part, choices)
        case {"type": "definition-ref"}:
            meant: Any = resolve(part)
            members = meant["members"] if meant["type"] == "enum" else []
            return _numbered(part, [member.value for member in members])
        case {"type": "int"}:
            return core_schema.no_info_before_validator_function(partial(_number, None), part)
        case dict():
            return {
                key: item if key == "metadata" else _read(item, resolve)
                for key, item in part.items()
            }
        case list() | tuple():
            return type(part)(_read(item, resolve) for item in part)
    return part


def _numbered(part: Any, choices: list[Any]) -> Any:
    numbers = [item for item in choices if isinstance(item, int) and not isinstance(item, bool)]
    if not numbers:
        return part
    return core_schema.no_info_before_validator_function(partial(_number, frozenset(numbers)), part)


def _number(choices: frozenset[int] | None, value: object) -> object:
    """Return the number that ``value`` is the text of, if it is one of ``choices``."""
    if not isinstance(value, str):
        return value
    try:
        number = int(value, 0)
    except ValueError:
        return value
    return number if choices is None or number in choices else value
