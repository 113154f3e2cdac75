"""Kills a recording run at random times with SIGKILL, and measures what is lost.

Every file must open in a plain reader (Python's `mcap`, CRCs checked), if need be after
`rigd recover`. Lost is the time from the kill back to the last sample in the file.

    python benchmarks/kill.py --kills 50
"""

from __future__ import annotations

import argparse
import random
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from figures import at_most, noted
from mcap.exceptions import McapError
from mcap.reader import make_reader

ROOT = Path(__file__).parent.parent
#: `--pace 1` begins to move within this time on a crowded machine.
START_TIMEOUT_S = 60.0


def last_sample_ns(path: Path) -> int:
    """Return the log time of the last sample of `/carriage`, read by the `mcap` library alone.

    Raises:
        McapError: the file is not a valid recording as it stands.
    """
    last = 0
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        for _, _, message in reader.iter_messages(topics=["/carriage"], log_time_order=False):
            last = max(last, message.log_time)
    return last


def kill_one(folder: Path, number: int, delay_s: float) -> tuple[float, bool]:
    """Return the ms lost by one kill, and whether the file had to be recovered."""
    path = folder / f"{number}.mcap"
    command = [sys.executable, "-m", "rigd", "run", "constant_current", "--rig", "lugre-1"]
    process = subprocess.Popen(
        [*command, "--pace", "1", "--quiet", "--output", str(path)],
        cwd=ROOT,
        stdout=subprocess.DEVNULL,
    )
    try:
        give_up = time.monotonic() + START_TIMEOUT_S
        # More than attachments and schemas (40 kB): the first samples are in.
        while not path.exists() or path.stat().st_size < 100_000:
            if process.poll() is not None or time.monotonic() > give_up:
                raise RuntimeError(f"the run did not start (exit code {process.returncode})")
            time.sleep(0.01)
        time.sleep(delay_s)
    finally:
        killed_ns = time.time_ns()
        process.kill()
        process.wait()
    recovered = False
    try:
        last_ns = last_sample_ns(path)
    except McapError:
        recovered = True
        subprocess.run([sys.executable, "-m", "rigd", "recover", str(path)], check=True, cwd=ROOT)
        last_ns = last_sample_ns(path)
    return (killed_ns - last_ns) * 1e-6, recovered


def main() -> int:
    """Kill many runs and print the distribution of the loss."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--seed", type=int, default=None)
    args = parser.parse_args()
    draw = random.Random(args.seed)
    losses, recoveries = [], 0
    with tempfile.TemporaryDirectory() as folder:
        for number in range(args.kills):
            lost, recovered = kill_one(Path(folder), number, draw.uniform(0.0, 3.0))
            losses.append(lost)
            recoveries += recovered
            note = ", recovered" if recovered else ""
            print(f"kill {number + 1:>3}: {lost:6.1f} ms lost{note}", flush=True)
    noted("kill -9, files that needed recovery", recoveries, f"of {args.kills}")
    at_most("kill -9, p50 lost", statistics.median(losses), 100, "ms")
    at_most("kill -9, most lost", max(losses), 200, "ms")
    # Above the figure by more than noise: something was really lost.
    return 1 if max(losses) > 1000 else 0


if __name__ == "__main__":
    sys.exit(main())
