"""Writes plain data (mappings, lists, text) as YAML that people like to read and edit."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, Final

#: Text that needs no quotes in a block, and within braces.
_PLAIN: Final = re.compile(r"[A-Za-z0-9./+-]([^:#\n]|:(?! |$)|(?<! )#)*")
_SPECIAL: Final = re.compile(r"[\[\]{},]")
_COLUMNS: Final = 96


def yaml_text(data: Mapping[str, Any]) -> str:
    """Return ``data`` as a YAML file; small mappings stand in braces, on a line."""
    lines: list[str] = []
    for key, value in data.items():
        entry = _entry(f"{key}:", value, "")
        lines += entry if len(entry) == 1 else ["", *entry]
    return "\n".join(lines) + "\n"


def _block(data: Mapping[str, Any], indent: str) -> list[str]:
    lines = []
    for key, value in data.items():
        lines += _entry(f"{indent}{key}:", value, indent)
    return lines


def _entry(head: str, value: Any, indent: str) -> list[str]:
    flow = f"{head} {_flow(value)}"
    nested = isinstance(value, Mapping | list) and value
    if not nested or (len(flow) <= _COLUMNS and _depth(value) < 2):
        return [f"{head} {_scalar(value, flow=False)}" if isinstance(value, str) else flow]
    inner = indent + "  "
    if isinstance(value, Mapping):
        return [head, *_block(value, inner)]
    lines = [head]
    for item in value:
        flat = f"{inner}- {_flow(item)}"
        if not isinstance(item, Mapping) or len(flat) <= _COLUMNS:
            lines.append(flat)
            continue
        first, *rest = _block(item, inner + "  ")
        lines += [f"{inner}- {first.strip()}", *rest]
    return lines


def _depth(value: Any) -> int:
    if isinstance(value, Mapping):
        return 1 + max((_depth(item) for item in value.values()), default=0)
    return 1 + max(map(_depth, value), default=0) if isinstance(value, list) else 0


def _flow(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}: {_flow(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_flow, value)) + "]"
    return _scalar(value, flow=True)


def _scalar(value: Any, *, flow: bool) -> str:
    if value is None:
        return ""
    text = str(value)
    plain = _PLAIN.fullmatch(text) and text == text.strip()
    if plain and not text.startswith(("- ", "--")) and not (flow and _SPECIAL.search(text)):
        return text
    if "\n" in text or "\\" in text:
        import json

        return json.dumps(text, ensure_ascii=False)
    return "'" + text.replace("'", "''") + "'"
