from __future__ import annotations

from pathlib import Path

import pytest

from rigd.config.loader import load_rig
from rigd.daemon.execute import RunRequest, execute
from rigd.engine import clock
from rigd.procedure.compile import compile_procedure
from rigd.procedure.loader import load_procedure
from rigd.record import Recording


@pytest.mark.parametrize("seed", [79_999, 99_999, 2**31])
def test_no_seed_runs_past_end_of_int64_nanoseconds(tmp_path: Path, seed: int) -> None:
    rig, source = load_rig("lugre-1"), load_procedure("quick")
    request = RunRequest(
        compile_procedure(source, rig, {}), source.file.text, rig, seed, output=tmp_path / "q.mcap"
    )
    info = Recording.open(execute(request).path).info
    assert info.state == "complete"
    assert info.trials
    for trial in info.trials:
        assert trial.end_ns is not None
        assert 0 < trial.start_ns < trial.end_ns < 2**63


def test_unreached_pace_is_told_and_recorded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(clock, "SLOWER", 1e6)  # no machine is as fast
    monkeypatch.setattr(clock, "JUDGED_NS", 100_000_000)
    rig, source = load_rig("lugre-1"), load_procedure("quick")
    request = RunRequest(
        compile_procedure(source, rig, {}),
        source.file.text,
        rig,
        seed=1,
        pace=50.0,
        output=tmp_path / "q.mcap",
    )
    told: list[str] = []
    done = execute(request, notify=told.append)
    assert done.result.missed_cycles == 0
    (line,) = told
    assert line.startswith("slower than asked: ")
    assert "of 50 times real time" in line
    (event,) = [item for item in Recording.open(done.path).events() if item.kind == "slower"]
    assert event.data["pace"] == 50.0
    assert 0 < event.data["reached"] < 100
