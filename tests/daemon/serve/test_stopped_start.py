"""A stop ends a start that waits or is being prepared: nothing is armed afterwards."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from support.daemon.served_axis import LONG, SWEEP, ServedAxis, travelling

from rigd.daemon.resume import read_resume_point
from rigd.daemon.serve import steering
from rigd.daemon.serve.idle_rig import IdleRig
from rigd.daemon.serve.library import Library
from rigd.remote.protocol import Code, Kind, Refusal, Requester, Role, find_verb

STOPPED = "stopped before it began"


class Held:
    """Calls a function once it is let go."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self.begun, self.let_go = threading.Event(), threading.Event()
        self._function = function

    def __call__(self, *args: Any) -> Any:
        self.begun.set()
        assert self.let_go.wait(60)
        return self._function(*args)


def refused(served: ServedAxis, held: Held, verb: str, **args: Any) -> Refusal:
    """Command, stop while ``held`` waits, and return how the command is refused."""
    with ThreadPoolExecutor() as threads:
        answer = threads.submit(served.command, verb, **args)
        try:
            assert held.begun.wait(60)
            assert served.stop("eve", "stop") is True
            assert served.stop("eve", "estop", "not that one") is True
        finally:
            held.let_go.set()
        with pytest.raises(Refusal, match=STOPPED) as caught:
            answer.result()
    return caught.value


def test_stop_ends_start_that_is_compiled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with ServedAxis(tmp_path) as served:
        served.command("lease_take")
        compiled = Library(served.rig, tmp_path / "procedures").compile
        held = Held(compiled)
        with monkeypatch.context() as slow:
            slow.setattr(Library, "compile", lambda _, args: held(args))
            refusal = refused(served, held, "start", procedure=travelling(LONG))
        assert refusal.code is Code.CONFLICT
        assert served.status.state == "idle"
        assert any("not that one" in notice.text for notice in served.status.notices)
        assert list(served.runs.glob("*.mcap")) == []
        assert served.stop("eve", "stop") is False
        served.start(LONG)  # a start after the stops begins
        served.service.tend()
    assert [line["what"] for line in served.audited()] == [
        "lease_take", "stop", "estop", "start", "lease_take", "start",
    ]  # fmt: skip


def test_stop_ends_resume_that_reads_its_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with ServedAxis(tmp_path) as served:
        run = served.start(LONG)
        served.until(lambda status: status.step == "go")
        served.stop("eve", "abort")
        served.until_idle()
        held = Held(read_resume_point)
        monkeypatch.setattr(steering, "read_resume_point", held)
        refused(served, held, "resume_run", run=run)
        assert served.status.state == "idle"


@pytest.mark.parametrize(
    ("verb", "args"),
    [
        ("start", {"procedure": travelling(SWEEP)}),
        ("act", {"device": "axis", "action": "tare"}),
    ],
)
def test_what_waited_during_stop_does_not_begin(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, verb: str, args: dict[str, Any]
) -> None:
    monkeypatch.setattr(IdleRig, "check", lambda *_: None)  # the axis has no action
    with ServedAxis(tmp_path) as served:
        served.command("lease_take")
        known = find_verb(Kind.COMMAND, verb)
        came = Requester("alice", "", Role.MAINTAINER, served.service.stops)
        assert served.stop("eve", "stop") is False
        with pytest.raises(Refusal, match=STOPPED):
            served.service.answer(known, came, known.arguments.model_validate(args))
        assert served.status.state == "idle"
