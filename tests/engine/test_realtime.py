"""What a process asks of the kernel to be on time."""

from __future__ import annotations

import json
import subprocess
import sys

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


def test_it_keeps_to_one_processor_until_it_leaves() -> None:
    done = subprocess.run(
        [sys.executable, "-c", ENTER_AND_LEAVE], check=True, capture_output=True, timeout=60
    )
    before, within, after, granted = json.loads(done.stdout)
    assert len(within) == 1
    assert set(within) <= set(before)
    assert after == before
    assert f"processor {within[0]}" in granted
