"""Kills every process of a run by every signal at every moment, beside foreign frames on the buses.

A run is hit while it opens its devices, while it arms them, while it moves, and while it plays
`finish`. The rig is the shipped one at the wire with every CAN driver. Prints after how long the
drives had no torque, and what went wrong: a process that did not end, a sample that is missing, a
recording that cannot be read. SIGSTOP is followed by SIGCONT after 2 s; a run that then goes on, or
without its recorder, is ended by SIGINT.

    python benchmarks/kill_moments.py --table moments.jsonl --foreign 1000 --hogs
                        continues the table: stop it and start it as you like
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import signal
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Mapping
from contextlib import ExitStack, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from figures import at_most, noted

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
from support.can.foreign import foreign_traffic, hogs
from support.commands.command import rigd
from support.faults.killing import (
    END_S,
    SHAKING,
    SIGNALS,
    START_S,
    VICTIMS,
    Victim,
    bound_s,
    gaps,
    heed_ctrl_c,
    own_state,
)
from support.faults.rigs import sensors_rig
from support.recordings.blocks import alive
from support.wire import WireRig

from rigd.engine.shared import Word
from rigd.record import Recording

Row = dict[str, Any]
BUSES: Final = ("servo_bus", "encoder_bus")
SERVOS: Final = SHAKING.drives
PROCEDURE: Final = """\
procedure: shake
title: The wheel turns to and fro, then the bridge
doc: For tests.
trial:
  steps:
    - step: shake
      set: {wheel_servo.current: {sine: {amplitude: 0.3 A, frequency: 2 Hz}}}
      for: TRIAL
finish:
  - step: home
    set: {lateral_belt.speed: {sine: {amplitude: 20 mm/s, frequency: 0.5 Hz}}}
    for: FINISH
