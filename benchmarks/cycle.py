"""The cycle beside a bare C loop, cyclictest and Deimos: missed slots, and their cost.

The rig at the wire at 1 kHz (three CiA 402 servos, two CiA 406 encoders on two simulated CAN buses,
a card, a transmitter, a scale), and the register card at 4 kHz. This process is the daemon: it runs
a procedure as ``rigd run`` does, while a Python thread keeps its interpreter busy, and a live view
reads the rings 20 times a second. In the same minute and on the same processors run what
``cycle_peers.py`` describes. Deimos has its turn right after, under the same load.

What is lost, stale and late comes from the recording. A missed slot is the cycle's own unless a
witness, above all programs, was kept away for half a period at that moment too.

Interlocks and the watch over the daemon are more patient than the shipped rig files are: a shared
host is away for longer at times than they allow, and would end the run.

    python benchmarks/cycle.py                            20 s each
    python benchmarks/cycle.py --seconds 600 --no-deimos --rig wire
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from cycle_peers import (
    CYCLE_PRIORITY,
    HEADING,
    Beside,
    Deimos,
    Lateness,
    RunningBeside,
    compile_witness,
    install_deimos,
    run_deimos,
)
from figures import at_most, noted
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
from support.faults.killing import SHAKING
from support.wire import ROOT, wire_rig

from rigd.config.loader import load_rig
from rigd.config.rig import DeviceConfig, RigConfig
from rigd.daemon.execute import RunRequest, execute
from rigd.engine.play.control import Control
from rigd.engine.run.result import Progress
from rigd.engine.shared import RunFolder, View, Word, state_folder
from rigd.model.severity import Severity
from rigd.procedure.compile import compile_procedure
from rigd.procedure.loader import load_procedure
from rigd.record import Recording
from rigd.sdk import Driver

VIEWS_HZ = 20.0
#: Slots that the cycle may miss of its own, of 10 000 (design, 9.21).
OWN_MISSES = 3.0
#: Its lateness (p99.9) against that of the C loop.
LATENESS_RATIO = 2.0
#: How Deimos is run: in both of its ways, as it comes and with the priority that rigd's cycle has.
DEIMOS_RUNS = tuple(
    (method, priority) for priority in (0, CYCLE_PRIORITY) for method in ("performant", "efficient")
)
#: The rig is armed, and moves, within this time.
START_S = 120.0
TICKS = os.sysconf("SC_CLK_TCK")

#: A crowded host may be away for 60 ms and more, and the daemon, of normal priority, be kept from
#: the processors for seconds: what is measured is the cycle, and the run is to go on.
PATIENT = {"daemon_silence: 1 s": "daemon_silence: 10 s"}
PATIENT_WIRE = PATIENT | {"stale_after: 250 ms": "stale_after: 500 ms"}
PATIENT_CARD = PATIENT | {
    "    stale_after: 20 ms\n": "",
    "    action: abort\n": "    action: abort\n    stale_after: 500 ms\n",
}


@contextmanager
def at_the_wire(folder: Path) -> Iterator[Path]:
    """The rig at the wire, its devices served by a process of their own."""
    with wire_rig(folder, f"wire-cycle-{os.getpid()}", PATIENT_WIRE) as rig:
        yield rig.rig


@contextmanager
def on_the_card(folder: Path) -> Iterator[Path]:
    """The rig on the register card, simulated in the cycle's process."""
    text = (ROOT / "configs" / "card_lugre.yaml").read_text()
    for old, new in {"rig: card-lugre": f"rig: card-cycle-{os.getpid()}", **PATIENT_CARD}.items():
        assert old in text, old
        text = text.replace(old, new)
    path = folder / "card.yaml"
    path.write_text(text)
    yield path


RIGS = {"wire": at_the_wire, "card": on_the_card}


@dataclass(frozen=True)
class Seen:
    """What a thread of the daemon saw while the cycle was measured. Times in CLOCK_MONOTONIC ns."""

    beside: Beside
    since_ns: int
    until_ns: int
    origin_ns: int  #: when slot 0 was due
    views: int  #: how often the live view looked
    cpu_s: dict[str, float]  #: of the processes of the run


class RunEnded(Exception):
    """The run was over before it was measured; with the reason."""


