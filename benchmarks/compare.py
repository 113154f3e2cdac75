"""How often `rigd compare` finds a difference of 5 %, and how often one where there is none.

For each number a rig is drawn at random (friction, drive, noise, masses), its constants are stated
with errors of their u, and three campaigns are recorded: two alike, a third with one parameter of
the floor 5 % larger. The campaigns alike make one try, the first and the third another.

    python benchmarks/compare.py --from 1 --to 30 --json compare.json
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from support.comparing import CHANGE, CURRENTS, Try, tries


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--from", dest="first", type=int, default=1)
    parser.add_argument("--to", dest="last", type=int, default=20)
    parser.add_argument("--cpu", type=float, default=600.0, help="CPU seconds after which it ends")
    parser.add_argument("--currents", default=CURRENTS, help="of the trials, as a sweep is written")
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    found: list[Try] = []
    for number in range(args.first, args.last + 1):
        if time.process_time() > args.cpu:
            break
        with tempfile.TemporaryDirectory() as folder:
            found += tries(number, Path(folder), args.currents)
        show(found)
        if args.json is not None:
            args.json.write_text(json.dumps([vars(item) for item in found], indent=1))


def show(found: list[Try]) -> None:
    """Print the counts so far."""
    for changed in (False, True):
        part = [item for item in found if item.changed == changed]
        told: dict[str, Any] = {"tries": len(part)}
        told["refused"] = sum(bool(item.refused) for item in part)
        part = [item for item in part if not item.refused]
        if changed:
            told["not determined"] = sum(not item.determined for item in part)
            told["found"] = sum(item.found for item in part)
            told["holds the change"] = sum(item.holds for item in part)
        told["others named"] = sum(bool(item.others) for item in part)
        rows = [row for item in part for row in item.inside]
        told["intervals that hold the truth"] = f"{sum(rows)} of {len(rows)}"
        print(f"{100 * CHANGE:g} % apart" if changed else "equal", told, flush=True)


if __name__ == "__main__":
    main()
