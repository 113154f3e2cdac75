"""What waits for a descriptor takes any: a daemon with many connections goes beyond 1024."""

from __future__ import annotations

import re
from pathlib import Path

import rigd

ROOT = Path(rigd.__file__).parents[1]
WAIT = re.compile(r"\bselect\.select\b|\bfrom select import\b")


def test_drivers_and_engine_wait_without_select() -> None:
    folders = ("rigd/engine", "rigd/sdk", "drivers/rigd_drivers", "rigd/cli/templates/driver")
    files = [path for folder in folders for path in sorted((ROOT / folder).rglob("*.py"))]
    files += sorted((ROOT / "rigd/cli/templates/driver").rglob("driver.py.jinja"))
    assert len(files) > 100
    found = [str(path.relative_to(ROOT)) for path in files if WAIT.search(path.read_text("utf-8"))]
    assert found == [], "use rigd.sdk.readable"
