"""What a process asks of the kernel to be on time."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

from rigd.engine.child import Child
from rigd.engine.realtime import PREFERRED, as_program, before_programs, preferring

ENTER_AND_LEAVE = """
import json, os
from rigd.engine.realtime import RealTime

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


def session_weight(pid: int | str) -> str | None:
    """Return the weight of the session of ``pid``; None if this kernel has none (sched(7))."""
    file = Path(f"/proc/{pid}/autogroup")
    return file.read_text().split()[-1] if file.is_file() else None


def test_session_of_a_preferred_process_is_preferred() -> None:
    """Its nice value has no meaning beside other sessions."""
    ours = session_weight("self")
    child = Child(["sleep", "60"], preferred=True)
    ordinary = Child(["sleep", "60"])
    try:
        weights = [session_weight(item.pid) for item in (child, ordinary)]
        granted = os.getpriority(os.PRIO_PROCESS, child.pid) == PREFERRED
        expected = str(PREFERRED) if granted else "0"
        assert weights == ([None, None] if ours is None else [expected, "0"])
    finally:
        assert child.fence(20.0) and ordinary.fence(20.0)
    assert session_weight("self") == ours


def test_work_in_background_weighs_less_beside_sessions() -> None:
    code = "import os, sys; from rigd.engine.realtime import set_nice; set_nice(15); input()"
    process = subprocess.Popen(
        [sys.executable, "-c", f"{code}; print(os.getpriority(os.PRIO_PROCESS, 0)); input()"],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True, text=True,
    )  # fmt: skip
    assert process.stdin and process.stdout
    process.stdin.write("\n")
    process.stdin.flush()
    assert process.stdout.readline() == "15\n"
    assert session_weight(process.pid) == ("15" if session_weight("self") else None)
    process.communicate("\n", timeout=120)
    assert process.returncode == 0
