"""How much narrower differences are where constants cancel, and whether their intervals still hold.

    python benchmarks/compare_families.py --family angle --pairs 20 --keep angle.jsonl

A pair is two campaigns on one rig, with the same constants, as far off as their u, and other noise:
nothing differs. Each difference is computed with the parts that constants have in the intervals,
and without, as if both campaigns had constants of their own.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from figures import at_least, noted
from scipy.stats import binomtest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from lateral_tables import sweep
from support.approach_angle.runs import drawn_rig, trial
from support.articulated.random_robots import random_robot
from support.lugre.random_rigs import measured

from rigd.analysis.api import ResultOrigin, identify
from rigd.analysis.compare.campaign import Campaign, of_result
from rigd.analysis.compare.comparison import compare
from rigd_analyses.approach_angle.campaign.campaign import analyse_campaign
from rigd_analyses.approach_angle.raw.run_data import Known, KnownRun

LEAST: Final = 90.0  #: % of the intervals; 95 are nominal
SET: Final = "clean_15"
Row = dict[str, Any]


def angle(number: int, folder: Path) -> list[Campaign]:
    """Return two campaigns of 18 runs of one set."""
    random, rig = np.random.default_rng((17, number)), drawn_rig(1000 + number)
    off = 1.0 + 0.0025 * random.standard_normal(), 1.0 + 0.002 * random.standard_normal()

    def known(item: KnownRun) -> KnownRun:
        torque, load = item.calibration.torque, item.calibration.load
        stated = replace(
            item.calibration,
            torque=Known(off[0] * torque.value, torque.u),
            load=Known(off[1] * load.value, load.u),
        )
        return replace(item, calibration=stated)

    found = []
    for name in ("first", "second"):
        first = 100_000 * number + (50_000 if name == "second" else 0)
        cells = [
            (load, voltage, repeat)
            for load in (4.0, 5.0, 6.0)
            for voltage in (7.0, 8.5, 10.0)
            for repeat in (1, 2)
        ]
        runs = [
            known(trial(SET, *cell, k, rig=rig, seed=first + k, individual=number).known)
            for k, cell in enumerate(cells)
        ]
        (result,) = analyse_campaign(runs).sets
        origin = ResultOrigin(name, "angle", "", "approach-angle", "", {}, {})
        found.append(Campaign(name, (origin,), result.estimates))
    return found


def robot(number: int, folder: Path) -> list[Campaign]:
    """Return two campaigns of one random robot."""
    drawn = random_robot(number, folder)
    found = []
    for k, name in enumerate(("first", "second")):
        drawn.record(folder / f"{name}.mcap", seed=2 * number + k)
        found.append(of_result(name, identify(folder / f"{name}.mcap")))
    return found


def lateral(number: int, folder: Path) -> list[Campaign]:
    """Return two lateral sweeps of the shipped rig, friction fitted along."""
    found = []
    for k, name in enumerate(("first", "second")):
        (folder / name).mkdir()
        path = measured(sweep(2 * number + k, folder / name), number, "stone")
        found.append(of_result(name, identify(path)))
    return found


FAMILIES: Final[dict[str, Callable[[int, Path], list[Campaign]]]] = {
    "angle": angle,
    "robot": robot,
    "lateral": lateral,
}


def differences(campaigns: Sequence[Campaign]) -> dict[str, tuple[float, float]]:
    """Return the interval of each difference by parameter."""
    return {
        row.name: (row.differences["second"].low, row.differences["second"].high)
        for row in compare(campaigns).compared
        if row.differences
    }


def pair(family: str, number: int) -> Row:
    """Return the intervals of one pair: ``with`` and ``without`` the parts of constants."""
    with tempfile.TemporaryDirectory() as folder:
        campaigns = FAMILIES[family](number, Path(folder))
    apart = [
        replace(item, estimates=tuple(replace(e, shares=()) for e in item.estimates))
        for item in campaigns
    ]
    return {"number": number, "with": differences(campaigns), "without": differences(apart)}


def main() -> None:
    """Play the pairs that are not in the file yet, and print what is found of all."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--family", choices=FAMILIES, required=True)
    parser.add_argument("--pairs", type=int, default=5)
    parser.add_argument("--keep", type=Path, help="JSON lines, read and appended to")
    args = parser.parse_args()
    keep: Path | None = args.keep
    lines = keep.read_text().splitlines() if keep is not None and keep.exists() else []
    rows = {row["number"]: row for row in map(json.loads, lines)}
    for number in range(1, args.pairs + 1):
        if number not in rows:
            rows[number] = pair(args.family, number)
            if keep is not None:
                with keep.open("a") as stream:
                    stream.write(json.dumps(rows[number]) + "\n")
    show(args.family, [rows[number] for number in sorted(rows)])


def show(family: str, rows: Sequence[Row]) -> None:
    """Print by parameter how many intervals hold 0, and how much narrower they are."""
    held = []
    for name in dict.fromkeys(name for row in rows for name in row["with"]):
        ends = [row["with"][name] for row in rows if name in row["with"]]
        apart = [row["without"][name] for row in rows if name in row["with"]]
        mine = [low <= 0.0 <= high for low, high in ends]
        held += mine
        widths = [[high - low for low, high in item] for item in (ends, apart)]
        ratio = np.median(np.array(widths[0]) / np.array(widths[1]))
        noted(f"{family}, {name}: width over that without cancelling", float(ratio), "")
        noted(f"{family}, {name}: held", sum(mine), f"of {len(mine)}")
    if held:
        limits = binomtest(sum(held), len(held)).proportion_ci(0.95, "exact")
        text = f"{sum(held)} of {len(held)}, {100 * limits.low:.0f} to {100 * limits.high:.0f} %"
        at_least(f"{family}: intervals that hold 0 ({text})", 100 * sum(held) / len(held), LEAST)


if __name__ == "__main__":
    main()
