"""Every folder and file that CONTRIBUTING.md, docs/testing.md and DECISIONS.md name is there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
ROOMS = ("rigd", "analyses", "drivers", "sim_backend", "tests", "docs", "benchmarks", "configs")
#: A file of Python in a folder, not one that a reader is to make.
FILE = re.compile(r"`((?:[\w-]+/)+\w+\.(?:py|c|yaml))`")


@pytest.mark.parametrize("name", ["CONTRIBUTING.md", "docs/testing.md", "DECISIONS.md"])
def test_named_files_are_there(name: str) -> None:
    found = FILE.findall((ROOT / name).read_text("utf-8"))
    there = [f"/{path}" for room in ROOMS for path in (ROOT / room).rglob("*.*")]
    missing = {file for file in found if not any(path.endswith(f"/{file}") for path in there)}
    assert not missing


def test_drawn_folders_are_there() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text("utf-8")
    (tree,) = re.findall(r"^```\n(rigd/\n.+?)^```", text, re.M | re.S)
    above: list[str] = []
    drawn = []
    for line in tree.splitlines():
        indent = len(line) - len(line.lstrip())
        first, *others = re.findall(r"(?<![\w/])([\w/]+)/(?= |$|;|:)", line) or [""]
        if first and indent <= 4:
            above[indent // 2 :] = [first]
            drawn.append("/".join(above))
            continued = above
        else:
            others = [first, *others]
        drawn += ["/".join([*continued, name]) for name in others if name]
    folders = [path for path in drawn if not _is_folder(path)]
    assert len(drawn) > 40
    assert not folders


def _is_folder(path: str) -> bool:
    """Whether it is one, or beside the last folder (``doctor/`` in the line of ``manual/``)."""
    beside = Path(path).parent.parent / Path(path).name
    return (ROOT / path).is_dir() or (ROOT / beside).is_dir()
