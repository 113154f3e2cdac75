"""A process that this one starts: how it ended, what it printed last, and that it is gone."""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path

import pytest
from support.recordings.blocks import until

from rigd.engine.system.child import Child

PATIENCE_S = 60.0


def python(code: str) -> list[str]:
    return [sys.executable, "-c", code]


def test_last_words_are_those_of_this_process(tmp_path: Path) -> None:
    log = tmp_path / "log"
    for code, words in (("print('one'); print('two')", "two"), ("pass", "")):
        child = Child(python(code), log=log)
        assert child.wait(PATIENCE_S)
        assert (child.ended, child.last_words()) == ("ended by itself (exit code 0)", words)
    assert log.read_text() == "one\ntwo\n"


def test_child_that_ignores_signals_is_fenced(tmp_path: Path) -> None:
    ready = tmp_path / "ready"
    child = Child(
        python(
            "import signal, sys, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); "
            f"open({str(ready)!r}, 'w').close(); sys.stdin.read() or time.sleep(600)"
        ),
        stdin=True,
    )
    while not ready.exists():
        assert not child.wait(0.01)
    child.terminate()
    assert not child.wait(0.1)
    assert child.ended == ""
    assert child.fence(PATIENCE_S)
    assert child.fence(PATIENCE_S)
    assert child.ended == "was ended by SIGKILL"
    child.close_stdin()


def test_fate_of_killed_child_waits_for_kernel() -> None:
    """Its memory is freed first: until then waitpid shows a process that runs."""
    child = Child(
        python(
            "held = bytearray(200_000_000); held[::4096] = bytes(len(held[::4096])); "
            "print(flush=True); input()"
        ),
        stdin=True,
    )
    assert child.fate(PATIENCE_S) == ""  # one that runs is not waited for
    os.kill(child.pid, signal.SIGKILL)
    assert child.fate(PATIENCE_S) == "was ended by SIGKILL"
    child.close_stdin()


@pytest.mark.parametrize("killed", [True, False])
def test_child_that_ends_late_is_reaped(killed: bool) -> None:
    child = Child(python("import sys; sys.stdin.read()"), stdin=True)
    if killed:
        child.fence(0.0)
    else:
        assert not child.leave(0.0)
    child.close_stdin()
    until(lambda: not Path(f"/proc/{child.pid}").exists(), 20.0)
    assert child.wait(PATIENCE_S)
    assert child.ended == ("was ended by SIGKILL" if killed else "ended by itself (exit code 0)")


def test_child_inherits_only_given_descriptors() -> None:
    given, kept = os.pipe()
    try:
        os.set_inheritable(kept, True)
        child = Child(
            python(f"import os; os.fstat({given}); print('given'); os.fstat({kept})"),
            fds=(given, -1),
            output=True,
        )
        said = child.talk(None, PATIENCE_S)
    finally:
        os.close(given)
        os.close(kept)
    assert said is not None
    assert said[0] == "given\n"
    assert "Bad file descriptor" in said[1]
    assert child.code == 1


def test_child_leads_a_session_of_its_own() -> None:
    child = Child(python("import time; time.sleep(600)"))
    assert os.getsid(child.pid) == child.pid  # a terminal's Ctrl-C does not reach it
    assert child.fence(PATIENCE_S)


def test_waiting_child_is_woken_once() -> None:
    child = Child(python("input()"), stdin=True)
    assert child.wake()
    assert child.wait(PATIENCE_S)
    assert not child.wake()  # no process is there to read it
    assert child.code == 0


def test_child_still_at_work_talks_later() -> None:
    child = Child(
        python("import sys, time; said = sys.stdin.read(); time.sleep(0.5); print(said)"),
        stdin=True,
        output=True,
    )
    given: str | None = "order"
    while (said := child.talk(given, 0.1)) is None:
        given = None
    assert said == ("order\n", "")
