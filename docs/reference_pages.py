"""Writes the pages of the reference that come from the code: commands, files, plug-ins, Python.

`docs/conf.py` calls :func:`write` before each build, so that no page can be older than the code.
The pages go to `docs/reference/`, which git ignores.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

#: Width of the help texts, in columns: that of a terminal, whatever the build runs in.
COLUMNS: Final = "80"

#: The files that people write: name of the schema, title, page that explains it.
FILES: Final = (
    ("procedure", "Procedure file: every key", "procedures.md"),
    ("rig", "Rig file: every key", "rigs.md"),
    ("calibration", "Calibration file: every key", "calibration.md"),
    ("map", "Map of an import: every key", "import.md"),
)

#: Packages whose names a user imports, for what, and which names; "": all.
MODULES: Final = (
    ("rigd", "open, run in virtual time, identify", "open, run, identify, Result, Estimate"),
    ("rigd.record", "read, check and export recordings", ""),
    ("rigd.remote.client", "steer a rig from a program", ""),
    ("rigd.sdk", "write a driver, a link, a plant or a simulation", ""),
)

#: What kinds of plug-in are called in the headings.
KINDS: Final = {
    "driver": "Drivers",
    "link": "Links",
    "plant": "Plants",
    "simulation": "Simulations at the wire",
    "observer": "Models of observers",
}

Schema = Mapping[str, Any]


def write(folder: Path, schemas: Path) -> None:
    """Write every generated page into ``folder``; pages that have not changed are left alone."""
    folder.mkdir(exist_ok=True)
    pages = {"commands.md": commands(), "plugins.md": plugins(), "python.md": python()}
    for name, title, explained in FILES:
        schema = json.loads((schemas / f"{name}.schema.json").read_text("utf-8"))
        pages[f"{name}_file.md"] = _FileKeys(name, schema).page(title, explained)
    for stale in {path.name for path in folder.glob("*.md")} - pages.keys():
        (folder / stale).unlink()
    for name, text in pages.items():
        page = folder / name
        if not page.exists() or page.read_text("utf-8") != text:
            page.write_text(text, "utf-8")


def commands() -> str:
    """Return the page of the command line: the help of each command."""
    from rigd.cli.main import build_parser

    os.environ["COLUMNS"] = COLUMNS
    lines = [
        "# Command line",
        "",
        "What `rigd COMMAND --help` prints, for each command.",
        "",
        "## rigd",
        "",
        *_block("text", build_parser().format_help()),
    ]
    for name, parser in _parsers(build_parser()):
        heading = "##" if name.count(" ") == 1 else "###"
        lines += [f"{heading} {name}", "", *_block("text", parser.format_help())]
    return "\n".join(lines)


def _parsers(parser: argparse.ArgumentParser) -> Iterator[tuple[str, argparse.ArgumentParser]]:
    for action in parser._actions:  # noqa: SLF001 - argparse has no other way to list them
        if isinstance(action, argparse._SubParsersAction):  # noqa: SLF001
            for command in action.choices.values():
                yield command.prog, command
                yield from _parsers(command)


def plugins() -> str:
    """Return the page of the installed plug-ins: options, channels, setpoints, actions of each."""
    command = [sys.executable, "-m", "rigd", "drivers", "--json"]
    listed = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
    lines = ["# Drivers, links, plants, simulations, observers", ""]
    lines += ["What `rigd drivers` lists, and `rigd drivers NAME` shows in full.", ""]
    for kind, title in KINDS.items():
        found = [item for item in listed if item["kind"] == kind]
        lines += [f"## {title}", "", "| name | what it is |", "|---|---|"]
        for item in found:
            lines.append(f"| [`{item['name']}`](#{kind}-{item['name']}) | {_cell(item['title'])} |")
        lines.append("")
        for item in found:
            lines += _plugin(item, kind)
    return "\n".join(lines)


def _plugin(item: Schema, kind: str) -> Iterator[str]:
    if item["broken"]:
        raise RuntimeError(f"{kind} {item['name']}: {item['broken']}")
    yield from (f"({kind}-{item['name']})=", f"### {item['name']}", "", item["doc"], "")
    if item.get("link_kind"):
        yield from (f"It stands on a link of kind `{item['link_kind']}`.", "")
    if item.get("options"):
        rows = (
            (f"`{option['name']}`", _takes_of(option), option["doc"]) for option in item["options"]
        )
        yield from _table(("option", "takes", "meaning"), rows)
    for title in ("channels", "setpoints"):
        if item.get(title):
            rows = (
                (f"`{channel['name']}`", channel["unit"] or "", channel["doc"])
                for channel in item[title]
            )
            yield from _table((title.removesuffix("s"), "unit", "meaning"), rows)
    if item.get("actions"):
        yield from _table(("action", "what it does"), item["actions"].items())
    if item.get("example"):
        yield from (f"Example: {item['example']}.", "")


def _takes_of(option: Schema) -> str:
    return f"{option['kind']}; {'required' if option['required'] else _default(option['default'])}"


def _default(value: str) -> str:
    return f"default {value}" if value else "no default"


@dataclass(frozen=True)
class _FileKeys:
    """The keys of one kind of file, from its JSON Schema."""

    name: str  #: of the file: labels of all pages of a site share one space
    schema: Schema

    def page(self, title: str, explained: str) -> str:
        """Return the page: each key, what it takes, its default and meaning."""
        lines = [f"# {title}", "", f"[How to write one](../{explained}).", ""]
        lines += ["## The whole file", "", *self._keys(self.schema)]
        for name, part in self.schema["$defs"].items():
            if "properties" in part:
                lines += [f"({self._anchor(name)})=", f"## {_title(name)}", ""]
                lines += [part.get("description", ""), "", *self._keys(part)]
        return "\n".join(lines)

    def _keys(self, part: Schema) -> Iterator[str]:
        required = part.get("required", ())
        rows = (
            (
                f"`{key}`",
                f"{self._takes(what)}{_needed(what, key in required)}",
                what.get("description", ""),
            )
            for key, what in part["properties"].items()
        )
        yield from _table(("key", "takes", "meaning"), rows)

    def _takes(self, what: Schema) -> str:
        """Return in words what a key takes; a part with keys of its own is linked."""
        if "$ref" in what:
            name = what["$ref"].rpartition("/")[2]
            if "properties" in self.schema["$defs"][name]:
                return f"[{_title(name)}](#{self._anchor(name)})"
            return self._takes(self.schema["$defs"][name])
        for several in ("anyOf", "oneOf"):
            if several in what:
                options = (option for option in what[several] if option.get("type") != "null")
                return " or ".join(dict.fromkeys(map(self._takes, options)))
        if "patternErrorMessage" in what:
            return str(what["patternErrorMessage"])
        if "enum" in what or "const" in what:
            values = what.get("enum", [what.get("const")])
            return " or ".join(f"`{_plain(value)}`" for value in values)
        match what.get("type"):
            case "array":
                return f"a list of: {self._takes(what.get('items', {}))}"
            case "object":
                named = [*what.get("patternProperties", {}).values()]
                named += [what.get("additionalProperties")]
                known = (values for values in named if isinstance(values, dict) and values)
                return next((f"names, each with: {self._takes(one)}" for one in known), "keys")
            case "integer":
                return f"a whole number{_bounds(what)}"
            case "number":
                return f"a number{_bounds(what)}"
            case "boolean":
                return "`true` or `false`"
            case "string":
                return "text"
            case list(kinds):
                return " or ".join(self._takes({"type": kind}) for kind in kinds)
        return "any value"

    def _anchor(self, name: str) -> str:
        return f"{self.name}-{name.lower()}"


def _needed(what: Schema, required: bool) -> str:
    if required:
        return "; required"
    default = what.get("default")
    if default in (None, "", [], {}) or isinstance(default, dict):
        return ""
    return f"; default `{_plain(default)}`"


def _plain(value: object) -> str:
    """Return a value as YAML has it on one line."""
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def _bounds(what: Schema) -> str:
    words = {
        "minimum": "at least", "exclusiveMinimum": "above",
        "maximum": "at most", "exclusiveMaximum": "below",
    }  # fmt: skip
    return "".join(f", {word} {what[key]:g}" for key, word in words.items() if key in what)


def _title(name: str) -> str:
    """Return the name of a part in words: "CaptureSource" is "Capture"."""
    return name.removesuffix("Source")


def python() -> str:
    """Return the page of the Python interface, which Sphinx fills from the docstrings."""
    lines = ["# Python", "", "What a program imports of rigd.", ""]
    for module, purpose, names in MODULES:
        lines += [f"## {module}: {purpose}", ""]
        options = (
            f":members: {names}".strip(),
            ":undoc-members:",
            ":show-inheritance:",
            ":imported-members:",
        )
        directive = [f".. automodule:: {module}", *(f"   {option}" for option in options)]
        lines += _block("{eval-rst}", "\n".join(directive))
    return "\n".join(lines)


def _table(head: Sequence[str], rows: Iterable[Iterable[str]]) -> Iterator[str]:
    yield f"| {' | '.join(head)} |"
    yield "|" + "---|" * len(head)
    for row in rows:
        yield f"| {' | '.join(map(_cell, row))} |"
    yield ""


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def _block(language: str, text: str) -> list[str]:
    return [f"```{language}", text.rstrip(), "```", ""]
