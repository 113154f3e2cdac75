"""Converts parsed YAML to typed objects; every error of pydantic becomes file:line:column."""

from __future__ import annotations

import types
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Final, TypeVar, Union, get_args, get_origin

from pydantic import BaseModel, Tag, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from rigd.config.document import Data, Document, KeyPath
from rigd.config.problems import Problems, suggest
from rigd.config.source import NAME_RULES
from rigd.model.units import format_quantity
from rigd.sdk import In, PlantConfig, WrongEntries
from rigd.sdk.options.documented_model import description

M = TypeVar("M", bound=BaseModel)

#: The expected kind of value, by pydantic's error type.
_EXPECTED: Final = {
    "string_type": "text", "int_parsing": "a whole number", "int_type": "a whole number",
    "int_from_float": "a whole number", "int_parsing_size": "a smaller whole number",
    "float_parsing": "a number", "float_type": "a number", "finite_number": "a finite number",
    "bool_parsing": "true or false", "bool_type": "true or false", "list_type": "a list",
    "tuple_type": "a list", "dict_type": "a mapping of names to values",
    "model_type": "a mapping of keys to values", "mapping_type": "a mapping of names to values",
    "model_attributes_type": "a mapping of keys to values", "path_type": "a path",
}  # fmt: skip
_BOUNDS: Final = {
    "greater_than": ("must be above", "gt"),
    "greater_than_equal": ("must be at least", "ge"),
    "less_than": ("must be below", "lt"),
    "less_than_equal": ("must be at most", "le"),
}


def bind(
    document: Document,
    model: type[M],
    problems: Problems,
    path: KeyPath = (),
    data: Any = None,
    *,
    plant: PlantConfig | None = None,
    period_ns: int | None = None,
) -> M | None:
    """Return the part of ``document`` at ``path`` as ``model``, or None with the problems noted.

    ``data`` replaces the part at ``path`` if the caller has removed keys from it. ``plant`` has the
    options of the rig's plant, ``period_ns`` the time of a cycle, for devices that are checked
    against them.
    """
    try:
        return model.model_validate(
            document.get(path) if data is None else data,
            # the folder for relative paths; plant and cycle below a device
            context={"folder": document.path.parent, "plant": plant, "period_ns": period_ns},
        )
    except ValidationError as error:
        for detail in error.errors(include_url=False):
            _note(document, model, problems, path, detail)
    return None


def _note(
    document: Document,
    model: type[BaseModel],
    problems: Problems,
    base: KeyPath,
    detail: ErrorDetails,
) -> None:
    spot = _locate(document, model, base, detail["loc"])
    where, kind, context = spot.path, detail["type"], detail.get("ctx", {})
    if kind == "missing":
        wanted = detail["loc"][-1]
        doc = _first_line(_description(spot.parent, wanted))
        problems.add(document.place(where), f"key {wanted!r} is missing", doc)
        return
    if kind == "extra_forbidden":
        known = () if spot.parent is None else _names(spot.parent)
        place = document.key_place(where)
        comma = document.get(where) is None and not str(where[-1]).isidentifier()
        problems.add(
            place, f"unknown key {where[-1]!r}", _missing_space(document, where) or (
            "inside braces a comma begins the next key: quote a text that has a comma" if comma
            else suggest(str(where[-1]), known)),
        )  # fmt: skip
        return
    is_key = detail["loc"][-1:] == ("[key]",)  # pydantic's word for the key itself
    space = _missing_space(document, where)
    if space and not is_key:
        return  # the key is the mistake
    written = _written(str(where[-1]) if is_key else document.get(where))
    message, hint = f"{written} is not accepted here", spot.doc
    if isinstance(error := context.get("error"), WrongEntries):
        for below, text in error.problems:
            problems.add(document.place((*where, *below)), text)
        return
    if kind == "value_error":
        message = str(context["error"])
        named = (*where, named_key(message))  # a check of several keys names the wrong one first
        where = named if named in document.values else where
    elif kind in _EXPECTED:
        message = f"expected {_EXPECTED[kind]}, found {written}"
    elif kind in _BOUNDS:
        words, key = _BOUNDS[kind]
        bound = context[key]
        shown = format_quantity(float(bound), spot.unit) if spot.unit else str(bound)
        message = f"{written} {words} {shown}"
    elif kind in ("literal_error", "enum"):
        choices = str(context["expected"]).replace("'", "").replace(" or ", ", ").split(", ")
        message = f"{written} is not one of {', '.join(choices)}"
        near = suggest(str(document.get(where)), choices)
        hint = near if near.startswith("did you mean") else spot.doc  # all stand above
    elif kind == "string_pattern_mismatch":
        rule = NAME_RULES.get(context["pattern"], f"it must match {context['pattern']}")
        message = f"{written} is not a valid name: {rule}"
        hint = space or spot.doc
    elif kind in ("too_short", "string_too_short"):
        message = f"at least {context['min_length']} needed, found {written}"
    elif kind in ("too_long", "string_too_long"):
        message = f"at most {context['max_length']} allowed, found {written}"
    elif kind in ("union_tag_invalid", "union_tag_not_found"):
        message = f"the kind of {written} is unknown"
    place = document.key_place(where) if is_key else document.place(where)
    problems.add(place, message, hint)


