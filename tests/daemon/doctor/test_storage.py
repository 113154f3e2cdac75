"""Disk and ring memory, against what a rig needs."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigd.daemon.doctor.check import Check, CheckVerdict
from rigd.daemon.doctor.storage import StorageNeeds, examine_storage


@pytest.fixture(autouse=True)
def own_state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    state = tmp_path / "state"
    state.mkdir(mode=0o700)
    monkeypatch.setenv("RIGD_STATE", str(state))
    return state


def checks(runs: Path, needs: StorageNeeds | None) -> dict[str, Check]:
    return {item.name: item for item in examine_storage(runs, needs)}


def test_missing_folder_of_recordings_is_left_uncreated(tmp_path: Path) -> None:
    found = checks(tmp_path / "a" / "runs", StorageNeeds(1e3, 1000))
    speed = found["disk speed"].figures["bytes_per_s"]
    assert isinstance(speed, float)
    assert speed > 0
    assert not (tmp_path / "a").exists()
    assert [path.name for path in tmp_path.iterdir()] == ["state"]


def test_rig_that_gives_more_than_disk_takes_fails(tmp_path: Path) -> None:
    speed = checks(tmp_path, StorageNeeds(1e15, 1000))["disk speed"]
    assert speed.verdict is CheckVerdict.FAIL
    assert "fewer streams" in speed.advice


def test_rings_that_have_no_room_fail(tmp_path: Path) -> None:
    memory = checks(tmp_path, StorageNeeds(1.0, 1 << 60))["ring memory"]
    assert memory.verdict is CheckVerdict.FAIL
    assert "RIGD_STATE" in memory.advice


def test_a_state_folder_that_others_can_read_fails(tmp_path: Path, own_state: Path) -> None:
    own_state.chmod(0o755)
    memory = checks(tmp_path, None)["ring memory"]
    assert memory.verdict is CheckVerdict.FAIL
    assert "not private" in memory.found
