"""A run's folder with rings."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from support.engine.numbered import CAPACITIES, START_NS, STREAMS

from rigd.engine.shared import Job, RunFolder
from rigd.record import Attachment


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
