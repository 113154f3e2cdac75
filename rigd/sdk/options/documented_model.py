"""Defines models whose fields are described by the strings beneath them in the source.

The module reads a description only on request. Pydantic can read these strings when it makes a
class (``use_attribute_docstrings``). For that it parses the source of every class in every process,
but few processes show a description.
"""

from __future__ import annotations

import ast
import inspect
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from itertools import pairwise
from typing import Any

from pydantic import BaseModel, ConfigDict, GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic_core import CoreSchema

from rigd.model.errors import RigdError
from rigd.sdk.options.text_numbers import accept_text


class WrongEntries(ValueError):
    """Entries that a validator of a whole part refuses: ``problems`` has the path and text of each.

    A path is the keys and list indices from the part that is validated to the entry; the message
    of a rig file shows the line of that entry.
    """

    def __init__(self, problems: Sequence[tuple[tuple[str | int, ...], str]]) -> None:
        super().__init__("; ".join(text for _, text in problems))
        self.problems = tuple(problems)


def wrong_entry(text: str, *path: str | int) -> WrongEntries:
    """Return the error of a validator of a whole part about its entry at ``path``.

    If the entry is not there, the message shows the line of the part around it.
    """
    return WrongEntries([(path, text)])


@contextmanager
def about_entry(*path: str | int) -> Iterator[None]:
    """Let an error that is raised inside of the block be about the option at ``path``."""
    try:
        yield
    except RigdError as error:
        error.entry = path
        raise


class Documented(BaseModel):
    """A part of a file or message: frozen, every key known, every field documented.

    A number may be given as text, as in a file, unless the model is ``strict``. Its JSON Schema has
    the string beneath a field as the description of the field.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    @classmethod
    def __get_pydantic_core_schema__(
        cls, source: Any, handler: GetCoreSchemaHandler, /
    ) -> CoreSchema:
        """Return the schema that pydantic makes, which also accepts numbers written as text."""
        schema = handler(source)
        strict = cls.model_config.get("strict")
        return schema if strict else accept_text(schema, handler.resolve_ref_schema)

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler, /
    ) -> dict[str, Any]:
        """Return the schema that pydantic makes, with the descriptions."""
        schema = handler(core_schema)
        properties = handler.resolve_ref_schema(schema).get("properties", {})
        for name, field in cls.model_fields.items():
            key = field.alias if field.alias in properties else name
            text = description(cls, name)
            if text is not None and key in properties:
                described = properties[key]
                title = {item: described.pop(item) for item in ("title",) if item in described}
                described |= {"description": text, **title}
        return schema


def description(model: type[BaseModel], name: str) -> str | None:
    """Return the description of the field ``name`` of ``model``; None if it has none."""
    given = model.model_fields[name].description
    if given is not None or not issubclass(model, Documented):
        return given
    declaring = (item for item in model.__mro__ if name in inspect.get_annotations(item))
    return next((_beneath(item).get(name) for item in declaring), None)


@cache
def _beneath(model: type) -> Mapping[str, str]:
    """Return the string beneath each field that the body of ``model`` declares."""
    try:
        source = inspect.getsource(model)
    except (OSError, TypeError):  # made at a prompt, or shipped without source
        return {}
    if source[0].isspace():
        source = "if True:\n" + source
    nodes = ast.walk(ast.parse(source))
    body = next(node.body for node in nodes if isinstance(node, ast.ClassDef))
    return {
        field.target.id: inspect.cleandoc(text.value.value)
        for field, text in pairwise(body)
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)
        if isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant)
        if isinstance(text.value.value, str)
    }
