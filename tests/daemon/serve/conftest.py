"""A state folder of its own for each test, and fakes that its processes find."""

from __future__ import annotations

from pathlib import Path

import pytest


@pytest.fixture(autouse=True)
def own_state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    state = tmp_path / "state"
    state.mkdir(mode=0o700)
    monkeypatch.setenv("RIGD_STATE", str(state))
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[2]))
