"""Does every shipped procedure come to its end on every shipped rig, with any seed?

    python benchmarks/seeds.py --table seeds.jsonl
                        continues the table: stop it and start it as you like
    python benchmarks/seeds.py --seeds 3 --only approach
                        fewer seeds, pairs whose name holds the word

Each run is whole, in virtual time, and is recorded. The rigs are those simulated in process; the
floor, if a procedure asks for one, goes by the seed.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from figures import at_most

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
from support.recordings.shipped_runs import Pair, pairs, play, wrong

Row = dict[str, Any]
SEEDS = 50


def one_run(pair: Pair, seed: int) -> Row:
    """Return what became of ``pair`` with ``seed``."""
    begun = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        result = play(pair, seed, Path(folder) / "run.mcap")
    return {
        "pair": pair.name,
        "seed": seed,
        "wrong": wrong(result),
        "run_s": result.run_s,
        "cpu_s": time.process_time() - begun,
    }


def report(name: str, rows: list[Row]) -> None:
    """Print how many runs of one pair are whole, and each that is not."""
    failed = [row for row in rows if row["wrong"]]
    run_s, cpu_s = (sum(row[key] for row in rows) for key in ("run_s", "cpu_s"))
    print(f"{name}: {len(rows)} seeds, {run_s / 3600:.2f} h of rig time in {cpu_s:.0f} s CPU")
    for row in failed:
        print(f"  seed {row['seed']}: {row['wrong']}")
    at_most(f"{name}: of {len(rows)} seeds not whole", len(failed), 0, "runs")


def main() -> int:
    """Play what the table lacks, and print what became of each pair."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=SEEDS, help="seeds 1 to N (default 50)")
    parser.add_argument("--only", default="", help="pairs whose name holds this", metavar="WORD")
    parser.add_argument("--table", type=Path, help="JSON lines, read and appended to")
    arguments = parser.parse_args()
    table: Path | None = arguments.table
    known = table.read_text().splitlines() if table is not None and table.exists() else []
    rows: list[Row] = [json.loads(line) for line in known]
    chosen = [pair for pair in pairs() if arguments.only in pair.name]
    for seed in range(1, arguments.seeds + 1):
        for pair in chosen:
            if any(row["pair"] == pair.name and row["seed"] == seed for row in rows):
                continue
            rows.append(one_run(pair, seed))
            if table is not None:
                with table.open("a") as file:
                    file.write(json.dumps(rows[-1]) + "\n")
    for pair in chosen:
        mine = [row for row in rows if row["pair"] == pair.name and row["seed"] <= arguments.seeds]
        report(pair.name, mine)
    return int(any(row["wrong"] for row in rows if row["seed"] <= arguments.seeds))


if __name__ == "__main__":
    sys.exit(main())
