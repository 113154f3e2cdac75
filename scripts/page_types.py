"""Prints the types of the panel's messages for TypeScript, from their JSON Schema.

``make fmt`` writes them to ``rigd/panel/messages.d.ts``; ``make check`` compares.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Mapping
from typing import Any

from rigd.panel.messages import page_schema


def main() -> None:
    """Print the declarations."""
    sys.stdout.writelines(f"{line}\n" for line in _lines(page_schema()))


def _lines(schema: Mapping[str, Any]) -> Iterator[str]:
    models = schema["$defs"]
    tables = {title: schema[f"x-{title}"] for title in ("asks", "commands")}
    # What the page sends may leave out what has a default; what it receives is complete.
    sent = {
        name
        for table in tables.values()
        for types in table.values()
        for name in _reached(types["args"], models)
    }
    yield "// Made by scripts/page_types.py from rigd/panel/messages.py: do not edit."
    yield ""
    yield "declare namespace Api {"
    for name, model in models.items():
        if name != "JsonValue":
            yield f"  {_declaration(name, model, name in sent)}"
    yield "  type JsonValue = string | number | boolean | null | JsonValue[] | JsonObject;"
    yield "  interface JsonObject {\n    [name: string]: JsonValue;\n  }"
    yield f"  type LiveMessage = {' | '.join(name for name in models if name.startswith('Live'))};"
    for title, table in tables.items():
        yield f"  interface {title.capitalize()} {{"
        for verb, types in table.items():
            args, result = _type(types["args"]), _type(types["result"])
            yield f"    {verb}: {{ args: {args}; result: {result} }};"
        yield "  }"
    yield "}"


def _reached(kind: Any, models: Mapping[str, Any]) -> Iterator[str]:
    """Yield the names of the models that a schema refers to, and those that these refer to."""
    if isinstance(kind, list):
        for item in kind:
            yield from _reached(item, models)
    elif isinstance(kind, dict):
        if "$ref" in kind:
            name = _name(kind)
            yield name
            yield from _reached(models[name], models)
        for item in kind.values():
            yield from _reached(item, models)


def _declaration(name: str, model: Mapping[str, Any], is_sent: bool) -> str:
    fields = model.get("properties")
    if fields is None and model.get("type") != "object":
        return f"type {name} = {_type(model)};"
    if not fields:
        return f"type {name} = Record<string, never>;"
    required = model.get("required", ()) if is_sent else fields
    lines = "".join(
        f"\n    {field}{'' if field in required else '?'}: {_type(kind)};"
        for field, kind in fields.items()
    )
    return f"interface {name} {{{lines}\n  }}"


def _name(kind: Mapping[str, Any]) -> str:
    return str(kind["$ref"]).rpartition("/")[2]


def _type(kind: Mapping[str, Any]) -> str:
    """Return the type of TypeScript for a JSON Schema."""
    if "$ref" in kind:
        return _name(kind)
    if "const" in kind:
        return json.dumps(kind["const"])
    if "enum" in kind:
        return " | ".join(map(json.dumps, kind["enum"]))
    if "anyOf" in kind:
        return " | ".join(dict.fromkeys(map(_type, kind["anyOf"])))
    match kind.get("type"):
        case "array":
            inner = _type(kind["items"])
            return f"({inner})[]" if "|" in inner else f"{inner}[]"
        case "object":
            values = [*kind.get("patternProperties", {}).values(), kind.get("additionalProperties")]
            return f"Record<string, {_type(values[0])}>"
        case "string" | "boolean" | "null" as plain:
            return plain
        case "integer" | "number":
            return "number"
    raise ValueError(f"no type for {kind}")


if __name__ == "__main__":
    main()
