"""rigd knows no family of rigs: their words stand in their analyses and in examples of the help."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

RIGD = Path(__file__).parents[2] / "rigd"
#: Words that only a family has.
WORDS = re.compile(
    r"lugre|\bomni.?wheel|gauge(?! pressure)|\brails?\b|rail_|\broller|approach.?angle|articulated",
    re.I,
)
#: Names of shipped rigs, which examples and hints use, and of a friction law, which a rig of any
#: family may have.
RIGS = re.compile(r"lugre-\d|(sim|wire)_lugre|kind: lugre")
SUFFIXES = {".py", ".jinja", ".html", ".css", ".js", ".service"}


def examples(path: Path, text: str) -> set[int]:
    """Return the lines of a command's examples, which its help shows."""
    found: set[int] = set()
    if path.parent.name != "cli" and path.parent.parent.name != "cli":
        return found
    for node in ast.parse(text).body:
        targets = node.targets if isinstance(node, ast.Assign) else []
        names = {target.id for target in targets if isinstance(target, ast.Name)}
        if names & {"EXAMPLES", "EPILOG"}:
            found |= set(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    return found


def told() -> Iterator[str]:
    for path in sorted(RIGD.rglob("*")):
        inside = path.relative_to(RIGD)
        if path.suffix not in SUFFIXES or inside.parts[0] == "_bundled":
            continue
        text = path.read_text("utf-8")
        passed_over = examples(path, text) if path.suffix == ".py" else set()
        for number, line in enumerate(text.splitlines(), start=1):
            if number not in passed_over and WORDS.search(RIGS.sub("", line)):
                yield f"{inside}:{number}: {line.strip()}"


def test_rigd_contains_no_name_of_rig_family() -> None:
    assert list(told()) == []
