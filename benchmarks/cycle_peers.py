"""What runs beside a loop that is measured: bare C loops and cyclictest, in the same minute.

* the C loop: ``witness.c`` at the cycle's own rate and priority, what a program without work does;
* a witness on every processor, above everything: when one of these is late, the kernel or the host
  was away, whichever process was due at that moment;
* `cyclictest` (Debian: rt-tests), for the figure that others know.

Deimos, a controller in Rust for its own cards, has its turn in the same minute, with these beside.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

#: Of the loops that stand for the cycle: rigd's own priority.
CYCLE_PRIORITY = 80
#: Of the witnesses: above all but the kernel's own.
WITNESS_PRIORITY = 98
#: Witnesses look as often as the cycle, but not more often than this: it is the cycle's machine.
WITNESS_PERIOD_US = 500
#: A witness that is so many periods of the cycle late was kept away for long enough to excuse a
#: missed slot; it shows nothing below 250 us.
AWAY_PERIODS = 0.5
#: cyclictest counts latencies up to this, in us.
LONGEST_US = 100_000
#: The release that is measured.
DEIMOS = "deimos-daq==0.21.2"
#: All of them have ended this long after they should.
END_S = 30.0


@dataclass(frozen=True)
class Lateness:
    """How a loop kept its slots: how late a cycle began, in us, and how many there were not."""

    slots: int
    missed: int
    p50_us: float
    p99_us: float
    p999_us: float
    max_us: float
    cpu_us: float = float("nan")  #: of one cycle

    @classmethod
    def of(cls, late_us: NDArray[np.float64], slots: int, cpu_us: float = float("nan")) -> Self:
        """Return that of a loop whose cycles began so late, shape (n,), in ``slots`` slots."""
        p50, p99, p999 = (float(item) for item in np.percentile(late_us, (50, 99, 99.9)))
        return cls(slots, slots - len(late_us), p50, p99, p999, float(late_us.max()), cpu_us)

    def line(self, name: str) -> str:
        """Return a line of the table."""
        return (
            f"{name:<30}{self.slots:>8}{self.missed:>8}{self.p50_us:>8.0f}{self.p99_us:>8.0f}"
            f"{self.p999_us:>8.0f}{self.max_us:>8.0f}{self.cpu_us:>9.1f}"
        )


HEADING = (
    f"{'':<30}{'slots':>8}{'missed':>8}{'p50':>8}{'p99':>8}{'p99.9':>8}{'max':>8}{'CPU us':>9}"
)


@dataclass(frozen=True)
class Beside:
    """What ran beside: loops, and when the machine was away, CLOCK_MONOTONIC ns, (n, 2)."""

    loop: Lateness
    cyclictest: Lateness
    witnesses: Mapping[int, Lateness]  #: by processor
    away_ns: NDArray[np.int64]

    def was_away(
        self, since_ns: NDArray[np.int64], until_ns: NDArray[np.int64]
    ) -> NDArray[np.bool_]:
        """Return in which of these spans, shape (n,), a witness was kept away."""
        if not len(self.away_ns):
            return np.zeros(len(since_ns), np.bool_)
        ends = np.maximum.accumulate(self.away_ns[:, 1])
        first = np.searchsorted(ends, since_ns, side="right")  # that ended after ``since``
        begins = np.append(self.away_ns[:, 0], np.iinfo(np.int64).max)[first]
        return np.asarray(begins < until_ns)


def compile_witness(folder: Path) -> Path:
    """Return the program made of ``witness.c``."""
    program = folder / "witness"
    source = Path(__file__).with_name("witness.c")
    subprocess.run(["cc", "-O2", "-Wall", "-o", program, source], check=True)
    return program


class RunningBeside:
    """All of them, under way for ``seconds``; :meth:`results` waits for their end."""

    def __init__(self, witness: Path, period_us: int, seconds: float) -> None:
        self._folder = Path(tempfile.mkdtemp(dir=witness.parent))
        self._cyclictest_json = self._folder / "cyclictest.json"
        self._loop = _loop(witness, period_us, seconds, CYCLE_PRIORITY, self._folder / "loop")
        self._logs = [self._folder / f"cpu{cpu}" for cpu in sorted(os.sched_getaffinity(0))]
        slow_us = max(period_us, WITNESS_PERIOD_US)
        self._witnesses = [
            _loop(witness, slow_us, seconds, WITNESS_PRIORITY, log, cpu=log.name[3:])
            for log in self._logs
        ]
        self._cyclictest = subprocess.Popen(
            [
                *("cyclictest", "--mlockall", "--quiet", "--threads=1"),
                *(f"--priority={CYCLE_PRIORITY}", f"--interval={period_us}"),
                *(f"--duration={math.ceil(seconds)}", f"--histogram={LONGEST_US}"),
                f"--json={self._cyclictest_json}",
            ],
            stdout=subprocess.PIPE,
            text=True,
        )
        self._period_us = period_us
        self._until = time.monotonic() + seconds + END_S
        self._slots = math.ceil(seconds) * 1_000_000 // period_us

    def results(self) -> Beside:
        """Return what they saw, once all have ended."""
        loop = self._of_loop(self._loop)
        witnesses = {
            int(log.name[3:]): self._of_loop(process)
            for log, process in zip(self._logs, self._witnesses, strict=True)
        }
        self._output(self._cyclictest)
        away = [
            (int(due), int(due) + int(late))
            for log in self._logs
            for _, due, late in (line.split() for line in log.read_text().splitlines())
            if int(late) >= self._period_us * AWAY_PERIODS * 1e3
        ]
        away_ns = np.array(sorted(away), np.int64).reshape(-1, 2)
        return Beside(loop, self._of_cyclictest(), witnesses, away_ns)

    def end(self) -> None:
        """End those that are left."""
        for process in (self._loop, *self._witnesses, self._cyclictest):
            if process.poll() is None:
                process.kill()
            process.wait()
            if process.stdout is not None:
                process.stdout.close()

    def _output(self, process: subprocess.Popen[str]) -> str:
        output, _ = process.communicate(timeout=max(self._until - time.monotonic(), 1.0))
        if process.returncode:
            raise RuntimeError(f"{process.args!r} ended with {process.returncode}")
        return output

    def _of_loop(self, process: subprocess.Popen[str]) -> Lateness:
        found = json.loads(self._output(process))
        return Lateness(
            found["slots"],
            found["missed"],
            found["p50_us"],
            found["p99_us"],
            found["p999_us"],
            found["max_us"],
            found["cpu_us_per_cycle"],
        )

    def _of_cyclictest(self) -> Lateness:
        thread = json.loads(self._cyclictest_json.read_text())["thread"]["0"]
        counts = {int(late): int(count) for late, count in thread["histogram"].items()}
        late_us = np.repeat(list(counts), list(counts.values())).astype(np.float64)
        beyond = thread["cycles"] - len(late_us)
        return Lateness.of(np.append(late_us, [thread["max"]] * beyond), self._slots)


def _loop(
    witness: Path, period_us: int, seconds: float, priority: int, log: Path, cpu: str | None = None
) -> subprocess.Popen[str]:
    pinned = () if cpu is None else ("taskset", "--cpu-list", cpu)
    command = [*pinned, str(witness), str(period_us), str(seconds), str(priority), str(log)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


@dataclass(frozen=True)
class Deimos:
    """What became of a run of Deimos; ``cpu_s`` by the name of its threads."""

    lateness: Lateness
    late: int  #: cycles that began a period late or more; none is skipped, and none is marked
    unanswered: int  #: rows that repeat an earlier answer of the card
    cpu_s: dict[str, float]
    beside: Beside


def install_deimos(folder: Path) -> Path:
    """Return a Python of its own that has Deimos.

    Raises:
        CalledProcessError: it cannot be had.
    """
    venv = folder / "deimos"
    subprocess.run([sys.executable, "-m", "venv", venv], check=True)
    subprocess.run([str(venv / "bin" / "pip"), "install", "--quiet", DEIMOS], check=True)
    return venv / "bin" / "python"


def run_deimos(
    python: Path, witness: Path, rate_hz: float, seconds: float, method: str, priority: int
) -> Deimos:
    """Run its loop (``method`` performant or efficient), with the others beside.

    ``priority`` is that of its control thread (SCHED_FIFO); 0 leaves it as it comes.
    """
    script = Path(__file__).with_name("deimos_loop.py")
    with tempfile.TemporaryDirectory(dir=witness.parent) as folder:
        command = [str(python), str(script), folder, str(rate_hz), str(seconds), method]
        command.append(str(priority))
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            while "running" not in (line := process.stdout.readline()):
                if not line:
                    raise RuntimeError(f"Deimos ended with {process.wait()}")
            beside = RunningBeside(witness, round(1e6 / rate_hz), seconds)
            try:
                results = beside.results()
                found = json.loads(process.stdout.read().splitlines()[-1])
            finally:
                beside.end()
    late_us = np.array(found["late_us"])
    used: dict[str, float] = found["cpu_s"]
    cpu_us = 1e6 * used["controller-run"] / len(late_us)
    lateness = Lateness.of(late_us, round(seconds * rate_hz), cpu_us)
    late = int(np.count_nonzero(late_us >= 1e6 / rate_hz))
    return Deimos(lateness, late, found["unanswered"], used, results)
