"""A sensor that the cycle asks, as an author writes one: `rigd new` has no such beginning."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path


def rendered(module: str, class_name: str) -> Mapping[str, str]:
    """Return the files of its package by path, as those of `rigd new` are."""
    folder = Path(__file__).parent
    driver = (folder / "driver.py").read_text("utf-8").replace("Gauge", class_name)
    return {
        f"{module}/__init__.py": "",
        f"{module}/driver.py": driver,
        "tests/test_driver.py": (folder / "peer.py").read_text("utf-8"),
    }
