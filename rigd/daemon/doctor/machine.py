"""Checks the machine (Linux only): processors, clocks and kernel settings."""

from __future__ import annotations

import ctypes
import os
import platform
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from rigd.daemon.doctor.check import Check, CheckVerdict
from rigd.engine.system.processors import (
    LEAST_SHARE,
    MOST_SHARE,
    Resident,
    fitting,
    residents,
    taken_by,
)

_GROUP: Final = "machine"
_CLOCK_SOURCE: Final = Path("/sys/devices/system/clocksource/clocksource0/current_clocksource")
#: Clock sources that are read in user space, in some 25 ns; the others cost 1 us and more each.
_FAST_SOURCES: Final = ("tsc", "kvm-clock", "hyperv_clocksource_tsc_page", "arch_sys_counter")
_GOVERNORS: Final = "cpu[0-9]*/cpufreq/scaling_governor"
#: What a cycle of a rig at 1 kHz may take of a processor, for a machine without a rig.
_USUAL_SHARE: Final = 0.1
#: Cycle, recorder and daemon use a processor each if possible; two are enough.
_FEW_PROCESSORS: Final = 2
#: <sys/timex.h>: what adjtimex returns, and the bit of its status, while the clock is not set.
_TIME_ERROR: Final = 5
_RT_PERIOD: Final = Path("/proc/sys/kernel/sched_rt_period_us")
_RT_RUNTIME: Final = Path("/proc/sys/kernel/sched_rt_runtime_us")
#: Share of the time that real-time processes may have, as kernels come: 0.95.
_LEAST_RT_SHARE: Final = 0.9


def examine_machine() -> Iterator[Check]:
    """Yield a check of everything about the machine that needs no measuring."""
    yield _python()
    yield _processors()
    yield rigs_check(_GROUP, os.sched_getaffinity(0), residents())
    yield _governor()
    yield _monotonic()
    yield _wall_clock()
    yield _throttling()


def _python() -> Check:
    kernel = platform.uname()
    model = "PREEMPT_RT" if "PREEMPT_RT" in kernel.version else ""
    found = f"Python {platform.python_version()}, Linux {kernel.release} {model}".rstrip()
    if sys.platform != "linux":
        advice = "run rigd on Linux: elsewhere it has neither real time nor locked memory"
        return Check(_GROUP, "system", CheckVerdict.FAIL, f"{found} ({sys.platform})", advice)
    return Check(_GROUP, "system", CheckVerdict.OK, found)


def _processors() -> Check:
    count = len(os.sched_getaffinity(0))
    found = f"{count} usable" if count > 1 else "1 usable"
    figures = {"count": count}
    if count < _FEW_PROCESSORS:
        advice = "give this machine a second one: cycle, recorder and daemon share this one"
        return Check(_GROUP, "processors", CheckVerdict.WARN, found, advice, figures)
    return Check(_GROUP, "processors", CheckVerdict.OK, found, figures=figures)


def rigs_check(
    group: str, allowed: set[int], found: Sequence[Resident], share: float | None = None
) -> Check:
    """Return how many cycles of rigs run on each processor that is ``allowed``, and how many fit.

    ``share`` is what the cycle of this rig takes of a processor, 0 to 1; else that of
    :data:`_USUAL_SHARE` is taken.
    """
    taken = taken_by(found)
    running = [cycle.processor for cycle in found]
    told = ", ".join(
        f"{running.count(number)} on processor {number} ({taken[number]:.0%} of it)"
        for number in sorted(allowed & taken.keys())
    )
    count = fitting(share or _USUAL_SHARE, allowed, taken)
    each = f"{max(share or _USUAL_SHARE, LEAST_SHARE):.0%} of a processor"
    like = f"that take {each} each" if share is None else f"like this one, which takes {each}"
    text = f"cycles that run now: {told or 'none'}; room for {count} more {like}"
    figures = {"taken": {str(number): taken[number] for number in sorted(taken)}, "fit": count}
    full = [number for number in sorted(allowed & taken.keys()) if taken[number] > MOST_SHARE]
    shared = [number for number in sorted(taken) if running.count(number) > 1]
    free = sorted(allowed - taken.keys())
    advice = ""
    if full:
        advice = (
            f"processor {full[0]} is full: cycles wait for each other; lower `cycle`, or run a rig "
            "on another machine"
        )
    elif shared and free:
        advice = (
            f"processor {shared[0]} carries several cycles while {free[0]} is free: start those "
            "rigs again, and each takes the freest"
        )
    verdict = CheckVerdict.WARN if advice else CheckVerdict.OK
    return Check(group, "rigs", verdict, text, advice, figures)


