"""What a shipped procedure records on a shipped rig in virtual time, byte for byte."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import pytest
from contract.golden import Check
from contract.recording_text import text_of
from support.recordings.shipped_runs import Pair, pairs, play

pytestmark = pytest.mark.timeout(1800)

KEPT_TEXTS = Path(__file__).with_suffix("")
#: A procedure on a rig that it fits, of which a text is kept.
KEPT = sorted(path.stem.removesuffix(", whole") for path in KEPT_TEXTS.glob("*, whole.txt"))


@cache
def _pairs() -> dict[str, Pair]:
    return {pair.name: pair for pair in pairs()}


def _recorded(name: str, seed: int, trials: int | None, folder: Path) -> str:
    path = folder / "run.mcap"
    play(_pairs()[name], seed, path, trials)
    return text_of(path)


def test_every_procedure_on_every_rig_is_kept() -> None:
    """A new one begins with an empty file "PROCEDURE on RIG, whole.txt", and `--force-regen`."""
    assert sorted(_pairs()) == KEPT


@pytest.mark.parametrize("name", KEPT)
def test_first_trials_are_as_before(name: str, tmp_path: Path, unchanged: Check) -> None:
    unchanged(f"{name}, first trials", _recorded(name, 2, 4, tmp_path))


@pytest.mark.parametrize("name", KEPT)
def test_whole_run_is_as_before(name: str, tmp_path: Path, unchanged: Check) -> None:
    unchanged(f"{name}, whole", _recorded(name, 1, None, tmp_path))
