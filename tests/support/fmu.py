"""Builds the FMU on which tests of FMUs stand."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

SOURCE = Path(__file__).parents[1] / "sim" / "fmu" / "flywheel.py"


def build(folder: Path) -> Path:
    """Return the FMU of ``flywheel.py``, made in ``folder``."""
    from pythonfmu3.builder import FmuBuilder

    source = folder / "flywheel_unit.py"  # imported by its name, which no test module may have
    shutil.copy(SOURCE, source)
    sys.path.insert(0, str(folder))
    try:
        return Path(FmuBuilder.build_FMU(source, dest=folder))
    finally:
        sys.path.remove(str(folder))
