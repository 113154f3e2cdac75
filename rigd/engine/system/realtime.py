"""Sets real-time scheduling for this process, and reports each setting that the kernel refuses.

Measured on a virtual machine of two processors at 1 kHz under load:

- SCHED_FIFO alone reduces the misses that the process causes itself from 28 to 0 per 1000 cycles.
- Locked memory and a frozen garbage collector protect against rare long stalls.
- ``/dev/cpu_dma_latency``, held at 0, keeps the processor from deep sleep.

If other processes run at SCHED_FIFO too, the kernel moves a process that is in their way to another
processor. A cycle that finds its caches cold takes twice as long. So the process keeps to one
processor, the freest (:mod:`rigd.engine.system.processors`): at 4 kHz beside four such loops, p99
fell from 680 to 220 us, and missed slots fell from 5400 to 75 of 40 000.
"""

from __future__ import annotations

import ctypes
import gc
import os
import resource
import struct
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from rigd.engine.system.processors import MOST_SHARE, choose_processor

#: SCHED_FIFO priority of the cycle: above interrupt threads' 50, below the kernel's watchdogs 99.
PRIORITY: Final = 80
#: Priority of a helper process whose library streams blocks: its buffer gives it some time.
HELPER_PRIORITY: Final = 60
#: Priority of devices simulated at the wire: they represent hardware, which does not wait for
#: programs.
SIMULATED_PRIORITY: Final = 70
#: Priority of the daemon of a rig (SCHED_RR): before all ordinary programs, so that a stop does not
#: wait for them. All its threads have it: they share the interpreter's lock, and the thread of a
#: stop waits for the thread that holds it.
DAEMON_PRIORITY: Final = 1
#: nice(2) of what keeps a run alive beside the daemon, and of the processes of a run that are not
#: in real time (yet): nine times the weight of ordinary programs.
PREFERRED: Final = -10
# Linux takes the weight of one session in 100 ms from all users that are not root together.
WEIGHINGS: Final = 20
WEIGHING_S: Final = 0.05
_MCL_CURRENT: Final = 1  # <sys/mman.h>
_MCL_FUTURE: Final = 2
_PR_SET_TIMERSLACK: Final = 29  # <linux/prctl.h>
_DMA_LATENCY: Final = Path("/dev/cpu_dma_latency")


class RealTime:
    """The real-time settings of a process; ``lost`` has a sentence for each refused setting."""

    def __init__(self) -> None:
        self.lost: list[str] = []
        self.granted: list[str] = []
        self._latency_fd: int | None = None
        self._allowed: set[int] = set()  #: processors that the process may use again afterwards

    def enter(self, priority: int = PRIORITY) -> None:
        """Request all settings; call when all memory is allocated and all code has run once."""
        gc.collect()
        gc.freeze()
        gc.disable()
        self._slack()
        self._hold_latency()
        self._lock_memory()
        self.schedule(priority)
        self._pin_to_processor()

    def leave(self) -> None:
        """Release the settings that affect other processes: deep sleep, choice of processor."""
        if self._allowed:
            os.sched_setaffinity(0, self._allowed)
            self._allowed = set()
        if self._latency_fd is not None:
            os.close(self._latency_fd)
            self._latency_fd = None

    def _slack(self) -> None:
        libc = ctypes.CDLL(None, use_errno=True)
        libc.prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0)  # 1 ns instead of 50 us; cannot be refused

    def _hold_latency(self) -> None:
        """Prevent deep sleep of the processors while the file is open."""
        if not _DMA_LATENCY.exists():
            return  # the kernel has no such states to prevent
        try:
            self._latency_fd = os.open(_DMA_LATENCY, os.O_WRONLY | os.O_CLOEXEC)
            os.write(self._latency_fd, struct.pack("=i", 0))
            self.granted.append("processors held awake")
        except OSError as error:
            self.lost.append(
                f"processors may sleep deeply between cycles ({_DMA_LATENCY}: {error.strerror}): "
                "a cycle can begin 0.5 ms late"
            )

    def _pin_to_processor(self) -> None:
        """Stay on the processor of which other cycles take least."""
        self._allowed = os.sched_getaffinity(0)
        processor, taken = choose_processor()
        beside = f", of which other cycles take {taken:.0%}" if taken else ""
        self.granted.append(f"processor {processor}{beside}")
        if taken > MOST_SHARE:
            self.lost.append(
                f"processor {processor} is full, cycles of other rigs take {taken:.0%} of it: run "
                "this rig on another machine, or lower `cycle` of one"
            )

    def _lock_memory(self) -> None:
        soft, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
        libc = ctypes.CDLL(None, use_errno=True)
        limited = os.geteuid() != 0 and soft != resource.RLIM_INFINITY
        # With a limit, a later allocation would fail if memory is locked: do not request it.
        if not limited and libc.mlockall(_MCL_CURRENT | _MCL_FUTURE) == 0:
            self.granted.append("memory locked")
            return
        why = f"limit {soft // 1024} kB" if limited else os.strerror(ctypes.get_errno())
        self.lost.append(
            f"memory is not locked ({why}): a page fault can stall a cycle for 10 ms; set "
            "`ulimit -l unlimited` (LimitMEMLOCK=infinity)"
        )

    def schedule(self, priority: int = PRIORITY) -> None:
        """Request SCHED_FIFO at ``priority`` for this thread, or the nearest permitted setting."""
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
            self.granted.append(f"SCHED_FIFO {priority}")
            return
        except OSError as error:
            refused = error.strerror
        try:
            os.setpriority(os.PRIO_PROCESS, 0, -20)
            instead = "nice -20 instead"
        except OSError:
            instead = "normal priority instead"
        self.lost.append(
            f"SCHED_FIFO {priority} was refused ({refused}), {instead}: under load 3 to 30 "
            "cycles of 1000 are late; set `ulimit -r 95` (LimitRTPRIO=95)"
        )


