"""What a process asks of the kernel to be on time."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from rigd.engine.system.child import Child
from rigd.engine.system.realtime import (
    PREFERRED,
    as_program,
    before_programs,
    preferring,
    weigh_session,
)

ENTER_AND_LEAVE = """
import json, os
from rigd.engine.system.realtime import RealTime

before = os.sched_getaffinity(0)
real_time = RealTime()
real_time.enter()
within = os.sched_getaffinity(0)
real_time.leave()
after = os.sched_getaffinity(0)
print(json.dumps([sorted(before), sorted(within), sorted(after), real_time.granted]))
"""


def test_realtime_process_stays_on_one_processor() -> None:
    done = subprocess.run(
        [sys.executable, "-c", ENTER_AND_LEAVE], check=True, capture_output=True, timeout=60
    )
    before, within, after, granted = json.loads(done.stdout)
    assert len(within) == 1
    assert set(within) <= set(before)
    assert after == before
    assert any(item.split(",")[0] == f"processor {within[0]}" for item in granted)  # beside others


def policy_of_a_process() -> int:
    """Return the scheduling policy of a process that this thread starts."""
    code = "import os; print(os.sched_getscheduler(0))"
    return int(subprocess.check_output([sys.executable, "-c", code], timeout=60))


def test_a_program_started_by_the_daemon_is_ordinary() -> None:
    before = os.sched_getscheduler(0)
    with before_programs():
        within = os.sched_getscheduler(0)
        with as_program():
            assert policy_of_a_process() == os.SCHED_OTHER
        assert os.sched_getscheduler(0) == within
    assert os.sched_getscheduler(0) == before


def test_process_that_a_run_waits_for_is_preferred() -> None:
    code = "import os; print(os.getpriority(os.PRIO_PROCESS, 0))"
    before = os.getpriority(os.PRIO_PROCESS, 0)
    with as_program(), preferring():
        within = os.getpriority(os.PRIO_PROCESS, 0)
        assert int(subprocess.check_output([sys.executable, "-c", code], timeout=60)) == within
    assert within in (PREFERRED, before)  # the kernel may refuse it
    assert os.getpriority(os.PRIO_PROCESS, 0) == before


def session_weight(pid: int) -> str | None:
    """Return the weight of the session of ``pid``; None if this kernel has none (sched(7)).

    The file is absent, or it is empty, as it is for a process that no session holds.
    """
    file = Path(f"/proc/{pid}/autogroup")
    words = file.read_text().split() if file.is_file() else []
    return words[-1] if words else None


def test_session_of_a_preferred_process_is_preferred() -> None:
    """Its nice value has no meaning beside other sessions."""
    ours = session_weight(os.getpid())
    child = Child(["sleep", "60"], preferred=True)
    ordinary = Child(["sleep", "60"])
    try:
        weight, beside = [session_weight(item.pid) for item in (child, ordinary)]
        granted = os.getpriority(os.PRIO_PROCESS, child.pid) == PREFERRED
        expected = str(PREFERRED) if granted else "0"
        assert (weight, beside) in ((expected, "0"), (None, None))
    finally:
        assert child.fence(20.0) and ordinary.fence(20.0)
    assert session_weight(os.getpid()) == ours


def test_work_in_background_weighs_less_beside_sessions() -> None:
    code = "import os; from rigd.engine.system.realtime import set_nice; input(); set_nice(15)"
    process = subprocess.Popen(
        [sys.executable, "-c", f"{code}; print(os.getpriority(os.PRIO_PROCESS, 0)); input()"],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True, text=True,
    )  # fmt: skip
    with process:
        assert process.stdin and process.stdout
        before = session_weight(process.pid)
        process.stdin.write("\n")
        process.stdin.flush()
        assert process.stdout.readline() == "15\n"
        assert (before, session_weight(process.pid)) in (("0", "15"), (None, None))
        process.communicate("\n", timeout=120)
    assert process.returncode == 0


def test_session_that_prefers_a_child_keeps_its_weight() -> None:
    """A daemon that systemd starts began its session: only what it starts is preferred."""
    code = (
        "from rigd.engine.system.realtime import preferring\n"
        "with preferring(): pass\nprint(); input()"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True, text=True,
    )  # fmt: skip
    with process:
        assert process.stdout and process.stdout.readline() == "\n"
        assert session_weight(process.pid) in ("0", None)
        process.communicate("\n", timeout=120)


def test_weighing_is_repeated_while_the_kernel_is_busy(monkeypatch: pytest.MonkeyPatch) -> None:
    """It takes one in 100 ms from all users that are not root (EAGAIN)."""
    written: list[str] = []

    def write(file: Path, text: str) -> int:
        written.append(f"{file} {text}")
        if len(written) < 3:
            raise BlockingIOError
        return len(text)

    monkeypatch.setattr(Path, "write_text", write)
    weigh_session(7, 15)
    assert written == ["/proc/7/autogroup 15"] * 3
