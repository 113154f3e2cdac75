"""Is a number right, refused or named when the constants are wrong?

    python benchmarks/identify_misfit.py --floor pvc --keep misfit.jsonl
    python benchmarks/identify_misfit.py --only radius --size large
    python benchmarks/identify_misfit.py --controls 30

A row for each kind of wrongness (``tests/support/lugre_kinds.py``) and size: by how many half
widths the worst interval of method A misses the truth, the outcome of output error, its worst
interval, CPU seconds, the first finding. Wrong and not named is what must not be. With ``--keep``
it continues the file; every fifth kind comes first, so that a table that is stopped is a spread.
5 to 45 s of CPU for each case.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from support.lugre_kinds import KINDS, SIZES
from support.lugre_wrong import World, control, right

from rigd.analysis import DataError
from rigd.analysis.result import FitOutcome, IdentificationResult
from rigd_analyses.lugre.identify import identify_lugre
from rigd_analyses.lugre.rig.identify import identify_output_error

Row = dict[str, Any]
STRIDE = 5  #: between one kind and the next


def worst(result: IdentificationResult, world: World) -> float:
    """Return the largest error of an interval that is given, in half widths; 0 without any."""
    errors = [0.0]
    for entry in (*result.parameters, *result.derived):
        if not entry.identifiable or entry.low is None or entry.high is None:
            continue
        if entry.name in world.truth:
            middle, half = 0.5 * (entry.low + entry.high), 0.5 * (entry.high - entry.low)
            errors.append(abs(world.truth[entry.name] - middle) / half)
    return max(errors)


def case(name: str, world: World, seed: int) -> Row:
    """Return the row of one world."""
    trials = world.trials(seed)
    row: Row = {"case": name, "a": 0.0, "outcome": "refused", "oe": 0.0, "finding": ""}
    try:
        row["a"] = worst(identify_lugre(trials, world.constants), world)
    except DataError:
        row["a"] = -1.0
    begun = time.process_time()
    try:
        result = identify_output_error(trials, world.constants, world.rig)
    except DataError as error:
        row["finding"] = error.message
    else:
        gate = result.gate
        row["oe"] = worst(result, world)
        row["outcome"] = "" if gate is None else gate.outcome.name
        row["finding"] = "" if gate is None else gate.sentence
    row["s"] = time.process_time() - begun
    return row


def worlds(args: argparse.Namespace) -> Iterator[tuple[str, World]]:
    """Yield the worlds that are asked for, by name, every fifth kind first."""
    for number in range(args.controls):
        yield f"control {number}", control(number)
    if args.controls:
        return
    for floor in args.floor or ["pvc", "stone"]:
        for kind in (kind for first in range(STRIDE) for kind in KINDS[first::STRIDE]):
            for label, size in zip(SIZES, kind.sizes, strict=True):
                if args.only in kind.name and args.size in ("", label):
                    yield f"{floor}, {kind.name}, {label}", kind.world(right(floor), size)


def main() -> None:
    """Identify every case by both methods and print a row for each."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--floor", action="append", choices=["stone", "pvc", "paperboard"])
    parser.add_argument("--only", default="", help="kinds whose name holds this", metavar="WORD")
    parser.add_argument("--size", default="", choices=["", *SIZES])
    parser.add_argument("--controls", type=int, default=0, help="right worlds instead of wrong")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path, help="JSON lines, read and appended to")
    args = parser.parse_args()
    lines = args.keep.read_text().splitlines() if args.keep and args.keep.exists() else []
    rows: list[Row] = [json.loads(line) for line in lines]
    done = {row["case"] for row in rows}
    for name, world in worlds(args):
        if name in done:
            continue
        rows.append(case(name, world, args.seed))
        row = rows[-1]
        print(
            f"{name:<58} A {row['a']:5.1f}  {row['outcome']:<9} {row['oe']:4.1f} "
            f"{row['s']:5.1f} s  {row['finding'][:90]}",
            flush=True,
        )
        if args.keep:
            with args.keep.open("a") as stream:
                stream.write(json.dumps(row) + "\n")
    wrong = [row for row in rows if row["a"] > 1.0 and not row["case"].startswith("control")]
    good = [row for row in wrong if row["outcome"] != FitOutcome.FITS.name or row["oe"] <= 1.0]
    print(f"method A off by more than its interval: {len(wrong)}")
    print(f"of these right, named or refused: {len(good)}")
    off = [row for row in wrong if row["outcome"] == FitOutcome.CORRECTED.name and row["oe"] > 1.0]
    print(f"of these named, but an interval misses the truth: {len(off)}")
    controls = [row for row in rows if row["case"].startswith("control")]
    alarms = [row for row in controls if row["outcome"] != FitOutcome.FITS.name]
    print(f"controls: {len(controls)}, false alarms: {len(alarms)}")


if __name__ == "__main__":
    main()
