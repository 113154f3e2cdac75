"""Names: a public class of ``rigd`` stands for one thing, the name of a test is brief."""

from __future__ import annotations

import ast
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).parents[2]
#: Of the name of a test, after `test_`.
MOST_WORDS = 8


def test_no_public_class_name_stands_twice() -> None:
    places: defaultdict[str, list[str]] = defaultdict(list)
    for path in sorted((ROOT / "rigd").rglob("*.py")):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places[node.name].append(f"{path.relative_to(ROOT)}:{node.lineno}")
    assert len(places) > 500
    assert {name: found for name, found in places.items() if len(found) > 1} == {}


def test_no_variable_has_the_name_one() -> None:
    places = []
    for folder in ("rigd", "drivers", "sim_backend", "analyses", "tests", "benchmarks"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                name = node.id if isinstance(node, ast.Name) else getattr(node, "arg", None)
                if name == "one":
                    places.append(f"{path.relative_to(ROOT)}:{getattr(node, 'lineno', 0)}")
    assert places == []


def test_test_names_have_at_most_eight_words() -> None:
    found: list[str] = []
    long: list[str] = []
    for path in sorted((ROOT / "tests").rglob("test_*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
                _, *words = node.name.split("_")
                if node.name.startswith("test_"):
                    found.append(node.name)
                    long += [f"{path.relative_to(ROOT)}: {node.name}"] * (len(words) > MOST_WORDS)
    assert len(found) > 2000
    assert long == []