class Meter(threading.Thread):
    """Measures a run from within the daemon, then asks it to stop."""

    def __init__(self, rig: RigConfig, witness: Path, seconds: float, control: Control) -> None:
        super().__init__(name="meter")
        self._rig = rig
        self._witness = witness
        self._seconds = seconds
        self._control = control
        self._moving = threading.Event()
        self._over = threading.Event()
        self.seen: Seen | None = None

    def watch(self, progress: Progress) -> None:
        """Begin once the procedure moves the rig."""
        if progress.step == "shake":
            self._moving.set()

    def leave(self) -> None:
        """End, as the run has."""
        self._over.set()
        self._moving.set()
        self.join()

    def run(self) -> None:
        """Load the interpreter, look at the rings, and let the others run beside."""
        try:
            if not self._moving.wait(START_S) or self._over.is_set():
                return
            self.seen = self._measure()
        finally:
            self._control.request(Severity.STOP, "measured")

    def _measure(self) -> Seen | None:
        folder = RunFolder.at(state_folder() / self._rig.name)
        board, job = folder.board(), folder.job
        views = [View(ring) for ring in folder.row_rings(job).values()]
        pids = {"cycle": board[Word.PID_CYCLE], "recorder": board[Word.PID_RECORDER]}
        load = BusyThread()
        load.start()
        beside = RunningBeside(self._witness, self._rig.period_ns // 1000, self._seconds)
        try:
            used = {name: cpu_s(pid) for name, pid in pids.items()}
            own, busy = time.process_time(), load.cpu_s
            since_ns, looked = time.monotonic_ns(), 0
            until_ns = since_ns + round(self._seconds * 1e9)
            while time.monotonic_ns() < until_ns and not self._over.wait(1 / VIEWS_HZ):
                for view in views:
                    view.read()
                looked += 1
            if self._over.is_set():
                return None
            found = {name: cpu_s(pid) - used[name] for name, pid in pids.items()}
            found["daemon"] = time.process_time() - own - (load.cpu_s - busy)
            until_ns = time.monotonic_ns()
            results = beside.results()
        finally:
            load.leave()
            beside.end()
        return Seen(results, since_ns, until_ns, board[Word.ORIGIN_NS], looked, found)


class BusyThread(threading.Thread):
    """Python that computes and never waits, so that all other threads ask for the interpreter."""

    def __init__(self) -> None:
        super().__init__(name="busy", daemon=True)
        self._over = False
        self.cpu_s = 0.0

    def run(self) -> None:
        """Count."""
        while not self._over:
            sum(range(2000))
            self.cpu_s = time.thread_time()

    def leave(self) -> None:
        """End it."""
        self._over = True
        self.join()


def every_cycle(device: DeviceConfig) -> bool:
    """Return whether there is a row of the device in every cycle."""
    return issubclass(device.driver_class, Driver) and device.declaration.every_cycle


def cpu_s(pid: int) -> float:
    """Return the CPU time that a process has used, s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(") ")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS


@dataclass(frozen=True)
class Kept:
    """The slots that were measured, from the recording."""

    lateness: Lateness
    own: int  #: missed slots while no witness was kept away
    spent_us: NDArray[np.float64]  #: from the begin of a cycle to its end, shape (n,)
    lost: int  #: rows that are not there although the cycle ran, one per device and cycle
    stale: dict[str, int]  #: marked rows, by device

    @classmethod
    def read(cls, path: Path, rig: RigConfig, seen: Seen) -> Kept:
        """Read it."""
        recording = Recording.open(path)
        cycles = recording.read("cycle")
        due_ns = np.rint(cycles["scheduled"] * 1e9).astype(np.int64) + seen.origin_ns
        measured = (due_ns >= seen.since_ns) & (due_ns < seen.until_ns)
        cycles, due_ns = cycles[measured], due_ns[measured]
        slots = np.rint(cycles["scheduled"] * 1e9 / rig.period_ns).astype(np.int64)
        missed = np.diff(slots) - 1
        (before,) = np.nonzero(missed)  # the cycles that others should have followed
        away = seen.beside.was_away(due_ns[before], due_ns[before + 1])
        own = int(missed[before][~away].sum())
        lost, stale = 0, {}
        first, last = int(cycles["t_ns"][0]), int(cycles["t_ns"][-1])
        for name, device in rig.devices.items():
            if not every_cycle(device):
                continue
            rows = recording.read(name, first, last + 1)
            lost += len(np.setdiff1d(cycles["t_ns"], rows["t_ns"], assume_unique=True))
            if "status" in (rows.dtype.names or ()):
                stale[name] = int(np.count_nonzero(rows["status"] >> 31))
        cpu_us = 1e6 * seen.cpu_s["cycle"] / len(cycles)
        late_s = cycles["actual"] - cycles["scheduled"]
        late_us = 1e6 * late_s
        lateness = Lateness.of(late_us, int(slots[-1] - slots[0]) + 1, cpu_us)
        return cls(lateness, own, cycles["spent"] * 1e6, lost, stale)


def measure(rig_file: Path, witness: Path, seconds: float, recording: Path) -> tuple[Kept, Seen]:
    """Run the rig of ``rig_file`` for ``seconds``; return what became of it.

    Raises:
        RunEnded: rigd ended the run, such as for a device that a crowded machine kept silent.
    """
    rig = load_rig(str(rig_file))
    file = rig_file.with_name("shake.yaml")
    file.write_text(SHAKING.procedure)
    source = load_procedure(str(file))
    procedure = compile_procedure(source, rig, {})
    request = RunRequest(procedure, source.file.text, rig, 1, pace=1, output=recording)
    control = Control()
    meter = Meter(rig, witness, seconds, control)
    meter.start()
    try:
        recorded = execute(request, watch=meter.watch, control=control)
    finally:
        meter.leave()
    if meter.seen is None or recorded.result.reason != "measured":
        raise RunEnded(f"the run ended by itself: {recorded.result.reason}")
    return Kept.read(recording, rig, meter.seen), meter.seen


def report(name: str, kept: Kept, seen: Seen, load: str) -> None:
    """Print the table and the figures of one rig."""
    ours, loop = kept.lateness, seen.beside.loop
    print(f"\n{name}: {ours.slots} slots, load average {load}, lateness in us")
    print(HEADING)
    print(ours.line("rigd"))
    print(loop.line("C loop beside it"))
    print(seen.beside.cyclictest.line("cyclictest beside it"))
    spent = np.percentile(kept.spent_us, (50, 99, 99.9))
    seconds = (seen.until_ns - seen.since_ns) * 1e-9
    shares = ", ".join(f"{name} {100 * s / seconds:.1f} %" for name, s in seen.cpu_s.items())
    print(f"of a cycle: p50 {spent[0]:.0f}, p99 {spent[1]:.0f}, p99.9 {spent[2]:.0f} us; "
          f"CPU of a core: {shares}; the view looked {seen.views} times")  # fmt: skip
    away_ms = float(np.diff(seen.beside.away_ns).sum()) * 1e-6
    print(f"witnesses kept away {len(seen.beside.away_ns)} times, {away_ms:.0f} ms in all; "
          f"own misses {kept.own} of {ours.missed}; stale rows {kept.stale}")  # fmt: skip
    at_most(f"{name}, rows lost", kept.lost, 0, "rows")
    per_10_000 = 1e4 / ours.slots
    at_most(f"{name}, slots missed of its own", kept.own * per_10_000, OWN_MISSES, "of 10 000")
    # Not judged: two equal loops differ by the processor that the host happens to take away.
    noted(f"{name}, slots missed", ours.missed * per_10_000, "of 10 000")
    noted(f"{name}, slots missed by the C loop", 1e4 * loop.missed / loop.slots, "of 10 000")
    at_most(f"{name}, lateness p99.9 / C loop", ours.p999_us / loop.p999_us, LATENESS_RATIO)
    noted(
        f"{name}, lateness p99.9 / cyclictest", ours.p999_us / seen.beside.cyclictest.p999_us, "x"
    )
    noted(f"{name}, CPU of the cycle process", ours.cpu_us, "us a cycle")


def report_deimos(found: Deimos, name: str, seconds: float) -> None:
    """Print the table and the figures of Deimos."""
    loop = found.beside.loop
    print(f"\n{name}")
    print(HEADING)
    print(found.lateness.line("its control thread"))
    print(loop.line("C loop beside it"))
    cores = {name: used / seconds for name, used in found.cpu_s.items() if used / seconds > 0.001}
    shares = ", ".join(f"{name} {100 * share:.1f} %" for name, share in sorted(cores.items()))
    print(f"CPU of a core: {shares} (with the busy thread)")
    noted(f"{name}, rows missing", found.lateness.missed, "rows")
    noted(f"{name}, cycles a period late, unmarked", found.late, "cycles")
    noted(f"{name}, rows without a new answer", found.unanswered, "rows")
    noted(f"{name}, lateness p99.9 / C loop", found.lateness.p999_us / loop.p999_us, "x")
    noted(f"{name}, CPU of its control thread", found.lateness.cpu_us, "us a cycle")


def main() -> int:
    """Measure each rig, and print what was found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0, help="of each loop")
    parser.add_argument("--rig", choices=tuple(RIGS), action="append", help="default: all")
    parser.add_argument("--no-deimos", action="store_true", help="leave Deimos out")
    parser.add_argument("--keep", type=Path, help="folder that the recordings are left in")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        witness, failed = compile_witness(folder), False
        for name in args.rig or RIGS:
            with RIGS[name](folder) as rig_file:
                load = "{:.1f} {:.1f} {:.1f}".format(*os.getloadavg())
                recording = (args.keep or folder) / f"cycle-{name}.mcap"
                try:
                    kept, seen = measure(rig_file, witness, args.seconds, recording)
                except RunEnded as error:
                    print(f"\ncycle, {name}: load average {load}: {error}", flush=True)
                    failed = True
                    continue
            report(f"cycle, {name}", kept, seen, load)
        if not args.no_deimos:
            python = install_deimos(folder)
            for method, priority in DEIMOS_RUNS:
                found = run_deimos(python, witness, 1000.0, args.seconds, method, priority)
                name = f"{method}, FIFO {priority}" if priority else method
                report_deimos(found, f"Deimos, {name}", args.seconds)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