record: all
"""
#: By moment: how long the trial lasts, and `finish`, which plays after a controlled stop too.
LONG: Final = ("3600 s", "0.5 s")
MOMENTS: Final = {"opening": LONG, "arming": LONG, "moving": LONG, "finishing": ("0.5 s", "10 s")}
#: How long a process is stopped, and a run without its recorder goes on, in s.
STOPPED_S: Final = 2.0


class Hit(Victim):
    """A run at one of :data:`MOMENTS`."""

    def __init__(self, rig: WireRig, place: Path, state: Path, moment: str) -> None:
        self._moment = moment
        trial, finish = MOMENTS[moment]
        procedure = PROCEDURE.replace("TRIAL", trial).replace("FINISH", finish)
        super().__init__(rig, place, state, replace(SHAKING, procedure=procedure))

    def _wait_until_moving(self) -> None:
        deadline = time.monotonic() + START_S
        while self.process.poll() is None and time.monotonic() < deadline:
            if self._is_there():
                return
            time.sleep(0.01)
        told = self.told()
        self.end()
        raise AssertionError(f"the run did not come to {self._moment}: {told}")

    def _is_there(self) -> bool:
        if self._moment == "opening":
            with suppress(ValueError, OSError):  # the run has no folder yet
                return bool(self.folder.board()[Word.OURS])
            return False
        parts = self.rig.parts()
        if self._moment == "arming":
            return any(parts[name]["enabled"] for name in SERVOS)
        if self._moment == "moving":
            return self._movement.moves(parts)
        return abs(float(parts["lateral_belt"]["speed"])) > 0.005

    def strike(self, victim: str, number: signal.Signals) -> Row:
        """Hit ``victim``; return when the drives were safe, and what went wrong."""
        pids = self.pids()
        chosen = [pid for pid in (pids.values() if victim == "all" else [pids[victim]]) if pid]
        at_ns = time.monotonic_ns()
        _send(chosen, number)
        if number is signal.SIGSTOP:
            time.sleep(STOPPED_S)
            _send(chosen, signal.SIGCONT)
        goes_on = (number is signal.SIGSTOP or victim == "recorder") and not self._ends_soon()
        if goes_on:  # as it may: its operator ends it
            at_ns = time.monotonic_ns()
            _send([self.process.pid], signal.SIGINT)
        wrong = self._ended(pids)
        safe_s = self._safe_after(at_ns)
        if safe_s is None:
            wrong.append("a drive has torque")
        wrong += self._recorded()
        return {"safe_after_s": safe_s, "wrong": wrong, "exit": self.process.poll(),
                "goes_on": goes_on, "told": self.told()[-600:]}  # fmt: skip

    def _ends_soon(self) -> bool:
        deadline = time.monotonic() + STOPPED_S
        while time.monotonic() < deadline:
            if self.process.poll() is not None:
                return True
            time.sleep(0.02)
        return False

    def _ended(self, pids: Mapping[str, int]) -> list[str]:
        deadline = time.monotonic() + END_S
        while time.monotonic() < deadline:
            self.process.poll()
            left = [name for name, pid in pids.items() if pid and alive(pid)]
            if not left and not self._recorder_lives():
                return []
            time.sleep(0.02)
        _send([pids[name] for name in left], signal.SIGKILL)
        return [f"did not end: {', '.join(left) or 'recorder'}"]

    def _safe_after(self, at_ns: int) -> float | None:
        deadline = time.monotonic() + 5.0
        while time.monotonic() < deadline:
            parts = self.rig.parts()
            since = [parts[name]["safe_since_ns"] for name in SERVOS]
            if all(since):
                return max(0.0, (int(max(since)) - at_ns) * 1e-9)
            time.sleep(0.02)
        return None

    def _recorded(self) -> list[str]:
        if not self.recording.exists():
            return []
        name, deadline = self.recording.name, time.monotonic() + END_S
        while (done := rigd("recover", name, cwd=self.recording.parent, state=self._state)).code:
            if "is in use by" not in done.err or time.monotonic() > deadline:
                return [f"not recovered: {done.err[-300:]}"]
            time.sleep(0.1)
        recording = Recording.open(self.recording)
        if len(recording.read("cycle")) < 2:
            return []
        missing = gaps(recording, "wheel_servo")
        return [f"{missing} samples missing"] if missing else []


def _send(pids: list[int], number: signal.Signals) -> None:
    for pid in pids:
        with suppress(ProcessLookupError):
            os.kill(pid, number)


def one_hit(
    rig: WireRig,
    folder: Path,
    moment: str,
    victim: str,
    number: signal.Signals,
    draw: random.Random,
) -> Row:
    """Hit one run and return what became of it."""
    place = Path(tempfile.mkdtemp(dir=folder))
    state = own_state(place)
    row: Row = {"moment": moment, "victim": victim, "signal": number.name}
    try:
        run = Hit(rig, place, state, moment)
    except AssertionError as error:
        return row | {"safe_after_s": 0.0, "wrong": [f"did not begin: {error}"], "exit": None}
    else:
        try:
            time.sleep(draw.uniform(0.0, 0.2))
            return row | run.strike(victim, number)
        finally:
            run.end()
    finally:
        shutil.rmtree(state, ignore_errors=True)
        shutil.rmtree(place, ignore_errors=True)


def _safe_s(row: Row) -> float:
    """Return after how long the drives were safe; one that is not counts as never."""
    return float("inf") if row["safe_after_s"] is None else float(row["safe_after_s"])


def _bound_s(rig: WireRig, row: Row) -> float:
    """Return after how long the drives must be without torque: a controlled stop plays `finish`."""
    victim, number = row["victim"], signal.Signals[row["signal"]]
    if row.get("goes_on"):
        victim, number = "daemon", signal.SIGINT
    asked = victim == "daemon" and number not in (signal.SIGKILL, signal.SIGSTOP)
    finish_s = float(MOMENTS[row["moment"]][1].removesuffix(" s")) if asked else 0.0
    return bound_s(rig, victim, number) + finish_s


def report(rows: list[Row], rig: WireRig) -> bool:
    """Print the table; return whether every hit was survived."""
    cells: dict[tuple[str, str, str], list[Row]] = defaultdict(list)
    for row in rows:
        cells[row["moment"], row["victim"], row["signal"]].append(row)
    late = failed = 0
    print(f"{'moment':<10} {'killed':<9} {'by':<8} {'n':>3} {'worst ms':>9} {'bound':>6}  wrong")
    for (moment, victim, name), found in sorted(cells.items()):
        bound = max(_bound_s(rig, row) for row in found)
        worst = max(map(_safe_s, found))
        late += sum(_safe_s(row) > _bound_s(rig, row) for row in found)
        wrong = [each for row in found for each in row["wrong"]]
        failed += sum(bool(row["wrong"]) for row in found)
        print(f"{moment:<10} {victim:<9} {name:<8} {len(found):>3} {1e3 * worst:>9.0f}"
              f" {1e3 * bound:>6.0f}  {'; '.join(wrong)[:200]}")  # fmt: skip
    noted("kills by moment, kills", len(rows), "")
    at_most("kills by moment, drives with torque beyond the bound", late, 0, "kills")
    at_most("kills by moment, something wrong", failed, 0, "kills")
    return not late and not failed


def main() -> int:
    """Hit as many runs as are missing from the table, then print it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=1, help="of each cell")
    parser.add_argument("--table", type=Path, default=None, help="file of what is done already")
    parser.add_argument("--foreign", type=float, default=1000.0, help="frames/s on each bus")
    parser.add_argument("--hogs", action="store_true", help="a busy program on each processor")
    parser.add_argument("--moment", choices=MOMENTS, default=None)
    parser.add_argument("--seed", type=int, default=None)
    args = parser.parse_args()
    heed_ctrl_c()
    draw, rows = random.Random(args.seed), []
    if args.table is not None and args.table.exists():
        rows = [json.loads(line) for line in args.table.read_text().splitlines()]
    done: dict[tuple[str, str, str], int] = defaultdict(int)
    for row in rows:
        done[row["moment"], row["victim"], row["signal"]] += 1
    missing = [
        (moment, victim, number)
        for moment in MOMENTS
        if args.moment in (None, moment)
        for victim in VICTIMS
        for number in SIGNALS
        for _ in range(args.kills - done[moment, victim, number.name])
    ]
    draw.shuffle(missing)
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        rig = stack.enter_context(sensors_rig(folder))
        buses = [rig.folder / name for name in BUSES]
        stack.enter_context(foreign_traffic(buses, args.foreign))
        if args.hogs:
            stack.enter_context(hogs())
        for count, (moment, victim, number) in enumerate(missing, start=1):
            row = one_hit(rig, folder, moment, victim, number, draw)
            rows.append(row)
            if args.table is not None:
                with args.table.open("a") as table:
                    table.write(json.dumps(row) + "\n")
            print(f"{count}/{len(missing)} {moment} {victim} {number.name}: "
                  f"{row['safe_after_s']} s {row['wrong']}", flush=True)  # fmt: skip
        return 0 if report(rows, rig) else 1


if __name__ == "__main__":
    sys.exit(main())
