"""Where the files that rigd ships stand."""

from __future__ import annotations

from pathlib import Path
from typing import Final

_PACKAGE: Final = Path(__file__).resolve().parent.parent


def shipped_configs() -> Path:
    """Return the folder of shipped rig files: inside the installed package, or in the checkout."""
    bundled = _PACKAGE / "_bundled" / "configs"
    return bundled if bundled.is_dir() else _PACKAGE.parent / "configs"
