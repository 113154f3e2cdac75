"""Runs of the approach-angle rig at the wire, and how far beyond its threshold each was stopped.

The automatic stop works on the newest block of samples: card, device server, helper process,
cycle, relay line. Measured is where the platform stood, and how fast it was, when the line of the
relay changed, by the hidden state of the plant through the potentiometer's nominal scale; in ms*V,
which is the time since it passed the threshold. Beside it, what the relay alone does: how far the
platform goes until it rests or meets its bumper.

Sets, loads and voltages are drawn again. A machine pushes the platform back.

    python benchmarks/automatic_stop.py --table stops.jsonl
                        continues the table: stop it and start it as you like
"""

from __future__ import annotations

import argparse
import json
import os
import random
import statistics
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from figures import at_most, noted

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
from support.faults.killing import own_state
from support.faults.stopping import SETS, STOP_M, Drive, angle_rig, drive_to_stops, write_procedure

Row = dict[str, Any]

#: Samples of a block at 9600 Hz that are compared; the middle one is the rig's own.
BLOCKS: Final = (24, 96, 480)
OWN: Final = 96
RATE_HZ: Final = 9600.0
LOADS_KG: Final = (4.0, 5.0, 6.0, 8.0)
VOLTAGES_V: Final = (4.0, 5.5, 7.0, 8.5, 10.0)
#: Runs of one process, so that little is lost when the bench is stopped.
SLICE: Final = 20
#: A host that stalls ends a run by its interlocks; so many slices may be lost to that.
MOST_FAILED: Final = 3
TARGET_MS: Final = 15.0
BUMPER_M: Final = 0.45


def drives(count: int, draw: random.Random) -> list[Drive]:
    """Return what is set up for ``count`` runs."""
    return [
        Drive(draw.choice(list(SETS)), draw.choice(LOADS_KG), draw.choice(VOLTAGES_V))
        for _ in range(count)
    ]


def one_slice(block: int, chosen: Sequence[Drive]) -> list[Row]:
    """Do the runs ``chosen`` with blocks of that size; a row for each, none if any failed."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        state = own_state(folder)
        procedure = write_procedure(folder / "stops.yaml", chosen)
        with angle_rig(folder, "angle-wire-bench", {"block: 96": f"block: {block}"}) as rig:
            environment = {**os.environ, "RIGD_STATE": str(state)}
            stops, printed = drive_to_stops(rig, procedure, folder / "run.mcap", environment)
        if len(stops) != len(chosen):
            print(
                f"only {len(stops)} of {len(chosen)} runs ended in a stop:\n{printed}", flush=True
            )
            return []
    return [
        {
            "block": block,
            **asdict(drive),
            **asdict(stop),
            "overshoot_m": stop.overshoot_m,
            "overshoot_s": stop.overshoot_s,
        }
        for drive, stop in zip(chosen, stops, strict=True)
    ]


def report(rows: Sequence[Row]) -> None:
    """Print the table and the figures."""
    print("block    n | ms*V mean  p95  worst |  mm mean  worst | until rest mean  worst | bumper")
    for block in BLOCKS:
        found = [row for row in rows if row["block"] == block]
        if not found:
            continue
        late = sorted(1e3 * row["overshoot_s"] for row in found)
        far = [1e3 * row["overshoot_m"] for row in found]
        rest = [1e3 * (row["furthest_m"] - STOP_M) for row in found]
        bumped = sum(row["furthest_m"] > BUMPER_M for row in found)
        mean = statistics.fmean(late)
        p95 = late[round(0.95 * (len(late) - 1))]
        print(f"{block:>5} {len(found):>4} | {mean:>9.1f} {p95:>4.1f} {late[-1]:>6.1f}"
              f" | {statistics.fmean(far):>8.1f} {max(far):>6.1f}"
              f" | {statistics.fmean(rest):>15.0f} {max(rest):>6.0f} | {bumped}")  # fmt: skip
        # What is not the mean age of a block: t_proc of V (t_block / 2 + t_proc).
        noted(f"automatic stop, {block} samples, beside half a block",
              mean - 500 * block / RATE_HZ, "ms")  # fmt: skip
        if block == OWN:
            noted("automatic stop, runs", len(found), "")
            at_most("automatic stop, mean", mean, TARGET_MS, "ms*V")
            noted("automatic stop, worst", late[-1], "ms*V")
            noted("automatic stop, farthest at the command", max(far), "mm")
            noted("automatic stop, farthest until rest", max(rest), "mm")


def main() -> int:
    """Do as many runs as are missing from the table, then print it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=200, help=f"with blocks of {OWN} samples")
    parser.add_argument("--others", type=int, default=40, help="with each other size of block")
    parser.add_argument("--table", type=Path, default=None, help="file of what is done already")
    parser.add_argument("--seed", type=int, default=None)
    args = parser.parse_args()
    draw = random.Random(args.seed)
    rows: list[Row] = []
    if args.table is not None and args.table.exists():
        rows = [json.loads(line) for line in args.table.read_text().splitlines()]
    missing = {
        block: (args.runs if block == OWN else args.others)
        - sum(row["block"] == block for row in rows)
        for block in BLOCKS
    }
    failed = 0
    while left := {block: count for block, count in missing.items() if count > 0}:
        block = max(left, key=lambda item: left[item])
        count = min(SLICE, left[block])
        found = one_slice(block, drives(count, draw))
        if not found:
            failed += 1
            if failed > MOST_FAILED:
                return 1
            continue
        missing[block] -= count
        rows += found
        if args.table is not None:
            with args.table.open("a") as table:
                table.writelines(json.dumps(row) + "\n" for row in found)
        print(f"blocks of {block}: {len(found)} runs, {sum(missing.values())} to go", flush=True)
    report(rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
