"""How soon a run starts, and how soon a stop takes the setpoint to zero, while others ask.

`rigd serve` on the simulated LuGre rig in real time. Runs are started and stopped one after the
other by one client, in turn with no other client there, with ten that watch every stream, and with
one that puts 1,000 questions a second. Measured from the request, in the rows of the recording: the
first cycle that commands a current, and the first that commands none. All clients have the clock of
this machine.

The witness is a bare queryable of zenoh in a process of its own, asked just before each stop: what
it takes longer is the machine's.

    python benchmarks/flood.py --rounds 50
"""

from __future__ import annotations

import argparse
import os
import statistics
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final, NamedTuple

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

import numpy as np
import zenoh
from crowd import FLOOD_S, WATCHERS, elsewhere, message
from figures import at_most, noted
from stop_lane import opened, witnessed
from support.daemon.process import Daemon
from support.faults.soaking import NAME, soaked

from rigd.record import Recording

#: Questions per second of the client that floods.
FLOOD_PER_S: Final = 1000.0
MOST_START: Final = 1.5
MOST_STOP: Final = 3.0
QUIET, WATCHED, FLOODED = CASES = (
    "quiet",
    f"{WATCHERS} watchers",
    f"{FLOOD_PER_S:g} questions/s",
)
HOLD = """\
procedure: hold_current
title: Holds a current
doc: For the bench.
trial:
  steps:
    - step: hold
      set: {wheel_servo.current: 0.1 A}
      for: 1 h
"""


class Timed(NamedTuple):
    """What one run took, in ms."""

    start: float
    stop: float
    witness: float


@contextmanager
def beside(case: str, endpoint: str) -> Iterator[None]:
    """Let the others of a case be there."""
    if case == QUIET:
        yield
    elif case == WATCHED:
        watchers = [elsewhere(endpoint) for _ in range(WATCHERS)]
        for watcher in watchers:
            watcher.subscribe(f"rigd/{NAME}/**")
        yield
        for watcher in watchers:
            watcher.kill()
    else:
        with elsewhere(endpoint) as flood:
            key = f"rigd/{NAME}/ask/mallory/lease"
            flood.flood(key, message(), FLOOD_S, FLOOD_PER_S)
            yield


def timed(daemon: Daemon, theirs: zenoh.Session) -> Timed:
    """Start a run, stop it, and return how long both took until they were in its rows."""
    begun_ns = time.time_ns()
    path = daemon.start(HOLD, on_client_loss="continue")
    daemon.until(lambda status: status["step"] == "hold")
    time.sleep(0.3)
    asked = time.perf_counter()
    list(theirs.get("bench/witness", payload=b"", timeout=5.0))
    took_ms = 1e3 * (time.perf_counter() - asked)
    stopped_ns = time.time_ns()
    daemon.request("stop", "stop")
    daemon.until(lambda status: status["state"] == "idle", steered=False)
    rows = Recording.open(path).read("wheel_servo")
    moved = np.flatnonzero(rows["current_setpoint"])
    first_ns, zero_ns = rows["t_ns"][moved[0]], rows["t_ns"][moved[-1] + 1]
    start_ms, stop_ms = (first_ns - begun_ns) / 1e6, (zero_ns - stopped_ns) / 1e6
    return Timed(float(start_ms), float(stop_ms), took_ms)


def report(case: str, found: list[Timed], quiet: list[Timed]) -> None:
    """Print medians and the 99th percentiles, and their ratios to those without others."""
    for name, most in (("start", MOST_START), ("stop", MOST_STOP), ("witness", None)):
        values = [getattr(item, name) for item in found]
        p50 = statistics.median(values)
        noted(f"{name} to the rows, {case}, p50 of {len(values)}", p50, "ms")
        noted(f"{name} to the rows, {case}, p99", float(np.percentile(values, 99)), "ms")
        ratio = p50 / statistics.median(getattr(item, name) for item in quiet)
        if case == QUIET:
            continue
        if most is None:
            noted(f"{name}, {case} against quiet", ratio, "x")
        else:
            at_most(f"{name}, {case} against quiet", ratio, most)


def main() -> None:
    """Measure, and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=50)
    args = parser.parse_args()
    found: dict[str, list[Timed]] = {case: [] for case in CASES}
    with (
        witnessed() as witness_at,
        tempfile.TemporaryDirectory() as folder,
        soaked(Path(folder)) as daemon,
    ):
        theirs = opened(witness_at)
        timed(daemon, theirs)  # its modules may be compiled
        for number in range(args.rounds):
            for case in CASES if number % 2 == 0 else CASES[::-1]:
                with beside(case, daemon.endpoint):
                    found[case].append(timed(daemon, theirs))
            last = ", ".join(f"{1e-3 * rows[-1].start:.1f} s" for rows in found.values())
            print(f"round {number + 1}, load {os.getloadavg()[0]:.1f}: {last}", flush=True)
        theirs.close()
    for case, rows in found.items():
        report(case, rows, found[QUIET])


if __name__ == "__main__":
    main()
