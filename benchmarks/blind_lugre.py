"""Hold `rigd identify` to the LuGre rigs of a second author: right and wrong ones.

    chrt -i 0 nice -n 19 python benchmarks/blind_lugre.py --keep blind.jsonl --right 20 --minutes 30
    python benchmarks/blind_lugre.py --keep blind.jsonl --summary

The simulator (`blind/rig.c`), the worlds and the words that count as their right name
(`blind/worlds.py`) are written from the paper and the docs alone. Right rigs come first, then one
world of each kind in random order, then another of each. A further call with the same file goes on.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import collections
import json
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from blind.judge import GOOD, LATERAL, LUGRE, Row, Study, all_worlds, named, run, verdict, worst
from blind.kind import Kind
from blind.sizes import WITHIN, off

World = tuple[str, int, int]  #: kind, size, seed


def main() -> None:
    options = arguments(__doc__)
    options.add_argument("--lateral", action="store_true", help="play lateral sweeps")
    chosen = options.parse_args()
    study(chosen, LATERAL if chosen.lateral else LUGRE)


def arguments(doc: str | None) -> argparse.ArgumentParser:
    """Return the arguments that every blind study has."""
    options = argparse.ArgumentParser(
        description=doc, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument(
        "--keep", type=Path, required=True, help="table of the rows, one JSON object a line"
    )
    options.add_argument("--right", type=int, default=20, help="number of right rigs")
    options.add_argument(
        "--seeds", type=int, default=2, help="number of seeds of each world and size"
    )
    options.add_argument("--only", help="play the worlds of this kind or family alone")
    options.add_argument("--minutes", type=float, default=1e9, help="begin no world after so long")
    options.add_argument(
        "--part", default="0/1", help="K/N: play only every N-th world, from the K-th on"
    )
    options.add_argument("--summary", action="store_true", help="print the table that is there")
    return options


def study(chosen: argparse.Namespace, of: Study) -> None:
    """Play the worlds of a family, and print its table."""
    if not chosen.summary:
        play(chosen, of)
    rows = [json.loads(line) for line in chosen.keep.read_text("utf-8").splitlines()]
    print(summary(rows, of.kinds()))
    if of is LUGRE:
        print(named_sizes(rows))


def play(chosen: argparse.Namespace, of: Study) -> None:
    """Play the worlds that the table has not yet."""
    known = of.kinds()
    order = all_worlds(known, chosen.seeds)
    np.random.default_rng(48).shuffle(order)
    order = _by_rounds(order)
    if chosen.only:
        order = [item for item in order if chosen.only in (item[0], known[item[0]].family)]
    order = [("right", 0, seed) for seed in range(chosen.right)] + order
    part, parts = (int(number) for number in chosen.part.split("/"))
    head = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=False
    ).stdout.strip()
    end = time.monotonic() + 60 * chosen.minutes
    with tempfile.TemporaryDirectory(prefix="blind-") as folder:
        for name, size, seed in order[part::parts]:
            if time.monotonic() > end:
                break
            rows = [json.loads(line) for line in _lines(chosen.keep)]
            if any((row["kind"], row["size"], row["seed"]) == (name, size, seed) for row in rows):
                continue
            row = run(name, size, seed, Path(folder), of) | {"commit": head}
            with chosen.keep.open("a", encoding="utf-8") as file:
                file.write(json.dumps(row) + "\n")
            print(line_of(row, known), flush=True)


def _by_rounds(order: list[World]) -> list[World]:
    """Return ``order`` with one world of each kind first, then another of each, and so on."""
    seen: collections.Counter[str] = collections.Counter()
    ranked = []
    for item in order:
        ranked.append((seen[item[0]], item))
        seen[item[0]] += 1
    return [item for _, item in sorted(ranked, key=lambda pair: pair[0])]


def line_of(row: Row, known: dict[str, Kind[Any]]) -> str:
    """Return one row in words."""
    size = (
        ("just visible", "clear")[row["size"]] if row["kind"] != "right" else row.get("floor", "")
    )
    told = named(row) or row["sentence"][:160]
    return (
        f"{verdict(row, known):28} {row['kind']} ({size}, {row['seed']}): "
        f"worst {worst(row):.2f} half widths, {row['cpu']:.0f} s. {told[:240]}"
    )


def summary(rows: list[Row], known: dict[str, Kind[Any]]) -> str:
    """Return the rates, with the number of worlds beside each, and every row that must not be."""
    right = [row for row in rows if row["kind"] == "right"]
    wrong = [row for row in rows if row["kind"] != "right"]
    lines = []
    if right:
        misses = [miss for row in right for name, miss in row["misses"].items() if name != "g"]
        alarms = sum(verdict(row, known) not in ("right", "A NUMBER WRONG") for row in right)
        lines.append(
            f"right rigs: {len(right)}; {sum(miss <= 1 for miss in misses)} of {len(misses)} "
            f"intervals hold the truth; {alarms} refused, or with a cause or a misfit"
        )
    if wrong:
        judged = [row for row in wrong if not known[row["kind"]].documented]
        good = sum(verdict(row, known) in GOOD for row in judged)
        causes = [row for row in judged if named(row)]
        true = sum(known[row["kind"]].accepts(named(row)) for row in causes)
        lines.append(
            f"wrong worlds: {len(wrong)} of {len({row['kind'] for row in wrong})} kinds; without "
            f"those that no data show, {good} of {len(judged)} right, rightly named, or refused "
            f"without a wrong name; of {len(causes)} names {true} are right"
        )
        verdicts = collections.Counter(verdict(row, known) for row in wrong)
        lines += [f"  {count:4} {words}" for words, count in verdicts.most_common()]
    cpu = [row["cpu"] for row in rows]
    lines.append(f"median {np.median(cpu):.1f} s of CPU, at most {max(cpu):.0f} s")
    lines += [line_of(row, known) for row in rows if verdict(row, known).split(",")[0].isupper()]
    return "\n".join(lines)


def named_sizes(rows: list[Row]) -> str:
    """Return how many sizes of right names hold the truth, and each that does not."""
    found = [(row, *item) for row in rows if row["kind"] != "right" for item in off(row)]
    held = sum(abs(sds) <= WITHIN for *_, sds in found)
    lines = [f"named sizes: {held} of {len(found)} within {WITHIN:g} standard errors"]
    lines += [
        f"  {row['kind']} ({row['size']}, {row['seed']}): {name}, {sds:+.1f} standard errors"
        for row, name, sds in found
        if abs(sds) > WITHIN
    ]
    return "\n".join(lines)


def _lines(path: Path) -> list[str]:
    return path.read_text("utf-8").splitlines() if path.exists() else []


if __name__ == "__main__":
    main()
