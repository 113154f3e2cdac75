from __future__ import annotations

import shutil
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

HERE = Path(__file__).parent


@pytest.fixture(scope="session")
def flywheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the FMU of ``flywheel.py``."""
    from pythonfmu3.builder import FmuBuilder

    folder = tmp_path_factory.mktemp("fmu")
    source = folder / "flywheel_unit.py"  # imported by its name, which no test module may have
    shutil.copy(HERE / "flywheel.py", source)
    sys.path.insert(0, str(folder))
    try:
        return Path(FmuBuilder.build_FMU(source, dest=folder))
    finally:
        sys.path.remove(str(folder))


@pytest.fixture
def changed(flywheel: Path, tmp_path: Path) -> Callable[..., Path]:
    """Return a function that writes the FMU with names and description changed."""

    def change(old: str, new: str, *, name: Callable[[str], str | None] = str) -> Path:
        path = tmp_path / "changed.fmu"
        with zipfile.ZipFile(flywheel) as source, zipfile.ZipFile(path, "w") as target:
            for item in source.namelist():
                raw = source.read(item)
                if item == "modelDescription.xml":
                    assert old.encode() in raw
                    raw = raw.replace(old.encode(), new.encode())
                if (kept := name(item)) is not None:
                    target.writestr(kept, raw)
        return path

    return change
