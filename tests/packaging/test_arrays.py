"""Dataclasses that hold arrays are compared by identity: `==` on arrays has no truth value."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import rigd

ROOT = Path(rigd.__file__).parents[1]
FOLDERS = ("rigd", "analyses/rigd_analyses", "drivers/rigd_drivers", "sim_backend/rigd_sim")
ARRAY = re.compile(r"\b(NDArray|FloatArray|BoolArray|IntArray|ndarray|Rows)\b")
#: A field that is a function of arrays, or belongs to the class, is no array.
NO_FIELD = re.compile(r"\b(Callable|ClassVar)\b")


def array_classes() -> Iterator[tuple[str, str]]:
    """Yield the name of each dataclass that holds arrays, and its decorator."""
    for folder in FOLDERS:
        for path in sorted((ROOT / folder).rglob("*.py")):
            for item in ast.walk(ast.parse(path.read_text("utf-8"))):
                if isinstance(item, ast.ClassDef):
                    for decorator in map(ast.unparse, item.decorator_list):
                        if decorator.startswith("dataclass") and any(map(_is_array, item.body)):
                            yield f"{path.relative_to(ROOT)}: {item.name}", decorator


def test_dataclasses_with_arrays_are_compared_by_identity() -> None:
    found = dict(array_classes())
    assert len(found) > 30, "fields of arrays are no longer recognised"
    assert [name for name, decorator in found.items() if "eq=False" not in decorator] == []


def _is_array(statement: ast.stmt) -> bool:
    if not isinstance(statement, ast.AnnAssign):
        return False
    annotation = ast.unparse(statement.annotation)
    return bool(ARRAY.search(annotation)) and not NO_FIELD.search(annotation)
