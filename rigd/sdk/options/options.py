"""Lists the options of a Config class with kind, unit, default and documentation."""

from __future__ import annotations

import inspect
import types
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Annotated, Any, Final, Literal, Union, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from rigd.model.units import format_quantity
from rigd.sdk.options.documented_model import description
from rigd.sdk.options.quantities import In

_WORDS: Final = {
    str: "text", int: "a whole number", float: "a number", bool: "true or false",
    Path: "a path",
}  # fmt: skip


@dataclass(frozen=True)
class Option:
    """One option in a form for a reader; the name of a nested option is ``part.option``."""

    name: str
    kind: str  #: what to write: ``text``, ``high or low``, ``0.02 s to 1 s``
    unit: str | None  #: unit in which the value is held; None if it is no quantity
    required: bool
    default: str  #: as text; "" if the option is required
    doc: str
    bare: bool = False  #: whether it is a float without a unit


def options_of(model: type[BaseModel]) -> tuple[Option, ...]:
    """Return the options of ``model`` in order, those of its parts behind each."""
    return tuple(_options(model, "", frozenset()))


def _options(model: type[BaseModel], prefix: str, above: frozenset[Any]) -> Iterator[Option]:
    for key, field in model.model_fields.items():
        name = prefix + (field.alias or key)
        annotation = Annotated[(field.annotation, *field.metadata)] if field.metadata else (
            field.annotation
        )  # fmt: skip
        unit = _unit(annotation)
        yield Option(
            name=name,
            kind=_kind(annotation, unit),
            unit=unit,
            required=field.is_required(),
            default=_default(field, unit),
            doc=inspect.cleandoc(description(model, key) or ""),
            bare=_has_bare_float(annotation),
        )
        for part in _parts(annotation):
            if part not in above:  # a part may hold others of its own kind
                yield from _options(part, name + ".", above | {part})


def _unit(annotation: Any) -> str | None:
    for item in getattr(annotation, "__metadata__", ()):
        if isinstance(item, In):
            return item.unit
    return next((unit for item in get_args(annotation) if (unit := _unit(item))), None)


def _has_bare_float(annotation: Any) -> bool:
    if any(isinstance(item, In) for item in getattr(annotation, "__metadata__", ())):
        return False
    return annotation is float or any(
        _has_bare_float(item) for item in get_args(annotation) if not isinstance(item, str)
    )


def _parts(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for item in get_args(annotation):
        yield from _parts(item)


def _kind(annotation: Any, unit: str | None) -> str:
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        inner = _kind(arguments[0], unit)
        return _bounded(inner, arguments[1:], unit if arguments[0] is float else None)
    if origin is Literal:
        return " or ".join(str(argument) for argument in arguments)
    if origin is Union or origin is types.UnionType:
        kinds = [_kind(argument, unit) for argument in arguments if argument is not type(None)]
        return " or ".join(dict.fromkeys(kinds))
    if origin in (tuple, list) and arguments:
        return f"a list of {_kind(arguments[0], unit)}"
    if origin is not None and len(arguments) == 2:
        return f"names with {_kind(arguments[1], unit)} each"
    if isinstance(annotation, type) and issubclass(annotation, Enum):
        return " or ".join(str(item.value) for item in annotation)
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return "keys as below"
    return _WORDS.get(annotation, getattr(annotation, "__name__", str(annotation)))


def _bounded(kind: str, metadata: tuple[Any, ...], unit: str | None) -> str:
    """Return ``kind`` with its bounds: ``0.02 s to 1 s``, ``a whole number of at least 0``."""
    if unit is not None:
        kind = "a pure number" if unit == "1" else f"a quantity in {unit}"

    def shown(bound: Any) -> str:
        return f"{bound}" if unit is None else format_quantity(float(bound), unit)

    bounds = []
    for item in metadata:
        match item:
            case Ge(ge=bound):
                bounds.append(f"at least {shown(bound)}")
            case Gt(gt=bound):
                bounds.append(f"more than {shown(bound)}")
            case Le(le=bound):
                bounds.append(f"at most {shown(bound)}")
            case Lt(lt=bound):
                bounds.append(f"less than {shown(bound)}")
    return f"{kind}, {', '.join(bounds)}" if bounds else kind


def _default(field: FieldInfo, unit: str | None) -> str:
    if field.is_required():
        return ""
    value = field.get_default(call_default_factory=True)
    if value is None:
        return "none"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, Enum):
        return str(value.value)
    if isinstance(value, float) and unit is not None:
        return format_quantity(value, unit)
    if isinstance(value, tuple | list | dict) and not value:
        return "empty"
    if isinstance(value, BaseModel):
        return "as below"
    if isinstance(value, dict):
        return ", ".join(map(str, value))
    return str(value)
