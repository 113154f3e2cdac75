"""What a shipped procedure records on a shipped rig in virtual time, byte for byte."""

from __future__ import annotations

from pathlib import Path

import pytest
from contract.golden import Check
from contract.recording_text import text_of
from support.shipped_runs import pairs, play

pytestmark = pytest.mark.timeout(1800)

#: Every procedure on every rig that it fits.
PAIRS = {pair.name: pair for pair in pairs()}


def _recorded(name: str, seed: int, trials: int | None, folder: Path) -> str:
    path = folder / "run.mcap"
    play(PAIRS[name], seed, path, trials)
    return text_of(path)


@pytest.mark.parametrize("name", PAIRS)
def test_first_trials_are_as_before(name: str, tmp_path: Path, unchanged: Check) -> None:
    unchanged(f"{name}, first trials", _recorded(name, 2, 4, tmp_path))


@pytest.mark.parametrize("name", PAIRS)
def test_whole_run_is_as_before(name: str, tmp_path: Path, unchanged: Check) -> None:
    unchanged(f"{name}, whole", _recorded(name, 1, None, tmp_path))
