"""Names: a public class of ``rigd`` stands for one thing, the name of a test is brief."""

from __future__ import annotations

import ast
import re
import tomllib
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).parents[2]
#: Of the name of a test, after `test_`.
MOST_WORDS = 8

#: Public classes of a module, and tests: what stands in a template of code counts as well.
PUBLIC_CLASS = re.compile(r"^class ([^\W_]\w*)", re.M)
TEST = re.compile(r"^ *(?:async )?def test_(\w+)", re.M)
ONE = re.compile(r"\bone\b")


def test_no_public_class_name_stands_twice() -> None:
    places: defaultdict[str, list[str]] = defaultdict(list)
    for path in sorted((ROOT / "rigd").rglob("*.py")):
        for match in PUBLIC_CLASS.finditer(path.read_text(encoding="utf-8")):
            places[match[1]].append(str(path.relative_to(ROOT)))
    assert len(places) > 500
    assert {name: found for name, found in places.items() if len(found) > 1} == {}


def test_each_change_has_a_known_kind() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["towncrier"]
    kinds = {kind["directory"] for kind in settings["type"]}
    names = [path.name for path in (ROOT / "changes").glob("[!.]*")]
    assert [name for name in names if name.split(".")[1:] not in [[k, "md"] for k in kinds]] == []


def test_no_variable_has_the_name_one() -> None:
    places = []
    for folder in ("rigd", "drivers", "sim_backend", "analyses", "tests", "benchmarks"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            text = path.read_text(encoding="utf-8")
            for node in ast.walk(ast.parse(text)) if ONE.search(text) else ():
                name = node.id if isinstance(node, ast.Name) else getattr(node, "arg", None)
                if name == "one":
                    places.append(f"{path.relative_to(ROOT)}:{getattr(node, 'lineno', 0)}")
    assert places == []


def test_test_names_have_at_most_eight_words() -> None:
    found: list[str] = []
    long: list[str] = []
    for path in sorted((ROOT / "tests").rglob("test_*.py")):
        for match in TEST.finditer(path.read_text(encoding="utf-8")):
            found.append(match[1])
            words = len(match[1].split("_"))
            long += [f"{path.relative_to(ROOT)}: {match[1]}"] * (words > MOST_WORDS)
    assert len(found) > 2000
    assert long == []
