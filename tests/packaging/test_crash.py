"""What a run of the tests does if one of its processes crashes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

SETTINGS = Path(__file__).parents[2] / "pyproject.toml"
#: For each process one file, and more: a new process would get what is left.
FILES = 4
CRASHES = """
import os

def test_of_another_file():
    pass

def test_that_crashes():
    os._exit(3)
"""


def test_crash_of_a_process_ends_the_run(tmp_path: Path) -> None:
    for number in range(FILES):
        text = CRASHES if number == 1 else "def test_passes():\n    pass\n"
        (tmp_path / f"test_{number}.py").write_text(text)
    arguments = ["-c", str(SETTINGS), "--rootdir", ".", "-p", "no:cacheprovider", "-n", "2",
                 "--dist", "loadfile", "--no-loadscope-reorder", "."]  # fmt: skip
    command = [sys.executable, "-m", "pytest", *arguments]
    # 60 s: without the setting it never ends.
    ended = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert ended.returncode == 1
    assert "crashed while running 'test_1.py::test_that_crashes'" in ended.stdout
