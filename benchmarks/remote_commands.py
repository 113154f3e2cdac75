"""From a client's command to what the actuator does: start to first setpoint, stop to none.

A daemon of its own serves two shipped rigs: the one at the wire, where the simulated drive reports
since when its motor has got what it gets, and the one simulated in the cycle's process, where the
recording says in which cycle the setpoint was given. One run after the other is started and
stopped through the Python client. Where a start spends its time is read from the events of its
recording. In every second slice of ten runs, ten clients watch all streams and one floods the
daemon with questions.

    python benchmarks/remote_commands.py --runs 100 --table commands.jsonl
                        continues the table: stop it and start it as you like
    python benchmarks/remote_commands.py --quick
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import shutil
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from crowd import crowded
from figures import at_most, noted
from support.daemon.process import Daemon, listening
from support.faults.killing import own_state
from support.wire import ROOT, free_ports, wire_rig

from rigd.record import Recording
from rigd.remote import Client

#: One constant setpoint, which the rig's rate lets through within one cycle.
HOLDING = """\
procedure: hold_current
title: Gives the wheel a constant current for as long as it is left alone
doc: For the benchmark of commands; the belt holds the carriage.
trial:
  steps:
    - step: give
      set: {wheel_servo.current: 0.1 A}
      for: 600 s
record: {wheel_servo: 1}
"""
#: Interlocks more patient than the shipped ones: a shared host that is away would end the run.
PATIENT: Final = {"stale_after: 20 ms": "stale_after: 500 ms"}
#: A crowded machine does everything within this, in s.
PATIENCE_S: Final = 60.0
LOOK_S: Final = 0.01
#: The run goes on for so long before it is stopped, in s; more, at random, so that nothing beats.
LEAST_S: Final = 0.3
#: Runs of one daemon, so that little is lost when the bench is stopped.
SLICE: Final = 10
#: A stop beside the crowd takes at most so many times as long as without.
MOST_SLOWED: Final = 3.0
#: A host that stalls ends a run by its interlocks; so many may be lost to that.
MOST_FAILED: Final = 5
#: What a start is made of, by the event of the recording that each stage ends with. Before them the
#: request is accepted, which the client sees in the reply; after them the first setpoint is given.
STAGES: Final = {
    "devices": "processes started, devices opened",
    "watchdog": "watchdogs of the actuators proven",
    "realtime": "real time entered",
    "run_start": "sensors and interlocks looked at, at rest",
}
ACCEPTED: Final = "procedure compiled, run accepted"
GIVEN: Final = "devices enabled, setpoint given"


@dataclass(frozen=True)
class Commanded:
    """What became of two commands, in s: start to first setpoint, and stop to none."""

    rig: str
    start_s: float
    stages_s: Mapping[str, float]  #: how long each stage of the start took
    stop_s: float
    stop_replied_s: float  #: when the client had its reply to the stop
    is_crowded: bool = False  #: others watched and flooded the daemon


@dataclass(frozen=True)
class Bench:
    """A served rig; ``given`` returns since when, in CLOCK_MONOTONIC ns, the motor gets which A."""

    daemon: Daemon
    given: Callable[[], tuple[float, int]] | None  #: None: the recording has it


@contextmanager
def at_the_wire(folder: Path, state: Path) -> Iterator[Bench]:
    """The rig at the wire, its devices in a process of their own."""
    name = f"wire-commands-{os.getpid()}"
    with wire_rig(folder, name, PATIENT) as wire:

        def given() -> tuple[float, int]:
            drive = wire.parts()["wheel_servo"]
            return drive["current"], drive["given_since_ns"]

        with served(wire.rig, name, folder, state) as daemon:
            yield Bench(daemon, given)


@contextmanager
def in_process(folder: Path, state: Path) -> Iterator[Bench]:
    """The rig simulated in the cycle's process."""
    name = f"sim-commands-{os.getpid()}"
    text = (ROOT / "configs" / "sim_lugre.yaml").read_text()
    parameters = "parameters: plants/"
    known = {"rig: lugre-1": f"rig: {name}", parameters: f"parameters: {ROOT}/configs/plants/"}
    for old, new in {**known, **PATIENT}.items():
        if old not in text:
            raise SystemExit(f"configs/sim_lugre.yaml has no {old!r} any more")
        text = text.replace(old, new)
    rig = folder / "rig.yaml"
    rig.write_text(text)
    with served(rig, name, folder, state) as daemon:
        yield Bench(daemon, None)


RIGS: Final = {"wire": at_the_wire, "sim": in_process}


@contextmanager
def served(rig: Path, name: str, folder: Path, state: Path) -> Iterator[Daemon]:
    """The daemon of a rig, ready."""
    endpoint = listening(rig, free_ports(1)[0])
    with Daemon(rig, name, endpoint, folder, state) as daemon:
        daemon.notified("READY=1")
        yield daemon


