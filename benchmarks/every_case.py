"""Plays every case of the studies of which `make test` plays some: the same tests, all seeds.

python benchmarks/every_case.py
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from figures import at_most

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
from support.cases import EVERY_CASE

TESTS = Path(__file__).resolve().parents[1] / "tests"


def main() -> int:
    """Run the test files that take some of their cases; return the exit code of pytest."""
    files = [file for file in TESTS.rglob("test_*.py") if "support.cases" in file.read_text()]
    command = [sys.executable, "-m", "pytest", "-q", *map(str, sorted(files))]
    done = subprocess.run(command, env={**os.environ, EVERY_CASE: "1"}, check=False)
    at_most("exit code of tests with every case", done.returncode, 0, "")
    return done.returncode


if __name__ == "__main__":
    sys.exit(main())
