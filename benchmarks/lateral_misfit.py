"""Is the rollers' friction right, refused or named when a constant of a lateral sweep is wrong?

    python benchmarks/lateral_misfit.py                      wrong worlds
    python benchmarks/lateral_misfit.py --right 24           right ones, drawn at random
    python benchmarks/lateral_misfit.py --right 40 --first 100 --table right.jsonl

A row for each world: what the gate decides, by how many half widths the worst interval misses the
truth, the first sentence. Below: how many of each quantity's intervals hold. With ``--table`` a row
is kept as soon as it is known, and a further call adds only those that lack. 8 to 25 s of CPU each.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import numpy as np
from support.lugre.lateral_wrong import WRONG, Sweep, right

from rigd.analysis import DataError
from rigd.analysis.result import FitOutcome
from rigd_analyses.lugre.lateral.family import find_lateral
from rigd_analyses.lugre.lateral.result import result

CHANCE = 1.5  #: half widths, as in the bench of the rig along the guide

#: By quantity: its miss in half widths and its half width over its middle.
Intervals = dict[str, tuple[float, float]]


def row(sweep: Sweep) -> tuple[str, Intervals, str]:
    """Return the verdict on one world, its intervals, the gate's sentence."""
    try:
        found = find_lateral(sweep.trials(), sweep.rig, sweep.constants)
    except DataError as error:
        return "refused", {}, error.message
    shown, sentence = result(found), found.gate.sentence
    if found.gate.outcome is FitOutcome.MISFIT:
        return "refused", {}, sentence
    intervals: Intervals = {}
    dry, viscous = sweep.bench.dry, sweep.bench.viscous
    at = [abs(float(np.mean(speed))) for speed in found.system.speeds]
    entries = {
        "mu_R_dry": (dry, shown.parameters[0]),
        "mu_R_vis": (viscous, shown.parameters[1]),
        "mu_R slow": (dry + min(at) * viscous, shown.derived[0]),
        "mu_R fast": (dry + max(at) * viscous, shown.derived[-1]),
    }
    for name, (truth, entry) in entries.items():
        if entry.low is not None and entry.high is not None:
            middle, half = 0.5 * (entry.low + entry.high), 0.5 * (entry.high - entry.low)
            intervals[name] = (abs(truth - middle) / half, half / middle)
    worst = max((miss for miss, _ in intervals.values()), default=0.0)
    hit = "right" if worst <= 1.0 else "near" if worst <= CHANCE else "wrong"
    named = found.gate.outcome is FitOutcome.CORRECTED
    return f"named, {hit}" if named else hit, intervals, sentence


def told(item: dict[str, Any]) -> str:
    """Return a row of the table as a line."""
    each = ", ".join(f"{k} {miss:.2f} (+-{w:.1%})" for k, (miss, w) in item["intervals"].items())
    return (
        f"{item['name']:<34} {item['verdict']:<13} {item['cpu_s']:5.1f} s  {each}  "
        f"{item['sentence'][:150]}"
    )


def summary(rows: Sequence[dict[str, Any]]) -> str:
    """Return how many worlds have which verdict, and how many intervals hold."""
    verdicts = Counter(item["verdict"] for item in rows)
    lines = [", ".join(f"{verdict}: {count}" for verdict, count in verdicts.most_common())]
    for name in sorted({name for item in rows for name in item["intervals"]}):
        given = [item["intervals"][name] for item in rows if name in item["intervals"]]
        held = sum(miss <= 1.0 for miss, _ in given)
        widths = sorted(width for _, width in given)
        lines.append(
            f"{name}: {held} of {len(given)} intervals hold; half width {widths[0]:.1%} to "
            f"{widths[-1]:.1%}, half of them below {widths[len(widths) // 2]:.1%}"
        )
    cpu = [item["cpu_s"] for item in rows]
    return "\n".join([*lines, f"{sum(cpu) / len(cpu):.1f} s of CPU each, {max(cpu):.1f} s at most"])


def main() -> None:
    """Identify every world and print a row for each."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--right", type=int, default=0, help="right worlds instead of wrong")
    parser.add_argument("--first", type=int, default=0, help="number of the first right world")
    parser.add_argument("--only", default="", help="worlds whose name holds this", metavar="WORD")
    parser.add_argument("--table", type=Path, help="file that keeps the rows", metavar="FILE")
    args = parser.parse_args()
    numbers = range(args.first, args.first + args.right)
    worlds = {f"right {k}": right(k) for k in numbers} if args.right else WRONG
    kept = args.table.read_text().splitlines() if args.table and args.table.exists() else []
    rows = {item["name"]: item for item in map(json.loads, kept)}
    for name, sweep in worlds.items():
        if args.only not in name:
            continue
        if name not in rows:
            begun = time.process_time()
            verdict, intervals, sentence = row(sweep)
            rows[name] = {
                "name": name, "verdict": verdict, "intervals": intervals, "sentence": sentence,
                "cpu_s": time.process_time() - begun,
            }  # fmt: skip
            if args.table:
                with args.table.open("a") as file:
                    file.write(json.dumps(rows[name]) + "\n")
        print(told(rows[name]), flush=True)
    print(summary([rows[name] for name in worlds if name in rows]))


if __name__ == "__main__":
    main()