@contextmanager
def before_programs() -> Iterator[None]:
    """Run this thread, and threads that it starts inside, before all ordinary programs.

    Nothing changes if the kernel refuses it.
    """
    with _scheduled(os.SCHED_RR, DAEMON_PRIORITY):
        yield


def prefer() -> None:
    """Give this thread, and what it starts, more time than ordinary programs, if that is permitted.

    For what keeps a run alive, such as the panel. It serves strangers too, so that it does not go
    before what moves the rig.
    """
    set_nice(PREFERRED)


def set_nice(value: int) -> None:
    """Give this thread, and what it starts, the weight of nice ``value``, if that is permitted.

    If this process began its session, the session gets it too; see :func:`weigh_session`.
    """
    if _set_own_nice(value) and os.getsid(0) == os.getpid():
        weigh_session(os.getpid(), value)


def weigh_session(pid: int, value: int) -> None:
    """Give the session that process ``pid`` began the weight of nice ``value``, if permitted.

    Linux may share a processor among sessions first, each with the same share, and then by nice(2)
    within each (autogroup, sched(7)). Beside a program of another session a process of nice -10
    then gets half of a processor, and with its session nine tenths.
    """
    for _ in range(WEIGHINGS):
        try:
            Path(f"/proc/{pid}/autogroup").write_text(str(value))
        except BlockingIOError:
            time.sleep(WEIGHING_S)
        except OSError:
            return
        else:
            return


def _set_own_nice(value: int) -> bool:
    """Give this thread the weight of nice ``value``; return whether that is permitted."""
    with suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, 0, value)
        return True
    return False


@contextmanager
def preferring() -> Iterator[None]:
    """Let this thread, and what it starts inside, be preferred; its session stays as it is."""
    before = os.getpriority(os.PRIO_PROCESS, 0)
    _set_own_nice(PREFERRED)
    try:
        yield
    finally:
        os.setpriority(os.PRIO_PROCESS, 0, before)


@contextmanager
def as_program() -> Iterator[None]:
    """Run this thread, and everything that it starts inside, with ordinary priority."""
    with _scheduled(os.SCHED_OTHER, 0):
        yield


@contextmanager
def _scheduled(policy: int, priority: int) -> Iterator[None]:
    """Schedule this thread by ``policy`` of sched(7), as far as the kernel permits it."""
    before, parameter = os.sched_getscheduler(0), os.sched_getparam(0)
    with suppress(PermissionError):
        os.sched_setscheduler(0, policy, os.sched_param(priority))
    try:
        yield
    finally:
        with suppress(PermissionError):
            os.sched_setscheduler(0, before, parameter)