def _governor() -> Check:
    governors = {
        path.read_text().strip() for path in Path("/sys/devices/system/cpu").glob(_GOVERNORS)
    }
    if not governors:
        return Check(
            _GROUP, "frequency", CheckVerdict.OK, "cannot be set here (a virtual machine has none)"
        )
    found = f"governor {', '.join(sorted(governors))}"
    if governors == {"performance"}:
        return Check(_GROUP, "frequency", CheckVerdict.OK, found)
    advice = "a processor that slows down wakes late: cpupower frequency-set -g performance"
    return Check(_GROUP, "frequency", CheckVerdict.WARN, found, advice)


def _monotonic() -> Check:
    resolution_s = time.get_clock_info("monotonic").resolution
    source = _CLOCK_SOURCE.read_text().strip() if _CLOCK_SOURCE.exists() else "unknown"
    found = f"{source}, resolution {resolution_s * 1e9:.0f} ns"
    figures = {"source": source, "resolution_s": resolution_s}
    if resolution_s > 1e-6:
        advice = "the kernel has no high-resolution timers: cycles cannot be on time"
        return Check(_GROUP, "clock", CheckVerdict.FAIL, found, advice, figures)
    if source not in _FAST_SOURCES:
        advice = (
            "reading this clock asks the hardware each time; boot with clocksource=tsc where the "
            "processor's is stable"
        )
        return Check(_GROUP, "clock", CheckVerdict.WARN, found, advice, figures)
    return Check(_GROUP, "clock", CheckVerdict.OK, found, figures=figures)


class _Timex(ctypes.Structure):
    """The head of ``struct timex`` (adjtimex(2)), and room for the rest."""

    _fields_ = (
        ("modes", ctypes.c_uint),
        ("offset", ctypes.c_long),
        ("freq", ctypes.c_long),
        ("maxerror", ctypes.c_long),  # us
        ("esterror", ctypes.c_long),
        ("status", ctypes.c_int),
        ("rest", ctypes.c_char * 256),
    )


def _wall_clock() -> Check:
    timex = _Timex()  # modes 0: nothing is set
    state = ctypes.CDLL(None, use_errno=True).adjtimex(ctypes.byref(timex))
    advice = "times of recordings may be wrong: timedatectl set-ntp true (or start chrony)"
    if state == -1:
        why = os.strerror(ctypes.get_errno())
        return Check(_GROUP, "wall clock", CheckVerdict.WARN, f"cannot be asked: {why}", advice)
    if state == _TIME_ERROR:
        return Check(_GROUP, "wall clock", CheckVerdict.WARN, "not synchronised", advice)
    error_s = timex.maxerror * 1e-6
    found = f"synchronised, within {error_s * 1e3:.3g} ms"
    return Check(_GROUP, "wall clock", CheckVerdict.OK, found, figures={"max_error_s": error_s})


def _throttling() -> Check:
    try:
        period_us, runtime_us = int(_RT_PERIOD.read_text()), int(_RT_RUNTIME.read_text())
    except OSError as error:
        found = f"cannot be read: {error.strerror}"
        return Check(_GROUP, "RT throttling", CheckVerdict.OK, found)
    if runtime_us < 0:
        return Check(_GROUP, "RT throttling", CheckVerdict.OK, "off")
    share = runtime_us / period_us
    found = f"real-time processes may have {share:.0%} of the time"
    figures = {"share": share}
    if share < _LEAST_RT_SHARE:
        advice = "sysctl kernel.sched_rt_runtime_us=950000: what is beyond its share stands still"
        return Check(_GROUP, "RT throttling", CheckVerdict.WARN, found, advice, figures)
    return Check(_GROUP, "RT throttling", CheckVerdict.OK, found, figures=figures)
