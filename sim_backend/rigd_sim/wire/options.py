"""Reads the options of a fault and refuses unknown ones."""

from __future__ import annotations

from collections.abc import MutableMapping
from typing import Any, TypeVar

T = TypeVar("T", int, float, str, bool)


def take(given: MutableMapping[str, Any], name: str, default: T | None, kind: type[T]) -> T | None:
    """Remove option ``name`` from ``given`` and return it, or ``default``.

    Raises:
        ValueError: it is not of ``kind``.

    """
    value = given.pop(name, default)
    if value is None:
        return None
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    if not isinstance(value, kind) or isinstance(value, bool) is not (kind is bool):
        raise ValueError(f"option {name!r} is {value!r}, expected {kind.__name__}")
    return value


def number(
    given: MutableMapping[str, Any], name: str, default: float | None, *, low: float, high: float
) -> float:
    """Remove number ``name`` from ``given`` and return it; needed if there is no ``default``.

    Raises:
        ValueError: it is missing, no number, or outside ``low`` to ``high``.

    """
    value = take(given, name, default, float)
    if value is None:
        raise ValueError(f"option {name!r} is missing: a number from {low:g} to {high:g}")
    if not low <= value <= high:
        raise ValueError(f"option {name!r} is {value:g}, expected {low:g} to {high:g}")
    return value


def whole(
    given: MutableMapping[str, Any], name: str, default: int | None, *, low: int, high: int
) -> int:
    """Remove whole number ``name`` from ``given`` and return it; see :func:`number`.

    Raises:
        ValueError: it is missing, not a whole number, or outside ``low`` to ``high``.

    """
    value = take(given, name, default, int)
    if value is None:
        raise ValueError(f"option {name!r} is missing: a whole number from {low} to {high}")
    if not low <= value <= high:
        raise ValueError(f"option {name!r} is {value}, expected {low} to {high}")
    return value
