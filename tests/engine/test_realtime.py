"""What a process asks of the kernel to be on time."""

from __future__ import annotations

import json
import os
import subprocess
import sys

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
