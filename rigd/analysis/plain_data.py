"""Converts result dataclasses to plain data for JSON, from which `--json` prints."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from datetime import date
from enum import Enum
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np


@runtime_checkable
class Shaped(Protocol):
    """A dataclass whose JSON object has other keys than its fields."""

    def shape(self) -> Mapping[str, object]:
        """Return the fields of the object in order, each a value that :func:`plain` takes."""


def plain(value: object) -> object:
    """Return ``value`` as ``json.dumps(..., allow_nan=False)`` takes it.

    A dataclass becomes an object of its fields, or of its :class:`Shaped` keys; an array, list or
    tuple a list; an enum its value; a path or day its text; NaN and infinities become None.

    Raises:
        TypeError: there is no rule for such a value.
    """
    match value:
        case Enum():
            return plain(value.value)
        case None | bool() | str() | int():
            return value
        case float():
            return float(value) if math.isfinite(value) else None
        case Mapping():
            return {str(key): plain(item) for key, item in value.items()}
        case list() | tuple():
            return [plain(item) for item in value]
        case np.ndarray() | np.generic():
            return plain(value.tolist())
        case Path() | date():
            return str(value)
        case Shaped():
            return plain(value.shape())
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in fields(value)}
    raise TypeError(f"{type(value).__name__} has no JSON form: {value!r}")


def plain_object(value: object) -> dict[str, object]:
    """Return ``value``, a dataclass or mapping, as an object for ``json.dumps``.

    Raises:
        TypeError: it becomes no object, or holds a value that :func:`plain` has no rule for.
    """
    found = plain(value)
    if not isinstance(found, dict):
        raise TypeError(f"{type(value).__name__} becomes no JSON object")
    return found
