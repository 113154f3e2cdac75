"""Measures the timing of the control cycle on this machine, without devices, in its own process.

``python -m rigd.daemon.doctor.bare_cycle PERIOD_NS SECONDS`` prints one JSON object
(:class:`BareCycle`). The process requests the same real-time settings from the kernel as the cycle
process of a run.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from dataclasses import asdict, dataclass
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from rigd.engine.clock import RealClock
from rigd.engine.system.child import module
from rigd.engine.system.realtime import RealTime

#: How long starting the interpreter may take on a busy machine, in s.
START_S: Final = 30.0
#: The first cycles are not counted: the caches are not filled yet.
_WARM_UP: Final = 50


@dataclass(frozen=True)
class Lateness:
    """How late cycles began, in s; ``longest_gap_s`` is the longest time between two beginnings."""

    cycles: int
    missed: int
    p50_s: float
    p99_s: float
    p999_s: float
    max_s: float
    longest_gap_s: float

    @classmethod
    def of(cls, due_s: NDArray[np.float64], began_s: NDArray[np.float64], period_s: float) -> Self:
        """Return the figures of cycles that were due and began at these times, shape (n,), n > 1.

        Slots that are left out in ``due_s`` count as missed.
        """
        late = began_s - due_s
        p50, p99, p999 = np.quantile(late, [0.5, 0.99, 0.999])
        slots = round((due_s[-1] - due_s[0]) / period_s) + 1
        gap = float(np.diff(began_s).max())
        return cls(
            len(late),
            slots - len(late),
            float(p50),
            float(p99),
            float(p999),
            float(late.max()),
            gap,
        )


@dataclass(frozen=True)
class BareCycle:
    """The measurements of the process, and the granted settings (:class:`RealTime`)."""

    lateness: Lateness
    granted: tuple[str, ...]
    lost: tuple[str, ...]


def measure(period_ns: int, seconds: float) -> BareCycle:
    """Run a bare cycle for so long in a process of its own.

    Raises:
        subprocess.SubprocessError: the process failed; that is a bug.
    """
    done = subprocess.run(
        module(__name__, str(period_ns), str(seconds)),
        stdin=subprocess.DEVNULL,
        capture_output=True,
        start_new_session=True,  # as the cycle of a run
        timeout=seconds + START_S,
        check=True,
    )
    found = json.loads(done.stdout)
    return BareCycle(Lateness(**found["lateness"]), tuple(found["granted"]), tuple(found["lost"]))


def run(period_ns: int, seconds: float) -> BareCycle:
    """Run the cycle in this process, which is in real time from then on."""
    count = max(round(seconds * 1e9 / period_ns), 2 * _WARM_UP)
    due, began = np.zeros(count), np.zeros(count)  # written once: their memory is there
    due += 1.0
    began += 1.0
    real_time = RealTime()
    real_time.enter()
    clock = RealClock(period_ns, time.time_ns(), time.monotonic_ns())
    end_ns = clock.now() + round(seconds * 1e9)
    used = 0
    while used < count and clock.now() < end_ns:
        slot = clock.next_slot()
        began[used] = clock.now() * 1e-9
        due[used] = slot * period_ns * 1e-9
        used += 1
    real_time.leave()
    lateness = Lateness.of(due[_WARM_UP:used], began[_WARM_UP:used], period_ns * 1e-9)
    return BareCycle(lateness, tuple(real_time.granted), tuple(real_time.lost))


if __name__ == "__main__":
    print(json.dumps(asdict(run(int(sys.argv[1]), float(sys.argv[2])))))  # noqa: T201 - its answer
