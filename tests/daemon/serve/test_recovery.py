"""Runs whose processes were killed are found, completed and offered."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigd.daemon.serve.recordings import Recordings
from rigd.daemon.serve.upkeep.notices import Notices
from rigd.daemon.serve.upkeep.recovery import OFFERED, Interruptions
from rigd.daemon.serve.upkeep.trips import TripMemory
from rigd.engine.shared import RunFolder
from rigd.model.channels import Channel, Stream
from rigd.record import NO_TRIAL, Recording, RecordingWriter
from rigd.remote.protocol import Refusal

AXIS = Stream("axis", (Channel("position", "m"),))
TRIP = {
    "name": "far", "action": "abort", "priority": "high", "latched": False, "value": 2.0,
    "reason": "axis.position 2 m is above its limit 1 m", "message": "too far",
}  # fmt: skip


def record(path: Path, *, ended: str = "", tripped: bool = False) -> Path:
    run = {"procedure": "sweep", "rig": "bench", "seed": "1", "trials": "3"}
    with RecordingWriter.create(
        path, streams=[AXIS], metadata={"run": run}, attachments=(), start_ns=1_000,
        sync_interval_s=None,
    ) as writer:  # fmt: skip
        writer.event(1_000, "run_start", NO_TRIAL, {})
        writer.event(2_000, "trial_start", 1, {"number": 1})
        writer.event(3_000, "trial_end", 1, {"complete": True, "reason": ""})
        if tripped:
            writer.event(4_000, "interlock", 2, TRIP)
        if ended:
            writer.event(5_000, "run_end", NO_TRIAL, {"state": ended, "reason": "why"})
    return path


def recover(runs: Path) -> tuple[Interruptions, TripMemory, list[str]]:
    """Do what a daemon does at its start; return what it found, and what it reported."""
    notices = Notices(lambda: None)
    found = Interruptions("bench", Recordings(runs), notices)
    trips = TripMemory(runs / "trips.json")
    folder = RunFolder.take("bench", command="test")
    try:
        found.recover(folder, trips)
    finally:
        folder.release()
    return found, trips, [view.text for view in notices.views()]


def test_the_newest_interrupted_runs_are_offered(tmp_path: Path) -> None:
    for number in range(OFFERED + 3):
        record(tmp_path / f"2026112{number:02}-sweep.mcap")
    record(tmp_path / "20261299-sweep.mcap", ended="complete")
    found, _, told = recover(tmp_path)
    offered = found.views()
    assert len(offered) == OFFERED
    assert (offered[0].run, offered[0].trials_done, offered[0].trials_total) == (
        f"2026112{OFFERED + 2}-sweep.mcap", 1, 3,
    )  # fmt: skip
    assert told == [
        f"{offered[0].run} ended after 1 of 3 trials (its recording has no end); "
        f"`rigd remote resume-run {offered[0].run}` goes on with it"
    ]


def test_a_torn_recording_is_repaired_and_offered(tmp_path: Path) -> None:
    path = record(tmp_path / "a.mcap")
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(Exception, match="recover"):
        Recording.open(path)
    found, _, told = recover(tmp_path)
    assert [view.run for view in found.views()] == ["a.mcap"]
    assert told[0].startswith("a.mcap was torn and is repaired")


def test_unrepairable_recording_does_not_prevent_serving(tmp_path: Path) -> None:
    (tmp_path / "none.mcap").write_bytes(b"")
    record(tmp_path / "a.mcap")
    found, _, told = recover(tmp_path)
    assert [view.run for view in found.views()] == ["a.mcap"]
    assert any("none.mcap is empty" in line for line in told)


def test_trip_in_a_killed_run_bars_the_next(tmp_path: Path) -> None:
    record(tmp_path / "a.mcap", tripped=True)
    _, trips, _ = recover(tmp_path)
    with pytest.raises(Refusal, match="far tripped"):
        trips.begin_run()
    trips.acknowledge("far", "alice")
    # Not again at the next start: it is known.
    _, trips, _ = recover(tmp_path)
    trips.begin_run()


def test_only_last_run_can_bar_the_next(tmp_path: Path) -> None:
    record(tmp_path / "a.mcap", tripped=True)
    record(tmp_path / "b.mcap", ended="complete")
    _, trips, _ = recover(tmp_path)
    assert trips.views() == ()


def test_resumed_run_is_not_offered_again(tmp_path: Path) -> None:
    path = record(tmp_path / "a.mcap")
    found, _, _ = recover(tmp_path)
    path.unlink()
    record(path, ended="complete")
    found.ended("a.mcap")
    assert found.views() == ()
    record(tmp_path / "b.mcap", ended="interrupted")
    found.ended("b.mcap")
    assert [view.run for view in found.views()] == ["b.mcap"]
    found.ended("c.mcap")  # blocked: it left no file
    assert [view.run for view in found.views()] == ["b.mcap"]


def test_memory_of_another_version_is_kept_and_ignored(tmp_path: Path) -> None:
    folder = RunFolder.take("bench", command="test")
    (folder.path / "job.json").write_text('{"version": 99}')
    (folder.path / "rows-0.ring").write_bytes(b"rows of another version")
    folder.release()
    _, _, told = recover(tmp_path)
    (kept,) = tmp_path.glob("bench-left-*")
    assert (kept / "rows-0.ring").read_bytes() == b"rows of another version"
    assert any(f"they are kept in {kept.name}" in line for line in told)
    assert not folder.has_job
