"""The idle rig is shown again after a start that failed, and after a run whose end went wrong."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.daemon.served_axis import LONG, SWEEP, ServedAxis, travelling

from rigd.daemon.serve.idle_rig import IdleRig
from rigd.engine.shared import RunFolder
from rigd.model.errors import RecordingError
from rigd.remote.protocol import Refusal


@pytest.fixture
def shown(monkeypatch: pytest.MonkeyPatch) -> list[bool]:
    """Return a list that ends with whether the idle rig is shown."""
    states = [True]
    monkeypatch.setattr(IdleRig, "show", lambda _: states.append(True))
    monkeypatch.setattr(IdleRig, "end", lambda _: states.append(False))
    return states


def no_room(*_: object, **__: object) -> None:
    raise RecordingError("no room")


def test_idle_rig_is_shown_after_failed_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, shown: list[bool]
) -> None:
    with ServedAxis(tmp_path) as served:
        served.command("lease_take")
        monkeypatch.setattr(served.interruptions, "settle", no_room)
        with pytest.raises(Refusal, match="no room"):
            served.command("start", procedure=travelling(SWEEP))
        assert shown == [True, False, True]
        assert served.status.state == "idle"


def test_failed_step_after_run_skips_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, shown: list[bool]
) -> None:
    with ServedAxis(tmp_path) as served:
        run = served.start(LONG)
        served.until(lambda status: status.step == "go")
        ended: list[str] = []
        monkeypatch.setattr(RunFolder, "mark", no_room)
        monkeypatch.setattr(served.interruptions, "ended", ended.append)
        served.stop("eve", "abort")
        status = served.until(lambda _: shown[-1])
        assert status.state == "idle"
        assert ended == [run]
        texts = [notice.text for notice in status.notices]
        assert any("no room" in text for text in texts)
        assert texts[-1].startswith(f"{run}: aborted")
