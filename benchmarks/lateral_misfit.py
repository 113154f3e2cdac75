"""Is the rollers' friction right, refused or named when a constant of a lateral sweep is wrong?

    python benchmarks/lateral_misfit.py                      wrong worlds
    python benchmarks/lateral_misfit.py --right 24           right ones, drawn at random

A row for each world: what the gate decides, by how many half widths the worst interval misses the
truth, the first sentence. 8 to 25 s of CPU for each.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from support.lateral_wrong import WRONG, Sweep, right

from rigd.analysis import DataError
from rigd.analysis.result import FitOutcome
from rigd_analyses.lugre.lateral.identify import find_lateral
from rigd_analyses.lugre.lateral.result import result

CHANCE = 1.5  #: half widths, as in the bench of the rig along the guide


def row(sweep: Sweep) -> tuple[str, float, str]:
    """Return the verdict on one world, the worst miss in half widths, the gate's sentence."""
    try:
        found = find_lateral(sweep.trials(), sweep.rig, sweep.constants)
    except DataError as error:
        return "refused", 0.0, error.message
    shown, sentence = result(found), found.gate.sentence
    if found.gate.outcome is FitOutcome.MISFIT:
        return "refused", 0.0, sentence
    worst = 0.0
    for name, value in sweep.truth.items():
        entry = shown.parameter(name)
        if entry.low is not None and entry.high is not None:
            middle, half = 0.5 * (entry.low + entry.high), 0.5 * (entry.high - entry.low)
            worst = max(worst, abs(value - middle) / half)
    hit = "right" if worst <= 1.0 else "near" if worst <= CHANCE else "wrong"
    named = found.gate.outcome is FitOutcome.CORRECTED
    return f"named, {hit}" if named else hit, worst, sentence


def main() -> None:
    """Identify every world and print a row for each."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--right", type=int, default=0, help="right worlds instead of wrong")
    parser.add_argument("--only", default="", help="worlds whose name holds this", metavar="WORD")
    args = parser.parse_args()
    worlds = {f"right {k}": right(k) for k in range(args.right)} if args.right else WRONG
    verdicts: Counter[str] = Counter()
    for name, sweep in worlds.items():
        if args.only not in name:
            continue
        begun = time.process_time()
        verdict, worst, sentence = row(sweep)
        verdicts[verdict] += 1
        took = time.process_time() - begun
        print(f"{name:<34} {verdict:<13} {worst:4.1f} {took:5.1f} s  {sentence[:150]}", flush=True)
    print(", ".join(f"{verdict}: {count}" for verdict, count in verdicts.most_common()))


if __name__ == "__main__":
    main()
