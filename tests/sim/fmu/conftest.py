from __future__ import annotations

import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest
from support.fmu import build


@pytest.fixture(scope="session")
def flywheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the FMU of ``flywheel.py``."""
    return build(tmp_path_factory.mktemp("fmu"))


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
