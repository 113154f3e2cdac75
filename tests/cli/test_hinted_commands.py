"""What rigd tells people to type exists: each command with its options, each key of a file."""

from __future__ import annotations

import argparse
import ast
import json
import re
import shlex
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path

from rigd.cli.main import build_parser

ROOT = Path(__file__).parents[2]
FOLDERS = ("rigd", "drivers/rigd_drivers", "analyses/rigd_analyses", "sim_backend/rigd_sim")
_COMMAND = re.compile(r"`rigd ([^`]+)`")
_OPTION = re.compile(r"(?<![\w-])(--[a-z][a-z-]+)")
_KEY = re.compile(r"`([a-z_]+):(?: [^`]*)?`")
#: A field of a class: an option of a driver, a plant or an analysis.
_FIELD = re.compile(r"^    ([a-z_]+): ", re.MULTILINE)
_WORTH = re.compile(r"`rigd |hint=|\.(?:add|_?note|_?note_key)\(")
#: What stands for a value that the code puts in.
VALUE = "X"


def text_of(node: ast.AST) -> str | None:
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        return "".join(text_of(item) or VALUE for item in node.values)
    return None


@cache
def sources() -> Mapping[Path, str]:
    return {
        path: path.read_text(encoding="utf-8")
        for folder in FOLDERS
        for path in sorted((ROOT / folder).rglob("*.py"))
    }


@cache
def trees() -> Mapping[Path, ast.Module]:
    """Return what is worth a look: parsing all would take several seconds."""
    return {path: ast.parse(text) for path, text in sources().items() if _WORTH.search(text)}


def texts() -> Iterator[tuple[str, str]]:
    """Yield place and text of all literals."""
    for path, tree in trees().items():
        inner = {
            id(part) for node in ast.walk(tree) if isinstance(node, ast.JoinedStr)
            for part in node.values
        }  # fmt: skip
        for node in ast.walk(tree):
            text = text_of(node)
            if text is not None and id(node) not in inner:
                yield f"{path.relative_to(ROOT)}:{getattr(node, 'lineno', 0)}", text


def hints() -> Iterator[tuple[str, str]]:
    """Yield place and text of what is given as a hint."""
    for path, tree in trees().items():
        for node in ast.walk(tree):
            if not isinstance(node, ast.Call):
                continue
            given = [item.value for item in node.keywords if item.arg == "hint"]
            named = node.func.attr if isinstance(node.func, ast.Attribute) else ""
            if named in ("add", "_note", "_note_key", "note", "note_key"):
                given += node.args[2:]
            for item in given:
                for part in ast.walk(item):
                    text = text_of(part)
                    if text is not None:
                        yield f"{path.relative_to(ROOT)}:{part.lineno}", text  # type: ignore[attr-defined]


@cache
def whole_parser() -> argparse.ArgumentParser:
    return build_parser()


def commands(parser: argparse.ArgumentParser) -> Mapping[str, argparse.ArgumentParser]:
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            return dict(action.choices)
    return {}


def options(parser: argparse.ArgumentParser) -> set[str]:
    return {name for action in parser._actions for name in action.option_strings}


def every_parser(parser: argparse.ArgumentParser) -> Iterator[argparse.ArgumentParser]:
    yield parser
    for other in commands(parser).values():
        yield from every_parser(other)


def problem_of(line: str) -> str | None:
    """Return what is wrong with a command line, None if nothing."""
    try:
        words = shlex.split(line.partition(" | ")[0].partition(" > ")[0])
    except ValueError as error:
        return str(error)
    parser = whole_parser()
    while words and (known := commands(parser)):
        if words[0] == VALUE:
            return None
        if words[0].startswith("--"):
            break
        if words[0] not in known:
            return f"there is no command {words[0]!r}"
        parser = known[words.pop(0)]
    for word in words:
        name = word.partition("=")[0]
        if name.startswith("--") and name not in options(parser):
            return f"{parser.prog} has no option {name}"
    return None


def test_every_named_command_line_exists() -> None:
    found = [(place, line) for place, text in texts() for line in _COMMAND.findall(text)]
    wrong = [(place, line, problem) for place, line in found if (problem := problem_of(line))]
    assert wrong == []
    assert len(found) > 150  # the search still finds them


def test_every_option_in_a_hint_exists() -> None:
    known = {name for parser in every_parser(whole_parser()) for name in options(parser)}
    found = [(place, name) for place, text in hints() for name in _OPTION.findall(text)]
    assert [(place, name) for place, name in found if name not in known] == []
    assert len(found) > 5


def keys_of(schema: object) -> Iterator[str]:
    if isinstance(schema, Mapping):
        yield from schema.get("properties", {})
        for item in schema.values():
            yield from keys_of(item)
    elif isinstance(schema, list):
        for item in schema:
            yield from keys_of(item)


def test_every_key_in_a_hint_exists() -> None:
    known: set[str] = set()
    for path in (ROOT / "schemas").glob("*.schema.json"):
        known |= set(keys_of(json.loads(path.read_text())))
    for text in sources().values():
        known |= set(_FIELD.findall(text))
    found = [(place, key) for place, text in hints() for key in _KEY.findall(text)]
    assert [(place, key) for place, key in found if key not in known] == []
    assert len(found) > 40
