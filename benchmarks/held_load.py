"""How well is a load held while other floors pass below and the disk accelerates?

The rig is ``examples/press``: a screw presses a pin on a disk, and its controller holds the force
of a column of 20 kN/m, as a load cell behind an NI card shows it in blocks of 10 ms. The disk
accelerates to 40 rad/s, friction pulls at the pin, and a cam lifts and lowers the table by 0.25 mm,
which alone would change the load by 5 N. First in virtual time, then, with ``--wire``, with CAN
drives and the card at the wire in real time. The machine's load is printed.

    python benchmarks/held_load.py --wire 3
"""

from __future__ import annotations

import argparse
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from figures import at_most

from rigd.record import Recording

EXAMPLE = Path(__file__).parent.parent / "examples" / "press"
RIGD = (sys.executable, "-m", "rigd")
LOAD_N = 20.0
#: The steps that count, and from which time of the trial on in s: before, the load is put on.
STEPS, SETTLED_S = ("press", "accelerate", "floors"), 1.5
#: The run is to go on although the host is away at times, as in ``cycle.py``.
PATIENT = {
    "watchdog: 100 ms": "watchdog: 500 ms",
    "stale_after: 100 ms": "stale_after: 400 ms",
    "daemon_silence: 1 s": "daemon_silence: 10 s",
}


def rig_folder(folder: Path) -> Path:
    """Return the folder of the rig, made as a user makes it."""
    made = (*RIGD, "new", "rig", f"press{os.getpid()}", "--from", str(EXAMPLE / "press.yaml"))
    subprocess.run((*made, "--folder", str(folder)), check=True, stdout=subprocess.DEVNULL)
    rig = folder / f"press{os.getpid()}"
    shutil.copy(EXAMPLE / "hold.yaml", rig / "procedures")
    wire = rig / "wire.yaml"
    text = wire.read_text("utf-8")
    for old, new in PATIENT.items():
        if old not in text:
            raise ValueError(f"{wire} has no {old!r}")
        text = text.replace(old, new)
    wire.write_text(text, "utf-8")
    return rig


def held(rig: Path, file: str, recording: Path) -> dict[str, float]:
    """Play the procedure; return for each step how far the load is off, in % RMS."""
    command = (*RIGD, "run", "procedures/hold.yaml", "--rig", file, "--output", str(recording))
    subprocess.run((*command, "--yes"), cwd=rig, check=True, stdout=subprocess.DEVNULL)
    load = Recording.open(recording).trial(1)["load"]
    settled = np.asarray(load["trial_time"]) > SETTLED_S
    found = {}
    for step in STEPS:
        off = np.asarray(load["force"])[settled & (np.asarray(load["step"]) == step)] / LOAD_N - 1.0
        found[step] = 100.0 * float(np.sqrt(np.mean(off**2)))
    return found


@contextmanager
def served(rig: Path) -> Iterator[None]:
    """Serve the devices of the rig at the wire."""
    command = (*RIGD, "sim", "wire.yaml")
    with subprocess.Popen(command, cwd=rig, stdout=subprocess.PIPE, text=True) as devices:
        try:
            for line in devices.stdout or ():
                if "is served" in line:
                    break
            yield
        finally:
            devices.terminate()


def main() -> None:
    """Hold the load in virtual time and at the wire, and report."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--wire", type=int, default=0, help="rounds at the wire, of 10 s each")
    rounds = parser.parse_args().wire
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        rig = rig_folder(folder)
        for step, error in held(rig, "sim.yaml", folder / "virtual.mcap").items():
            at_most(f"load held in virtual time, {step}", error, 1, "% RMS")
        if not rounds:
            return
        with served(rig):
            errors = []
            for turn in range(rounds):
                errors.append(held(rig, "wire.yaml", folder / f"{turn}.mcap"))
                print(f"round {turn + 1}, load {os.getloadavg()[0]:.1f}: {errors[-1]}", flush=True)
        for step in STEPS:
            error = statistics.median(item[step] for item in errors)
            at_most(f"load held at the wire, {step}", error, 1, "% RMS")


if __name__ == "__main__":
    main()
