"""Chooses the processor of a cycle by what the cycles of other rigs take of each.

Cycles of one priority wait for each other: two on one processor while another is free make each
other late. The cycles are found in ``/proc`` (proc(5)): processes that keep to one processor, and
have real-time priority or are cycles of rigd. What each takes is measured.
"""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

#: Time over which it is measured what each cycle takes, in s: some cycles of any rate.
MEASURED_S: Final = 0.05
#: A cycle counts as taking at least this share: one that was just started waits for its devices.
LEAST_SHARE: Final = 0.05
#: A processor has room for cycles that together take at most this share of its time. Recorder and
#: daemon need the rest, and a cycle that waits for all others must still end in its period.
MOST_SHARE: Final = 0.5
#: The name, which the kernel knows on the whole machine, held while a process chooses.
_CHOOSING: Final = "\0rigd.processor"
#: Longest wait for others that choose; then it is chosen beside them.
_PATIENCE_S: Final = 2.0
#: The module that a process runs whose cycle has no real-time priority.
_CYCLE: Final = b"rigd.engine.process.cycle_process"


@dataclass(frozen=True)
class Resident:
    """A process that keeps to one processor, and the share of its time that it took, 0 to 1."""

    pid: int
    processor: int
    share: float


def residents(proc: Path = Path("/proc"), measured_s: float = MEASURED_S) -> list[Resident]:
    """Return the other cycles of this machine, after ``measured_s``."""
    found = {pid: kept for pid in _pids(proc) if (kept := _kept_to(proc / str(pid))) is not None}
    before = {pid: _ran_ns(proc / str(pid)) for pid in found}
    began_ns = time.monotonic_ns()
    if found:
        time.sleep(measured_s)
    took_ns = max(time.monotonic_ns() - began_ns, 1)
    return [
        Resident(pid, processor, max(0, _ran_ns(proc / str(pid)) - before[pid]) / took_ns)
        for pid, processor in found.items()
    ]


def freest(allowed: set[int], taken: Mapping[int, float], present: int) -> int:
    """Return the processor among ``allowed`` of which least is taken; ``present`` if it is one."""
    return min(allowed, key=lambda each: (round(taken.get(each, 0.0), 2), each != present, each))


def taken_by(found: Sequence[Resident]) -> dict[int, float]:
    """Return the share of each processor that cycles take, each :data:`LEAST_SHARE` at least."""
    taken: dict[int, float] = {}
    for resident in found:
        taken[resident.processor] = taken.get(resident.processor, 0.0) + max(
            resident.share, LEAST_SHARE
        )
    return taken


def fitting(share: float, allowed: set[int], taken: Mapping[int, float]) -> int:
    """Return how many more cycles fit that each take ``share`` of a processor."""
    each = max(share, LEAST_SHARE)
    rooms = (MOST_SHARE - taken.get(processor, 0.0) for processor in allowed)
    return sum(max(0, int(room / each + 1e-9)) for room in rooms)


def choose_processor() -> tuple[int, float]:
    """Keep this thread to the processor of which least is taken.

    Processes that choose at the same time do so one after the other.

    Returns:
        The number of the processor, and the share that other cycles take of it.

    Raises:
        OSError: the kernel refuses.
    """
    allowed = os.sched_getaffinity(0)
    with _alone():
        taken = taken_by(residents())
        chosen = freest(allowed, taken, _present())
        os.sched_setaffinity(0, {chosen})
    return chosen, taken.get(chosen, 0.0)


def _present() -> int:
    line = Path("/proc/self/stat").read_bytes()
    return int(line.rpartition(b")")[2].split()[36])


@contextmanager
def _alone() -> Iterator[None]:
    """Wait until no other process of this machine chooses; not for ever."""
    until = time.monotonic() + _PATIENCE_S
    with socket.socket(socket.AF_UNIX) as name:
        while True:
            with suppress(OSError):
                name.bind(_CHOOSING)
                break
            if time.monotonic() > until:
                break
            time.sleep(0.01)
        yield


def _pids(proc: Path) -> list[int]:
    own = os.getpid()
    pids = [int(each.name) for each in proc.iterdir() if each.name.isdecimal()]
    return [pid for pid in pids if pid != own]


def _kept_to(process: Path) -> int | None:
    """Return the processor that a cycle keeps to; None for every other process."""
    try:
        found = (process / "stat").read_bytes().rpartition(b")")[2].split()
        kthread, policy = int(found[6]) & 0x200000, int(found[38])
        if kthread or found[0] in (b"Z", b"X"):
            return None
        real_time = policy in (os.SCHED_FIFO, os.SCHED_RR)
        if not real_time and _CYCLE not in (process / "cmdline").read_bytes().split(b"\0"):
            return None
        for line in (process / "status").read_text().splitlines():
            key, _, value = line.partition(":")
            if key == "Cpus_allowed_list":
                return int(value) if value.strip().isdecimal() else None
    except (OSError, ValueError, IndexError):  # it has ended, or is another user's and hidden
        return None
    return None


def _ran_ns(process: Path) -> int:
    """Return for how long a process has run, in ns; 0 if it does not show."""
    with suppress(OSError, ValueError, IndexError):
        return int((process / "schedstat").read_text().split()[0])
    return 0