@dataclass(frozen=True)
class _Spot:
    """A place in the schema: the path into the document, its model, unit and docstring."""

    path: KeyPath
    parent: type[BaseModel] | None
    unit: str | None
    doc: str | None


def _locate(
    document: Document, model: type[BaseModel], base: KeyPath, loc: Sequence[str | int]
) -> _Spot:
    """Follow pydantic's ``loc`` through schema and document together.

    ``loc`` also names union branches, which the document does not have: they only select the
    annotation.
    """
    annotation: Any = model
    parent: type[BaseModel] | None = None
    path = base
    unit: str | None = None
    doc: str | None = None
    for step in loc:
        annotation, found, is_tag = _strip(annotation, step)
        unit = found or unit
        if is_tag:
            continue
        parent = annotation if _is_model(annotation) else None
        field = _field(parent, step)
        if field is not None:
            annotation, unit = field.annotation, _unit(field.metadata)
            doc = _first_line(_description(parent, step))
        else:
            annotation, unit = _item(annotation), None
        if (*path, step) in document.values or (*path, step) in document.keys:
            path = (*path, step)
    _, found, _ = _strip(annotation, None)
    return _Spot(path, parent, unit or found, doc)


def _strip(annotation: Any, step: str | int | None) -> tuple[Any, str | None, bool]:
    """Return the annotation without Annotated and Optional, and its unit if it has one.

    The last value is true if ``step`` selected a branch of a union instead of going deeper.
    """
    unit = None
    while True:
        origin = get_origin(annotation)
        if origin is Annotated:
            unit = _unit(annotation.__metadata__) or unit
            annotation = annotation.__origin__
        elif origin is Union or origin is types.UnionType:
            members = [item for item in get_args(annotation) if item is not type(None)]
            tagged = {tag: member for member in members for tag in _tags(member)}
            if step in tagged:
                return tagged[str(step)], unit, True
            if len(members) != 1:
                return annotation, unit, False
            annotation = members[0]
        else:
            return annotation, unit, False


def _tags(annotation: Any) -> list[str]:
    metadata = getattr(annotation, "__metadata__", ())
    return [item.tag for item in metadata if isinstance(item, Tag)]


def _unit(metadata: Sequence[Any]) -> str | None:
    return next((item.unit for item in metadata if isinstance(item, In)), None)


def _is_model(annotation: Any) -> bool:
    return isinstance(annotation, type) and issubclass(annotation, BaseModel)


def _field(model: type[BaseModel] | None, step: str | int) -> FieldInfo | None:
    name = _name(model, step)
    return None if model is None or name is None else model.model_fields[name]


def _description(model: type[BaseModel] | None, step: str | int) -> str | None:
    name = _name(model, step)
    return None if model is None or name is None else description(model, name)


def _name(model: type[BaseModel] | None, step: str | int) -> str | None:
    fields = {} if model is None else model.model_fields
    return next((name for name, field in fields.items() if step in (name, field.alias)), None)


def _item(annotation: Any) -> Any:
    """Return the type of the items of a list or mapping type."""
    arguments = [item for item in get_args(annotation) if item is not Ellipsis]
    return arguments[-1] if arguments else None


def _names(model: type[BaseModel]) -> list[str]:
    return [field.alias or name for name, field in model.model_fields.items()]


def _missing_space(document: Document, where: KeyPath) -> str:
    """Return what to write for ``{speed:5 rad/s}``, which YAML reads as one key without a value."""
    name, colon, value = str(where[-1] if where else "").partition(":")
    if not colon or document.get(where) is not None:
        return ""
    return f"write '{name}: {value}', with a space after the colon"


def named_key(message: str) -> str:
    """Return ``watchdog`` for ``'watchdog' must be ...``, and "" for other messages."""
    quote = message[:1]
    return message[1:].partition(quote)[0] if quote in ("'", "`") else ""


def _written(value: Data) -> str:
    if value is None:
        return "nothing"
    if isinstance(value, Mapping):
        return "a mapping"
    if isinstance(value, list):
        return f"a list of {len(value)}"
    return repr(value if len(value) <= 60 else value[:57] + "...")


def _first_line(doc: str | None) -> str | None:
    return None if doc is None else doc.strip().partition("\n\n")[0].replace("\n", " ")
