"""What a daemon takes after connections, floods and downloads: its slopes per hour.

A slice lasts some minutes and has a daemon of its own; its lines are added to a file, and what is
printed is of all slices in it, so that an hour is had by and by. Memory is what the kernel reports
as resident; the first quarter of a slice is left out of the slopes (what is made once).

    nice -n 19 python benchmarks/soak.py --minutes 5 --keep /tmp/soak.jsonl
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

import numpy as np
from figures import at_most
from support.faults.soaking import as_line, settled, soak, soaked

#: The largest slope per hour of any slice. An hour has 700 rounds: one descriptor or thread left in
#: each, or one piece of a download (256 kB), is far beyond. Two minutes of a daemon that had just
#: started gave 12 MB per hour, and no slope of the others.
TARGETS = {"descriptors": 10.0, "threads": 10.0, "resident_kb": 20_000.0}


def slice_of(minutes: float, kept: Path) -> None:
    """Soak a daemon for a while, and add a line for each round."""
    with tempfile.TemporaryDirectory() as folder, soaked(Path(folder)) as daemon:
        begun_s = time.monotonic()
        with kept.open("a") as out:
            out.write(json.dumps({"slice": time.time()}) + "\n")
            round_ = 0
            while time.monotonic() - begun_s < 60 * minutes:
                soak(daemon, unauthenticated=60, clients=2, flood_s=1.0)
                line = as_line(settled(daemon), round_, time.monotonic() - begun_s)
                out.write(line + "\n")
                out.flush()
                round_ += 1


def slices(kept: Path) -> list[list[dict[str, float]]]:
    """Return the rounds of each slice in a file."""
    found: list[list[dict[str, float]]] = []
    for line in map(json.loads, kept.read_text().splitlines()):
        if "slice" in line:
            found.append([])
        else:
            found[-1].append(line)
    return [item for item in found if len(item) >= 8]


def main() -> None:
    """Soak for one slice, then print what all slices show."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--minutes", type=float, default=5.0)
    parser.add_argument("--keep", type=Path, default=Path(tempfile.gettempdir()) / "soak.jsonl")
    args = parser.parse_args()
    slice_of(args.minutes, args.keep)
    found = slices(args.keep)
    if not found:
        sys.exit("no slice had 8 rounds: give more --minutes")
    worst = dict.fromkeys(TARGETS, -np.inf)
    for number, rounds in enumerate(found, 1):
        later = rounds[len(rounds) // 4 :]
        hours = np.array([item["s"] for item in later]) / 3600
        print(f"slice {number}: {rounds[-1]['s'] / 60:.1f} min, {len(rounds)} rounds")
        for column in TARGETS:
            values = np.array([item[column] for item in later])
            slope = np.polyfit(hours, values, 1)[0]
            print(f"  {column:12} {values[0]:9.0f} -> {values[-1]:9.0f}   {slope:+10.1f} per hour")
            worst[column] = max(worst[column], slope)
    for column, target in TARGETS.items():
        at_most(f"largest slope of {column}", worst[column], target, "per hour")


if __name__ == "__main__":
    main()
