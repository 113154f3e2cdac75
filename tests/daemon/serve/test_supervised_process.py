"""A process beside the daemon: started, started again, ended, and never left behind."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from support.recordings.blocks import alive

from rigd.daemon.serve.upkeep import supervised_process as module
from rigd.daemon.serve.upkeep.notices import Notices
from rigd.daemon.serve.upkeep.supervised_process import SupervisedProcess

#: Writes its process id, then waits to be ended.
COMMAND = "import os, pathlib, sys, time; p = pathlib.Path(sys.argv[1]); \
d = p.with_suffix('.new'); d.write_text(str(os.getpid())); d.replace(p); time.sleep(600)"


#: Reports that it waits, and waits for a line.
STAND_BY = "import os, pathlib, sys; w = pathlib.Path(sys.argv[2]); d = w.with_suffix('.new'); \
d.write_text(str(os.getpid())); d.replace(w); sys.stdin.readline() or sys.exit(); "


def until(condition: Callable[[], bool], do: Callable[[], None] = lambda: None) -> None:
    deadline = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < deadline
        do()
        time.sleep(0.02)


def test_supervised_process_ends_with_the_daemon(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "AGAIN_S", 0.0)
    notices, said = Notices(lambda: None), tmp_path / "pid"
    with SupervisedProcess(
        "the panel", [sys.executable, "-c", COMMAND, str(said)], notices
    ) as process:
        until(said.exists, process.tend)
        first = int(said.read_text())
        os.kill(first, signal.SIGKILL)
        until(lambda: int(said.read_text()) != first, process.tend)
        second = int(said.read_text())
        assert [view.text for view in notices.views()] == [
            "the panel was ended by SIGKILL, and is started again at once"
        ]
    assert not alive(second)


def test_waiting_spare_takes_over(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "SPARE_S", 0.0)
    notices, said, waits = Notices(lambda: None), tmp_path / "pid", tmp_path / "waits"
    command = [sys.executable, "-c", COMMAND, str(said)]
    spare = [sys.executable, "-c", STAND_BY + COMMAND, str(said), str(waits)]
    with SupervisedProcess("the panel", command, notices, spare) as process:
        for _ in range(2):
            until(lambda: said.exists() and waits.exists(), process.tend)
            first, standing_by = int(said.read_text()), int(waits.read_text())
            waits.unlink()
            assert first != standing_by
            os.kill(first, signal.SIGKILL)
            until(lambda first=first: int(said.read_text()) != first, process.tend)  # type: ignore[misc]
            assert int(said.read_text()) == standing_by
        until(waits.exists, process.tend)
    assert not alive(standing_by) and not alive(int(waits.read_text()))


def test_child_that_always_dies_is_started_less_often(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise OSError(errno.ENOMEM, os.strerror(errno.ENOMEM))

    now_s = 1000.0
    monkeypatch.setattr(time, "monotonic", lambda: now_s)
    monkeypatch.setattr(subprocess, "Popen", refuse)
    notices = Notices(lambda: None)
    with SupervisedProcess("the panel", ["panel"], notices) as process:
        for _ in range(1200):
            now_s += 1.0
            process.tend()
    told = [view.text for view in notices.views()]
    assert told[0].startswith("the panel cannot be started (Cannot allocate memory), and")
    assert [text.rpartition("started again ")[2] for text in told] == [
        "at once", "in 0.5 s", "in 1 s", "in 2 s", "in 4 s", "in 8 s", "in 16 s", "in 32 s",
        "in 64 s", "in 128 s", "in 256 s", "in 300 s", "in 300 s", "in 300 s",
    ]  # fmt: skip


def test_process_ends_when_the_daemon_is_killed(tmp_path: Path) -> None:
    said = tmp_path / "pid"
    daemon = (
        "import sys, time; from rigd.daemon.serve.upkeep.notices import Notices; "
        "from rigd.daemon.serve.upkeep.supervised_process import SupervisedProcess; "
        "p = SupervisedProcess('it', sys.argv[1:], Notices(lambda: None)); p.__enter__(); "
        "time.sleep(600)"
    )
    command = [sys.executable, "-c", COMMAND, str(said)]
    with subprocess.Popen([sys.executable, "-c", daemon, *command]) as parent:
        until(said.exists)
        parent.kill()
    until(lambda: not alive(int(said.read_text())))
