"""The shipped rig file, as text to be spoilt."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from rigd.sdk.shipped_files import shipped_folder

Spoil = Callable[[str, str], str]


@pytest.fixture
def rig_path() -> Path:
    return shipped_folder("configs") / "sim_lugre.yaml"


@pytest.fixture
def rig_text(rig_path: Path) -> str:
    return rig_path.read_text()


@pytest.fixture
def spoil(rig_text: str) -> Spoil:
    """Replace the one place where ``old`` stands."""

    def replace(old: str, new: str) -> str:
        assert rig_text.count(old) == 1, f"{old!r} stands {rig_text.count(old)} times"
        return rig_text.replace(old, new)

    return replace
