"""The processor of a cycle: what others take is seen, and cycles that start at once share out."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

from rigd.daemon.doctor.check import CheckVerdict
from rigd.daemon.doctor.machine import rigs_check
from rigd.engine.system import processors
from rigd.engine.system.processors import Resident, fitting, freest, residents, taken_by

#: /proc/PID/stat from the state on; flags and policy are filled in.
STAT = "S 1 1 1 0 -1 {flags} " + "0 " * 28 + "17 1 80 {policy} 0"


def process(
    proc: Path,
    pid: int,
    allowed: str,
    *,
    policy: int = os.SCHED_FIFO,
    flags: int = 0,
    command: str = "x",
) -> Path:
    """Make a process below ``proc``."""
    folder = proc / str(pid)
    folder.mkdir()
    stat = STAT.format(flags=flags, policy=policy)
    (folder / "stat").write_text(f"{pid} (a) name) {stat}")
    (folder / "status").write_text(f"Name:\ta) name\nCpus_allowed_list:\t{allowed}\nX:\t1\n")
    (folder / "cmdline").write_bytes(command.replace(" ", "\0").encode())
    (folder / "schedstat").write_text("1000 2 3\n")
    return folder


def test_only_cycles_that_keep_to_a_processor_count(tmp_path: Path) -> None:
    process(tmp_path, 11, "3")
    process(tmp_path, 12, "0-3")  # real time, and runs where there is room
    process(tmp_path, 13, "2", policy=os.SCHED_OTHER)  # no cycle of rigd
    refused = "python -P -m rigd.engine.process.cycle_process /run/x 5"
    process(tmp_path, 14, "1", policy=os.SCHED_OTHER, command=refused)
    process(tmp_path, 15, "0", flags=0x200040)  # a thread of the kernel
    (tmp_path / "16").mkdir()  # it has just ended
    (tmp_path / "uptime").write_text("5 5")
    found = residents(tmp_path, 0.0)
    assert {(resident.pid, resident.processor) for resident in found} == {(11, 3), (14, 1)}


def test_share_is_what_process_ran_meanwhile(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    busy = process(tmp_path, 11, "1")
    now_ns = [0]

    class Clock:
        @staticmethod
        def monotonic_ns() -> int:
            return now_ns[0]

        @staticmethod
        def sleep(seconds: float) -> None:
            now_ns[0] += round(seconds * 1e9)
            (busy / "schedstat").write_text(f"{1000 + now_ns[0] // 4} 2 3\n")

    monkeypatch.setattr(processors, "time", Clock)
    assert residents(tmp_path, 0.05) == [Resident(11, 1, 0.25)]


def test_freest_is_chosen_and_the_present_of_equals() -> None:
    taken = taken_by([Resident(1, 0, 0.6), Resident(2, 1, 0.1), Resident(3, 1, 0.0)])
    assert taken == {0: 0.6, 1: pytest.approx(0.15)}  # one that waits counts a little
    assert freest({0, 1}, taken, present=0) == 1
    assert freest({0, 1, 2, 3}, taken, present=3) == 3
    assert freest({0, 1, 2}, taken, present=0) == 2
    assert freest({0}, taken, present=0) == 0  # no other is allowed


@pytest.mark.parametrize(
    ("share", "count"), [(0.1, 3 + 5), (0.25, 1 + 2), (0.5, 1), (0.51, 0), (0.0, 7 + 10)]
)
def test_cycles_fit_up_to_half_of_processor(share: float, count: int) -> None:
    assert fitting(share, {0, 1}, {0: 0.15, 7: 0.9}) == count


def test_doctor_counts_cycles_and_what_fits() -> None:
    found = [Resident(1, 0, 0.2), Resident(2, 1, 0.3), Resident(3, 1, 0.1)]
    check = rigs_check("machine", {0, 1}, found, 0.1)
    assert check.verdict is CheckVerdict.OK
    assert check.found == (
        "cycles that run now: 1 on processor 0 (20% of it), 2 on processor 1 (40% of it); room for "
        "4 more like this one, which takes 10% of a processor"
    )
    assert rigs_check("machine", {0, 1}, []).found.startswith(
        "cycles that run now: none; room for 10 more"
    )


def test_doctor_warns_of_full_and_badly_shared_processors() -> None:
    shared = rigs_check("machine", {0, 1}, [Resident(1, 0, 0.1), Resident(2, 0, 0.1)])
    assert shared.verdict is CheckVerdict.WARN
    assert "processor 0 carries several cycles while 1 is free" in shared.advice
    full = rigs_check("machine", {0, 1}, [Resident(1, 0, 0.4), Resident(2, 0, 0.2)])
    assert "processor 0 is full" in full.advice


KEPT = """
import json, os, sys
from rigd.engine.system import processors
from rigd.engine.system.realtime import RealTime
seen = []
def residents(found=processors.residents):
    seen.extend(found())
    return seen
processors.residents, processors._PATIENCE_S = residents, 600.0
print("ready", flush=True)
sys.stdin.readline()
RealTime()._pin_to_processor()
kept = sorted(os.sched_getaffinity(0))
print(json.dumps([kept, processors.taken_by(seen), len(seen)]), flush=True)
sys.stdin.readline()
"""


def test_cycles_that_start_at_once_share_out() -> None:
    """Real processes that look like cycles: by their command, as real time may be refused.

    What each takes is measured, and on a loaded machine more than it computes: so they are not
    half and half, but each chose after the others, and the one of which least was taken.
    """
    allowed = os.sched_getaffinity(0)
    before = Counter(resident.processor for resident in residents())
    count = 2 * len(allowed)
    others = [
        subprocess.Popen(
            [sys.executable, "-c", KEPT, "rigd.engine.process.cycle_process"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        for _ in range(count)
    ]
    try:
        for other in others:
            assert other.stdout is not None
            assert other.stdout.readline() == "ready\n"
        for other in others:
            assert other.stdin is not None
            other.stdin.write("\n")
            other.stdin.flush()
        kept = [json.loads(other.stdout.readline()) for other in others if other.stdout is not None]
        now = residents()
        found = {resident.pid: resident.processor for resident in now}
        assert {other.pid: kept[n][0][0] for n, other in enumerate(others)}.items() <= found.items()
    finally:
        for other in others:
            other.communicate("\n")
    for (chosen, *more), taken, _ in kept:
        assert not more
        least = min(round(taken.get(str(each), 0.0), 2) for each in allowed)
        assert round(taken.get(str(chosen), 0.0), 2) == least
    if not before and len(now) == count:  # no other cycle of this machine was in their way
        assert sorted(seen for *_, seen in kept) == list(range(count))
