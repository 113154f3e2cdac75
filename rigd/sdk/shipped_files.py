"""Returns the paths of the files that rigd ships."""

from __future__ import annotations

from pathlib import Path
from typing import Final, Literal

#: The folders of shipped files.
Kind = Literal["configs", "maps", "procedures", "schemas"]
_PACKAGE: Final = Path(__file__).resolve().parent.parent


def shipped_folder(kind: Kind) -> Path:
    """Return the folder of shipped files: inside the installed package, or in the checkout."""
    bundled = _PACKAGE / "_bundled" / kind
    return bundled if bundled.is_dir() else _PACKAGE.parent / kind


def shipped_configs() -> Path:
    """Return the folder of shipped rig files."""
    return shipped_folder("configs")
