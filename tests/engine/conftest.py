"""What several tests of the engine share."""

from __future__ import annotations

from pathlib import Path

import pytest


@pytest.fixture
def own_state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Give runs, and the processes that they start, a state folder of their own."""
    state = tmp_path / "state"
    state.mkdir(mode=0o700)
    monkeypatch.setenv("RIGD_STATE", str(state))
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[1]))
