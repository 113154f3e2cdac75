"""Kills every process of a run, and all at once, by five signals at random phases.

Prints after how long the simulated drives have no torque (p50, p99, worst), and what is missing
from the recording. The rig is the shipped one at the wire.

    python benchmarks/kill_table.py --kills 50 --table kills.jsonl --holding
                        continues the table: stop it and start it as you like; with --holding, a
                        controller moves the wheel, with --held it does so in a step that is held;
                        with --ni the rig stands on an NI card, with --labjack on a LabJack

    python benchmarks/kill_table.py --kills 20 --victim daemon --signal SIGKILL --loaded
                        one cell, while a program computes on each processor; for a daemon also
                        after how long the cycle noticed it
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import Any

from figures import at_most, noted

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
from support.faults.killing import (
    HELD,
    HOLDING,
    PATIENT,
    RIM_HOLD,
    SHAKING,
    SIGNALS,
    VICTIMS,
    Movement,
    Victim,
    bound_s,
    heed_ctrl_c,
    own_state,
)
from support.faults.rigs import LABJACK_SHAKING, NI_SHAKING
from support.wire import LABJACK, LUGRE, NI, WireRig, wire_rig

Row = dict[str, Any]


@contextmanager
def loaded() -> Iterator[None]:
    """Let a program compute on each processor."""
    hogs = [
        subprocess.Popen(
            [sys.executable, "-c", f"import os\nos.sched_setaffinity(0, {{{number}}})\nwhile 1: 1"]
        )
        for number in os.sched_getaffinity(0)
    ]
    try:
        yield
    finally:
        for hog in hogs:
            hog.kill()
            hog.wait()


def one_kill(
    rig: WireRig,
    folder: Path,
    victim: str,
    number: int,
    draw: random.Random,
    movement: Movement,
    *,
    beside: bool,
) -> Row:
    """Kill one run and return what became of it, with the bound that holds for it.

    ``beside``: while a program computes on each processor.
    """
    place = Path(tempfile.mkdtemp(dir=folder))
    state = own_state(place)
    run = Victim(rig, place, state, movement)
    try:
        if movement is HELD:
            run.hold()
        with loaded() if beside else nullcontext():
            time.sleep(draw.uniform(0.0, 1.0))
            killed = run.hit(victim, SIGNALS[number])
    finally:
        run.end()
        shutil.rmtree(state)
        shutil.rmtree(place)
    bound = bound_s(rig, victim, SIGNALS[number], movement)
    return {"victim": victim, "signal": SIGNALS[number].name, "bound_s": bound, **asdict(killed)}


def report(rows: list[Row]) -> bool:
    """Print the table; return whether every kill was survived as promised."""
    cells: dict[tuple[str, str], list[Row]] = defaultdict(list)
    for row in rows:
        cells[row["victim"], row["signal"]].append(row)
    print(f"{'killed':<10} {'by':<8} {'n':>3} {'safe after ms: p50':>20} {'p99':>7} {'worst':>7}"
          f" {'bound':>7} {'missing cycles':>15}")  # fmt: skip
    for (victim, name), found in cells.items():
        after = sorted(1e3 * row["safe_after_s"] for row in found)
        p99 = after[min(len(after) - 1, round(0.99 * len(after)))]
        print(f"{victim:<10} {name:<8} {len(found):>3} {statistics.median(after):>20.0f}"
              f" {p99:>7.0f} {after[-1]:>7.0f} {1e3 * found[0]['bound_s']:>7.0f}"
              f" {sum(row['gaps'] for row in found):>15}")  # fmt: skip
    noticed = sorted(1e3 * row["noticed_after_s"] for row in rows if row.get("noticed_after_s"))
    if noticed:
        print(f"the cycle noticed the end of the daemon after {statistics.median(noticed):.0f} ms"
              f" (p50), {noticed[-1]:.0f} ms (worst of {len(noticed)})")  # fmt: skip
    late = [row for row in rows if row["safe_after_s"] > row["bound_s"]]
    missing = [row for row in rows if row["gaps"] or row["last_row_s"] < -0.02]
    noted("kill table, kills", len(rows), "")
    at_most("kill table, drives with torque beyond the bound", len(late), 0, "kills")
    at_most("kill table, runs with a sample missing", len(missing), 0, "kills")
    return not late and not missing


def main() -> int:
    """Run as many kills as are missing from the table, then print it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=2, help="of each victim by each signal")
    parser.add_argument("--table", type=Path, default=None, help="file of what is done already")
    parser.add_argument("--holding", action="store_true", help="while a controller acts")
    parser.add_argument("--held", action="store_true", help="the same in a step that is held")
    parser.add_argument("--ni", action="store_true", help="the rig on an NI card")
    parser.add_argument("--labjack", action="store_true", help="the rig on a LabJack")
    parser.add_argument("--victim", choices=VICTIMS, help="this one alone")
    parser.add_argument("--signal", choices=[each.name for each in SIGNALS], help="this one alone")
    parser.add_argument("--loaded", action="store_true", help="beside programs that compute")
    parser.add_argument("--seed", type=int, default=None)
    args = parser.parse_args()
    heed_ctrl_c()
    draw = random.Random(args.seed)
    rows: list[Row] = []
    if args.table is not None and args.table.exists():
        rows = [json.loads(line) for line in args.table.read_text().splitlines()]
    done: dict[tuple[str, str], int] = defaultdict(int)
    for row in rows:
        done[row["victim"], row["signal"]] += 1
    missing = [
        (victim, number)
        for victim in VICTIMS
        if args.victim in (None, victim)
        for number in range(len(SIGNALS))
        if args.signal in (None, SIGNALS[number].name)
        for _ in range(args.kills - done[victim, SIGNALS[number].name])
    ]
    draw.shuffle(missing)
    movement, changes, shipped = SHAKING, PATIENT, LUGRE
    if args.ni:
        movement, changes, shipped = NI_SHAKING, {}, NI
    if args.labjack:
        movement, changes, shipped = LABJACK_SHAKING, {}, LABJACK
    if args.holding or args.held:
        movement, changes = (HELD if args.held else HOLDING), PATIENT | RIM_HOLD
    with (
        tempfile.TemporaryDirectory() as folder,
        wire_rig(Path(folder), "wire-table", changes, shipped) as rig,
    ):
        for count, (victim, number) in enumerate(missing, start=1):
            row = one_kill(rig, Path(folder), victim, number, draw, movement, beside=args.loaded)
            rows.append(row)
            if args.table is not None:
                with args.table.open("a") as table:
                    table.write(json.dumps(row) + "\n")
            what = f"{victim} {row['signal']}: {1e3 * row['safe_after_s']:.0f} ms"
            print(f"{count}/{len(missing)} {what}, {row['gaps']} missing", flush=True)
    return 0 if report(rows) else 1


if __name__ == "__main__":
    sys.exit(main())
