"""A folder of recordings of four runs, which the tests search."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from rigd.model import Channel, Stream
from rigd.record import RecordingWriter

START_NS = 1_790_000_000_000_000_000
CARRIAGE = Stream("carriage", (Channel("position", "m"),))


def write_run(
    path: Path,
    run: Mapping[str, str],
    currents: tuple[float, ...] = (),
    state: str = "complete",
    **metadata: Mapping[str, str],
) -> None:
    """Write a recording without samples: 5 s, a trial for each current."""
    said = {"mode": "hardware", "rig": "bench", "procedure": "wear", **run}
    path.parent.mkdir(parents=True, exist_ok=True)
    options: dict[str, Any] = {"streams": (CARRIAGE,), "attachments": (), "start_ns": START_NS}
    with RecordingWriter.create(path, metadata={"run": said, **metadata}, **options) as writer:
        writer.event(START_NS, "run_start")
        for number, current in enumerate(currents, 1):
            given = {"parameters": {"current": current}, "units": {"current": "mA"}}
            writer.event(START_NS + number, "trial_start", number, given)
            writer.event(START_NS + number, "trial_end", number, {"complete": True})
        if state != "interrupted":
            writer.event(START_NS + 5_000_000_000, "run_end", None, {"state": state})


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four recordings; ``deep/d.mcap`` states nothing."""
    found = tmp_path_factory.mktemp("runs")
    write_run(
        found / "a.mcap", {"started": "2026-08-31T10:00:00+00:00", "note": "wheel cleaned"},
        (0.1, 0.2), specimen={"name": "W7", "coating": "PTFE", "hardness": "5 GPa"},
        meta={"batch": "13"},
    )  # fmt: skip
    write_run(
        found / "b.mcap", {"started": "2026-09-01T23:59:00+00:00", "operator": "A. Miller"},
        (0.15,), specimen={"name": "W8", "coating": "PTFE"}, meta={"batch": "14", "lot": "x1"},
        overrides={"floor": "pvc"}, parameters={"floor": "pvc", "lot": "7"},
    )  # fmt: skip
    write_run(
        found / "c.mcap", {"started": "2026-10-02T00:00:00+00:00", "procedure": "creep",
                           "note": "Öl gewechselt"},
        state="tripped", specimen={"name": "W9", "coating": "DLC", "hardness": "20 GPa"},
    )  # fmt: skip
    write_run(found / "deep" / "d.mcap", {"started": "2026-11-01T00:00:30Z"}, state="interrupted")
    return found


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder for indexes."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture
def write() -> Callable[..., None]:
    """Writes a recording: :func:`write_run`."""
    return write_run
