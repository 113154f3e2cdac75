"""Fifty mistakes that users make in rig files: each is named at the line that has it."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest
from support.wrong_rigs import MISTAKES, NEXT_LINE, spoilt

from rigd.config.loader import parse_rig
from rigd.model import ConfigError

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize(("name", "old", "new"), MISTAKES)
def test_mistake_is_named_at_its_line(name: str, old: str, new: str) -> None:
    text, path, line = spoilt(name, old, new)
    with pytest.raises(ConfigError) as wrong:
        parse_rig(text, path)
    found = [error.place for error in (wrong.value, *wrong.value.others)]
    line += (name, old, new) in NEXT_LINE
    assert line in [place and place.line for place in found], str(wrong.value)


def test_all_fifty_are_there() -> None:
    assert len(set(MISTAKES)) == len(MISTAKES) == 50


def test_rules_over_keys_name_their_entry() -> None:
    """A plain ValueError of a validator of a whole part shows the line of the part around it."""
    places = []
    for folder in ("rigd", "drivers", "sim_backend", "analyses"):
        for path in (ROOT / folder).rglob("*.py"):
            text = path.read_text("utf-8")
            if "model_validator" in text and "remote" not in path.parts:
                places += [f"{path}:{line}" for line in plain_errors(ast.parse(text))]
    assert not places, "raise rigd.sdk.wrong_entry(text, key) there"


def plain_errors(tree: ast.Module) -> list[int]:
    """Return the lines at which a validator of a whole model raises ValueError itself."""
    return [
        node.lineno
        for rule in ast.walk(tree)
        if isinstance(rule, ast.FunctionDef)
        and any("model_validator" in ast.unparse(item) for item in rule.decorator_list)
        for node in ast.walk(rule)
        if isinstance(node, ast.Raise) and node.exc is not None
        if ast.unparse(node.exc).startswith("ValueError")
    ]


def test_plain_error_of_a_rule_is_found() -> None:
    rule = "@model_validator(mode='after')\ndef _rule(self):\n    raise ValueError('no')\n"
    assert plain_errors(ast.parse(rule)) == [3]
