"""How often `rigd compare` finds a difference of 5 %, and how often one where there is none.

For each number a rig is drawn at random (friction, drive, noise, masses), its constants are stated
with errors of their u, and four campaigns are recorded, each with noise and a place at the start of
its own: two alike, two more with one parameter of the floor 5 % larger. Each two that are alike
make a try, and each of the first with one of the others. With `--keep` a study goes on where it was
stopped, and several processes may write to one file.

    python benchmarks/compare.py --to 50 --keep compare.jsonl       100 tries of each kind
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from figures import at_least, noted
from scipy.stats import binomtest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from support.recordings.comparing import CHANGE, CURRENTS, Try, tries

TARGET = 95.0  #: % of the tries
EACH = 4  #: tries of one rig


def main() -> None:
    """Play the tries that are not in the file yet, and print the counts of all."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--from", dest="first", type=int, default=1)
    parser.add_argument("--to", dest="last", type=int, default=10)
    parser.add_argument("--currents", default=CURRENTS, help="of the trials, as a sweep is written")
    parser.add_argument("--keep", type=Path, help="JSON lines, read and appended to")
    parser.add_argument("--step", type=int, default=1, help="play each so many-th number only")
    args = parser.parse_args()
    found: list[Try] = []
    for number in range(args.first, args.last + 1, args.step):
        if args.keep is not None and number in {item.number for item in kept(args.keep)}:
            continue  # in the file before, or by another process meanwhile
        with tempfile.TemporaryDirectory() as folder:
            new = tries(number, Path(folder), args.currents, twice=True)
        found += new
        if args.keep is not None:
            with args.keep.open("a") as stream:
                stream.write("".join(json.dumps(vars(item)) + "\n" for item in new))
    if args.keep is not None:
        found = [item for item in kept(args.keep) if args.first <= item.number <= args.last]
    show(found)


def kept(path: Path) -> list[Try]:
    """Return the tries in a file, those of a number once; none if there is no such file."""
    lines = path.read_text().splitlines() if path.exists() else []
    by_number: dict[int, list[Try]] = {}
    for item in (Try(**json.loads(line)) for line in lines):
        by_number.setdefault(item.number, []).append(item)
    return [item for tries in by_number.values() for item in tries[:EACH]]


def show(found: Sequence[Try]) -> None:
    """Print the counts, each with its 95 % interval (Clopper and Pearson)."""
    for changed in (False, True):
        part = [item for item in found if item.changed == changed]
        kind = f"{100 * CHANGE:g} % apart" if changed else "equal"
        print(f"{kind}: {len(part)} tries")
        for item in part:
            if item.refused:
                print(f"  rig {item.number} ({item.floor}): {item.refused}")
        part = [item for item in part if not item.refused]
        if changed:
            unknown = sum(not item.determined for item in part)
            print(f"  {unknown} without a number of the parameter that differs")
            _count("found", [item.found for item in part], judged=True)
            _count("found or no number", [item.found or not item.determined for item in part])
            _count("interval holds the change", [item.holds for item in part if item.determined])
            for name in sorted({item.parameter for item in part}):
                mine = [item.found for item in part if item.parameter == name and item.determined]
                _count(f"{name} found where it has a number", mine)
        _count("no other named", [not item.others for item in part], judged=True)
        rows = [(name, name not in item.missed) for item in part for name in item.intervals]
        _count("intervals that hold the truth", [inside for _, inside in rows])
        told = Counter(name for name, inside in rows if not inside)
        print(f"  missed: {dict(told)} of {dict(Counter(name for name, _ in rows))}")
        for item in part:
            if item.others or (changed and item.determined and not item.found):
                print(f"  rig {item.number} ({item.floor}, {item.parameter}): named {item.others}, "
                      f"found {item.found}, {item.intervals}")  # fmt: skip


def _count(name: str, hits: Sequence[bool], *, judged: bool = False) -> None:
    count, right = len(hits), sum(hits)
    if not count:
        return
    limits = binomtest(right, count).proportion_ci(0.95, "exact")
    name = f"{name}: {right} of {count} ({100 * limits.low:.0f} to {100 * limits.high:.0f} %)"
    if judged:
        at_least(name, 100.0 * right / count, TARGET, "%")
    else:
        noted(name, 100.0 * right / count, "%")


if __name__ == "__main__":
    main()
