"""Measures how long a search of many recordings takes, and how fast their index is made.

Writes recordings of ten trials each, and searches them in processes of their own, as a person does;
beside it the command that only prints its help, and what reading a real recording costs
(`--real FILE`).

    python benchmarks/catalogue.py --count 10000
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
from figures import at_least, at_most, noted

from rigd.catalogue import parse_where, search
from rigd.model import Channel, Stream
from rigd.model.rows import row_dtype
from rigd.record import RecordingWriter
from rigd.record.read.brief import brief_info

FIRST = datetime(2026, 1, 1, 8, tzinfo=UTC)
STREAM = Stream("carriage", (Channel("position", "m"), Channel("speed", "m/s")))
COATINGS = ("PTFE", "DLC", "none", "MoS2")
WHERE = 'specimen.coating == "PTFE" and started > 2026-09-01 and specimen == "W36"'


def write(folder: Path, number: int) -> None:
    """Write the recording of a run; one an hour."""
    at = FIRST + timedelta(hours=number)
    start_ns = int(at.timestamp()) * 1_000_000_000
    rows = np.zeros(2, row_dtype(STREAM))
    rows["t_ns"] = start_ns + np.array([0, 60_000_000_000])
    metadata = {
        "run": {
            "procedure": "wear", "title": "Wear on one specimen", "rig": f"bench-{number % 3}",
            "mode": "hardware", "seed": "1", "started": at.isoformat(), "trials": "10",
            "operator": "A. Miller", "note": "as before", "rigd_version": "0.1.0",
        },
        "parameters": {"floor": "pvc", "load": "5 N"},
        "specimen": {
            "name": f"W{number % 100}", "coating": COATINGS[number % 4], "hardness": "5 GPa",
        },
        "meta": {"batch": str(number // 100), "humidity": "41 %"},
    }  # fmt: skip
    path = folder / f"{at:%Y%m%d-%H%M%S}-wear.mcap"
    with RecordingWriter.create(
        path, streams=(STREAM,), metadata=metadata, attachments=(), start_ns=start_ns,
        sync_interval_s=None,
    ) as writer:  # fmt: skip
        writer.event(start_ns, "run_start")
        for trial in range(1, 11):
            now = start_ns + trial * 5_000_000_000
            given = {"parameters": {"current": 0.1 * trial}, "units": {"current": "A"}}
            writer.event(now, "trial_start", trial, {"repeat": 1, **given})
            writer.event(now + 1_000_000, "step", trial, {"name": "go"})
            writer.event(now + 4_000_000_000, "trial_end", trial, {"complete": True})
        writer.write("carriage", rows)
        writer.event(start_ns + 60_000_000_000, "run_end", None, {"state": "complete"})


def command(folder: Path, *said: str) -> tuple[float, float]:
    """Return how long ``rigd runs`` takes: on the wall and of the processor, in s."""
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(
        [sys.executable, "-m", "rigd", "runs", str(folder), *said],
        stdout=subprocess.DEVNULL, check=True,
    )  # fmt: skip
    wall, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--tries", type=int, default=9)
    parser.add_argument("--real", type=Path, help="a recording, to measure what reading it costs")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name, "runs")
        folder.mkdir()
        os.environ["XDG_CACHE_HOME"] = str(Path(name, "cache"))
        for number in range(args.count):
            write(folder, number)

        began, work = time.perf_counter(), time.process_time()
        assert len(search(folder).lines) == args.count
        wall, work = time.perf_counter() - began, time.process_time() - work
        noted("index made, wall", wall, "s")
        at_least("index made, of CPU", args.count / work, 1000, "files/s")

        times: dict[str, list[tuple[float, float]]] = {"--where": [], "--help": []}
        for _ in range(args.tries):
            times["--where"].append(command(folder, "--where", WHERE))
            times["--help"].append(command(folder, "--help"))
        wall, work = best(times["--where"])
        base, base_work = best(times["--help"])
        noted("search, start of the command included, wall", wall, "s")
        at_most("search, start of the command included, CPU", work, 0.3, "s")
        noted("the command with --help, wall", base, "s")
        noted("the command with --help, CPU", base_work, "s")
        search(folder, parse_where(WHERE))
        work = time.process_time()
        found = search(folder, parse_where(WHERE)).lines
        noted("search in a process that runs already, CPU", time.process_time() - work, "s")
        noted("recordings found", len(found), "")
    if args.real is not None:
        work = time.process_time()
        for _ in range(200):
            brief_info(args.real)
        each = (time.process_time() - work) / 200
        noted(f"reading {args.real.stat().st_size / 1e6:.1f} MB for the index", 1 / each, "files/s")


def best(times: list[tuple[float, float]]) -> tuple[float, float]:
    """Return the least of each: what a busy machine spoils least."""
    wall, work = zip(*times, strict=True)
    return min(wall), min(work)


if __name__ == "__main__":
    main()
