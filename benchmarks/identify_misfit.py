"""Is a number right, refused or named when the constants are wrong?

    python benchmarks/identify_misfit.py --floor pvc --size medium --keep misfit.jsonl
    python benchmarks/identify_misfit.py --only radius --size large
    python benchmarks/identify_misfit.py --controls 30 --keep misfit.jsonl
    python benchmarks/identify_misfit.py --keep misfit.jsonl --table

A row for each kind of wrongness (``tests/support/lugre/kinds.py``) and size: by how many half
widths the worst interval of method A alone, of a parameter or of g at 5, 10, 20 or 50 mm/s, misses
the truth, what the gate decides, the same of
method A behind the gate (``--method slip-force``) and of output error, CPU seconds, the first
finding. Wrong and not named is what must not be. With ``--keep`` it continues the file; every
fifth kind comes first, so that a table that is stopped is a spread. ``--table`` only prints what
the file has. 5 to 45 s of CPU for each case.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from figures import at_least, at_most

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import numpy as np
from support.lugre.kinds import GROUPS, KINDS, SIZES
from support.lugre.wrong import World, control, right

from rigd.analysis import DataError
from rigd.analysis.result import FitOutcome, IdentificationResult
from rigd_analyses.lugre.conclusion import conclude_group
from rigd_analyses.lugre.rig.family import fit_group
from rigd_analyses.lugre.slip_force.identify import identify_lugre
from rigd_analyses.lugre.slip_force_check import checked

Row = dict[str, Any]
SLIP_M_S = np.array([0.005, 0.010, 0.020, 0.050])  #: at which g is compared
STRIDE = 5  #: between one kind and the next
REFUSED = (FitOutcome.MISFIT.name, "refused")
METHODS = {"slip": "slip-force behind the gate", "oe": "output error"}
HELD = 95.0  #: %, of the cases in which method A alone gives a wrong interval
ALARMS = 3.0  #: %, of right worlds
CHANCE = 1.5  #: half widths beyond which chance puts one of eight intervals in 1 of 40 cases


def misses(result: IdentificationResult, world: World) -> dict[str, float]:
    """Return by how many half widths each interval, and the band of g, misses the truth."""
    given = {
        entry.name: (entry.low, entry.high, world.truth[entry.name])
        for entry in (*result.parameters, *result.derived)
        if entry.identifiable and entry.name in world.truth
    }
    curve, true = result.curve, world.g(SLIP_M_S)
    for speed, friction in zip(SLIP_M_S, true, strict=True):
        if len(curve.x) and curve.x[0] <= speed <= curve.x[-1]:
            low, high = (float(np.interp(speed, curve.x, line)) for line in (curve.low, curve.high))
            given[f"g({1e3 * speed:g} mm/s)"] = (low, high, float(friction))
    return {
        name: round(abs(2.0 * truth - low - high) / (high - low), 3)
        for name, (low, high, truth) in given.items()
        if low is not None and high is not None
    }


def case(name: str, world: World, seed: int) -> Row:
    """Return the row of one world: the misses of each method, and what the gate decides."""
    trials = world.trials(seed)
    row: Row = {"case": name, "a": None, "slip": {}, "oe": {}, "outcome": "refused"}
    row |= {"finding": "", "named": []}
    begun_at = time.process_time()
    try:
        by_slip = identify_lugre(trials, world.constants)
        row["a"] = misses(by_slip, world)
        begun = fit_group(trials, world.constants, world.rig)
        row["outcome"], row["finding"] = begun.gate.outcome.name, begun.gate.sentence
        row["named"] = [item.name for item in begun.gate.explanations]
        row["slip"] = misses(checked(by_slip, begun), world)
        row["oe"] = misses(conclude_group(begun), world)
    except DataError as error:
        row["finding"] = error.message
    row["s"] = time.process_time() - begun_at
    return row


def worst(row: Row, column: str) -> float:
    """Return the worst miss in a column; 0 without any, -1 if method A refuses the data."""
    return -1.0 if row[column] is None else max(row[column].values(), default=0.0)


def verdict(row: Row, column: str) -> str:
    """Return what a user has of a method: numbers that are right, none, a name, or wrong ones."""
    if row["outcome"] in REFUSED or not row[column]:
        return "refused"
    missed = worst(row, column)
    if row["outcome"] == FitOutcome.FITS.name:
        return "right" if missed <= 1.0 else "near" if missed <= CHANCE else "wrong"
    return "named" if missed <= 1.0 else "named, near" if missed <= CHANCE else "named, wrong"


VERDICTS = ("right", "near", "named", "named, near", "refused", "named, wrong", "wrong")


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


def table(rows: Sequence[Row]) -> None:
    """Print the verdicts on each method, by group and by what method A alone makes of them."""
    wrong = [row for row in rows if not row["case"].startswith("control")]
    controls = [row for row in rows if row["case"].startswith("control")]
    group_of = {kind.name: name for name, kinds in GROUPS.items() for kind in kinds}
    parts: dict[str, list[Row]] = {name: [] for name in GROUPS}
    for row in wrong:
        parts[group_of[row["case"].partition(", ")[2].rpartition(", ")[0]]].append(row)
    parts["method A alone is off"] = [row for row in wrong if worst(row, "a") > 1.0]
    parts["method A alone refuses"] = [row for row in wrong if row["a"] is None]
    parts["method A alone is right"] = [row for row in wrong if 0.0 <= worst(row, "a") <= 1.0]
    parts["controls"] = controls
    for column, method in METHODS.items():
        print(f"\n| {method} | cases | {' | '.join(VERDICTS)} |")
        print("|---" * (len(VERDICTS) + 2) + "|")
        for name, part in parts.items():
            found = [verdict(row, column) for row in part]
            counts = " | ".join(str(found.count(item)) for item in VERDICTS)
            print(f"| {name} | {len(part)} | {counts} |")
    alarms = [row["case"] for row in controls if row["outcome"] != FitOutcome.FITS.name]
    print(f"\ncontrols: {len(controls)}, false alarms: {len(alarms)} {alarms}")
    off = parts["method A alone is off"]
    for column, method in METHODS.items() if off else ():
        held = sum(not verdict(row, column).endswith("wrong") for row in off)
        name = f"{method}: right, named or refused of {len(off)} in which method A is off"
        at_least(name, 100.0 * held / len(off), HELD, "%")
    if controls:
        at_most(
            f"false alarms of {len(controls)}", 100.0 * len(alarms) / len(controls), ALARMS, "%"
        )


def main() -> None:
    """Identify every case by both methods and print a row for each."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--floor", action="append", choices=["stone", "pvc", "paperboard"])
    parser.add_argument("--only", default="", help="kinds whose name holds this", metavar="WORD")
    parser.add_argument("--size", default="", choices=["", *SIZES])
    parser.add_argument("--controls", type=int, default=0, help="right worlds instead of wrong")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path, help="JSON lines, read and appended to")
    parser.add_argument("--table", action="store_true", help="only print what --keep has")
    args = parser.parse_args()
    if args.controls and (args.floor or args.only or args.size):
        parser.error("--controls are worlds of their own: each third is of one floor")
    lines = args.keep.read_text().splitlines() if args.keep and args.keep.exists() else []
    rows: list[Row] = [json.loads(line) for line in lines]
    done = {row["case"] for row in rows}
    for name, world in [] if args.table else worlds(args):
        if name in done:
            continue
        rows.append(case(name, world, args.seed))
        row = rows[-1]
        shown = f"slip {worst(row, 'slip'):4.1f}  oe {worst(row, 'oe'):4.1f} {row['s']:5.1f} s"
        alone = f"A {worst(row, 'a'):5.1f}"
        print(f"{name:<52} {alone}  {row['outcome']:<9} {shown}  {row['finding'][:90]}", flush=True)
        if args.keep:
            with args.keep.open("a") as stream:
                stream.write(json.dumps(row) + "\n")
    table(rows)


if __name__ == "__main__":
    main()
