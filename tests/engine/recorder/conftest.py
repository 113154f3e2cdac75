"""A run's folder with rings, and what a finished recording must hold."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from rigd.engine.shared import Job, RunFolder
from rigd.model import Channel, Stream
from rigd.record import Attachment, Recording, recover

START_NS = 1_790_000_000_000_000_000
STREAMS = (
    Stream("fast", tuple(Channel(f"c{i}") for i in range(4))),
    Stream("slow", (Channel("c0"),), has_status=True),
    Stream("block", (Channel("c0"), Channel("c1"))),
)
CAPACITIES = {"fast": 30_000, "slow": 3_000, "block": 30_000}


@pytest.fixture
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("RIGD_STATE", str(tmp_path / "state"))
    return tmp_path / "state"


@pytest.fixture
def job(tmp_path: Path) -> Job:
    return Job(
        rig="bench",
        recording=tmp_path / "run.mcap",
        streams=STREAMS,
        start_ns=START_NS,
        metadata={"run": {"rig": "bench", "procedure": "sweep"}},
        attachments=(Attachment("rig.yaml", "application/yaml", b"name: bench\n"),),
    )


@pytest.fixture
def folder(state: Path, job: Job) -> Iterator[RunFolder]:
    taken = RunFolder.take("bench", command="test", recording=job.recording)
    taken.prepare(job, CAPACITIES)
    yield taken
    taken.release()


def check_numbered(path: Path, counts: dict[str, int]) -> None:
    """The recording is sound, and has rows 0 to count - 1 of each stream, each exactly once."""
    assert recover(path).intact
    recording = Recording.open(path)
    for name, count in counts.items():
        assert recording.read(name)["c0"].tolist() == list(range(count)), name


def own_events(path: Path, kind: str) -> list[int]:
    """The numbers of the events of a kind, in the order of the file."""
    return [event.data["n"] for event in Recording.open(path).events() if event.kind == kind]