def one_slice(rig: str, count: int, is_crowded: bool) -> list[Commanded]:
    """Start and stop ``count`` runs, one after the other; those that failed are left out."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        state = own_state(folder)
        procedure = folder / "hold_current.yaml"
        procedure.write_text(HOLDING)
        found = []
        try:
            with (
                RIGS[rig](folder, state) as bench,
                Client(bench.daemon.name, endpoint=bench.daemon.endpoint) as client,
                client.control(),
                crowded(bench.daemon.endpoint, bench.daemon.name) if is_crowded else nullcontext(),
            ):
                for number in range(count):
                    item = commanded(rig, bench, client, procedure, LEAST_S + 0.0137 * number)
                    found += [] if item is None else [replace(item, is_crowded=is_crowded)]
        finally:
            shutil.rmtree(state)
    return found


def commanded(
    rig: str, bench: Bench, client: Client, procedure: Path, for_s: float
) -> Commanded | None:
    """Start a run, let it go on ``for_s``, stop it; None if the rig ended it before."""
    to_unix_ns = time.time_ns() - time.monotonic_ns()
    start_ns = time.monotonic_ns()
    run = str(client.start(procedure).run)
    accepted_ns = time.monotonic_ns()
    begun_ns = until(bench, client, run, lambda current: current != 0)
    time.sleep(for_s)
    stop_ns = time.monotonic_ns()
    client.stop("measured")
    replied_ns = time.monotonic_ns()
    ended_ns = until(bench, client, run, lambda current: current == 0)
    last = client.wait(run, patience_s=PATIENCE_S)
    if last.ending != "stopped":
        print(f"{run} {last.ending}: {last.reason}", flush=True)
        return None
    recording = Recording.open(bench.daemon.runs / run)
    if bench.given is None:
        rows = recording.read("wheel_servo")
        given = np.flatnonzero(rows["current_setpoint"])
        begun_ns = int(rows["t_ns"][given[0]]) - to_unix_ns
        ended_ns = int(rows["t_ns"][given[-1] + 1]) - to_unix_ns
    ends_ns = {ACCEPTED: accepted_ns}
    for event in recording.events():
        if event.kind in STAGES:  # the last of a kind counts
            ends_ns[STAGES[event.kind]] = event.t_ns - to_unix_ns
    ends_ns[GIVEN] = begun_ns
    since_ns = (start_ns, *ends_ns.values())
    return Commanded(
        rig,
        (begun_ns - start_ns) * 1e-9,
        {
            stage: (end_ns - begin_ns) * 1e-9
            for begin_ns, (stage, end_ns) in zip(since_ns, ends_ns.items(), strict=False)
        },
        (ended_ns - stop_ns) * 1e-9,
        (replied_ns - stop_ns) * 1e-9,
    )


def until(bench: Bench, client: Client, run: str, enough: Callable[[float], bool]) -> int:
    """Wait until the motor gets a current that is ``enough``; return since when.

    That is 0 if the recording has it, and if the run has ended by itself.
    """
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        status = client.status()
        if status.last is not None and status.last.run == run:
            return 0
        if bench.given is None:
            current, since_ns = float(status.step == "give" and status.state == "running"), 0
        else:
            current, since_ns = bench.given()
        if enough(current):
            return since_ns
        time.sleep(LOOK_S)
    raise SystemExit(f"{run} did not get there within {PATIENCE_S:g} s:\n{bench.daemon.told}")


def report(rig: str, rows: Sequence[Commanded]) -> None:
    """Print the figures of one rig, and the parts of a start's time."""
    crowd = [row.stop_s for row in rows if row.is_crowded]
    rows = [row for row in rows if not row.is_crowded]
    name = f"commands, {rig}"
    noted(f"{name}: runs", len(rows), "")
    for what, found in (
        ("start to first setpoint", [row.start_s for row in rows]),
        ("stop to no setpoint", [row.stop_s for row in rows]),
        ("stop to its reply", [row.stop_replied_s for row in rows]),
    ):
        noted(f"{name}: {what}, p50", 1e3 * float(np.median(found)), "ms")
        noted(f"{name}: {what}, p99", 1e3 * float(np.quantile(found, 0.99)), "ms")
    for stage in rows[0].stages_s:
        median_s = statistics.median(row.stages_s[stage] for row in rows)
        noted(f"{name}: of a start, {stage}, p50", 1e3 * median_s, "ms")
    for part in (0.5, 0.99):
        quiet_s = float(np.quantile([row.stop_s for row in rows], part))
        crowded_s = float(np.quantile(crowd, part))
        label = f"{name}: stop to no setpoint beside watchers and a flood, p{100 * part:g}"
        noted(label, 1e3 * crowded_s, "ms")
        at_most(f"{label}, against without", crowded_s / quiet_s, MOST_SLOWED)


def main() -> int:
    """Do as many runs as are missing from the table, then print it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=40, help="on each rig, without and with others")
    parser.add_argument("--quick", action="store_true", help="ten of each")
    parser.add_argument("--table", type=Path, default=None, help="file of what is done already")
    args = parser.parse_args()
    rows: list[Commanded] = []
    if args.table is not None and args.table.exists():
        rows = [Commanded(**json.loads(line)) for line in args.table.read_text().splitlines()]
    runs, failed = SLICE if args.quick else args.runs, 0
    while True:
        done = [(row.rig, row.is_crowded) for row in rows]
        missing = {kind: runs - done.count(kind) for kind in itertools.product(RIGS, (False, True))}
        rig, is_crowded = kind = max(missing, key=lambda item: missing[item])
        if missing[kind] <= 0:
            break
        count = min(SLICE, missing[kind])
        found = one_slice(rig, count, is_crowded)
        failed += count - len(found)
        if failed > MOST_FAILED:
            return 1
        rows += found
        if args.table is not None:
            with args.table.open("a") as table:
                table.writelines(json.dumps(asdict(row)) + "\n" for row in found)
        print(f"{rig}: {len(found)} runs, {sum(missing.values()) - len(found)} to go", flush=True)
    for rig in RIGS:
        report(rig, [row for row in rows if row.rig == rig])
    return 0


if __name__ == "__main__":
    sys.exit(main())
