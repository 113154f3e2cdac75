"""What derived channels cost: 32 of them, in a cycle and in a simulated run, beside none.

The rig without them and the rig with them play the same trial in turn, in CPU time. The peers of
the graph are the same arithmetic in plain Python, one closure for each channel, as a script of a
lab has it, with the filter of scipy that takes a sample at a time; and the calc graph of Deimos,
in Rust, with simpler channels that both have (``deimos_loop.py``): what its control loop and its
recorder take with the channels, less what they take without. The comparison favours rigd: Deimos
plays in real time, with cold caches, and writes a CSV file; rigd plays in virtual time, and its
rows are packed and discarded. ``computing_wire.py`` has rigd in real time.

    python benchmarks/derived.py --no-deimos       without what must be installed from an index
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import tempfile
import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from cycle_peers import install_deimos
from figures import at_least, at_most, in_turn, noted
from scipy import signal

from rigd.config.loader import parse_rig
from rigd.config.rig import RigConfig
from rigd.engine.clock import VirtualClock
from rigd.engine.cycle.wiring import wire
from rigd.engine.play.control import Control
from rigd.engine.process.in_process import InProcessHost
from rigd.engine.sink import Rows
from rigd.procedure.profiles.profiles import ConstantProfile
from rigd.procedure.program import CycleProgram, Recorded, Segment
from rigd.sdk.shipped_files import shipped_folder

ROUNDS = 40
SECONDS = 1.0
FOUR = """\
  {g}.speed{n}: {{is: derivative(wheel_encoder.angle) * 5{n} mm, lowpass: 5{n} Hz}}
  {g}.slip{n}: {{is: {g}.speed{n} - derivative(carriage.position)}}
  {g}.done{n}: {{is: integral(abs({g}.slip{n}) * 5 N), reset: trial}}
  {g}.mean{n}: {{is: "mean({g}.slip{n}, 0.1 s)", where: {g}.speed{n} > 1 mm/s}}
"""
#: The same in rigd and in the calc graph of Deimos.
SIMPLE = """\
  {g}.low{n}: {{is: carriage.position, lowpass: 5{n} Hz}}
  {g}.scaled{n}: {{is: 2 * {g}.low{n} + 1 m}}
  {g}.curve{n}: {{is: 0.1 m + (0.2 + 0.3 * {g}.scaled{n} / 1 m) * {g}.scaled{n}}}
  {g}.back{n}: {{is: ({g}.curve{n} - 1 m) / 2}}
"""
DEIMOS_ROUNDS, DEIMOS_SECONDS = 3, 10.0
#: Of its process, what stands for nothing of rigd: its simulated card, and the script itself.
NOT_DEIMOS = ("hootl-runner", "python", "Thread-1 (busy)")


class Nowhere:
    """Discards rows and events."""

    def write(self, stream: str, rows: Rows) -> None:
        """Discard rows."""

    def event(self, *args: object) -> None:
        """Discard an event."""

    def flush(self, *, complete: bool = False) -> None:
        """Do nothing."""

    def close(self) -> None:
        """Do nothing."""


def rig_with(groups: int, four: str = FOUR) -> RigConfig:
    """Return the rig of the first paper with 32 derived channels in ``groups`` groups, or none."""
    path = shipped_folder("configs") / "sim_lugre.yaml"
    derived = "".join(four.format(g=f"s{n % groups}", n=n) for n in range(8)) if groups else ""
    text = f"derived:\n{derived}interlocks:\n" if groups else "interlocks:\n"
    return parse_rig(path.read_text().replace("interlocks:\n", text, 1), path)


def play(rig: RigConfig) -> float:
    """Return the CPU time of a cycle in us, with everything recorded to nowhere."""
    clock = VirtualClock(rig.period_ns, 1_790_000_000_000_000_000)
    cycle = wire(rig, clock, Control(), 1).cycle
    record = {stream.name: Recorded() for stream in cycle.rig.streams}
    host = InProcessHost(cycle, clock, virtual=True, sink=Nowhere(), record=record)
    host.open()
    host.arm()
    profiles = {
        "wheel_servo.current": ConstantProfile(0.2),
        "longitudinal_belt.engaged": ConstantProfile(0.0),
    }
    program = CycleProgram((Segment("go", profiles, duration_s=SECONDS),))
    began = time.process_time()
    host.play(program)
    host.drain()
    return 1e6 * (time.process_time() - began) / (1e3 * SECONDS)


def plain_python(count: int) -> float:
    """Return the CPU time in us of 8 such groups in plain Python, per cycle."""
    rng = np.random.default_rng(1)
    angles, positions = rng.normal(size=(2, count)).cumsum(axis=1).tolist()
    sos = signal.butter(2, 50, fs=1000, output="sos")
    groups: list[dict[str, Any]] = [
        {"zi": np.zeros((1, 2)), "done": 0.0, "last": 0.0, "window": []} for _ in range(8)
    ]
    before = (0.0, 0.0)
    began = time.process_time()
    for angle, position in zip(angles, positions, strict=True):
        for group in groups:
            raw = np.array([(angle - before[0]) * 1e3 * 0.05])
            out, group["zi"] = signal.sosfilt(sos, raw, zi=group["zi"])
            slip = float(out[0]) - (position - before[1]) * 1e3
            group["done"] += 0.5e-3 * (abs(slip) + group["last"]) * 5
            group["last"] = abs(slip)
            window = group["window"]
            window.append(slip)
            if len(window) > 100:
                window.pop(0)
            _ = sum(window) / len(window)
        before = angle, position
    return 1e6 * (time.process_time() - began) / count


def deimos(python: Path, groups: int) -> tuple[float, float]:
    """Return the CPU time of a cycle of Deimos in us: of its control loop, and of all it does."""
    script = Path(__file__).with_name("deimos_loop.py")
    with tempfile.TemporaryDirectory() as folder:
        command = [python, script, folder, "1000", str(DEIMOS_SECONDS), "efficient", "0", groups]
        done = subprocess.run([*map(str, command)], stdout=subprocess.PIPE, text=True, check=True)
    found = json.loads(done.stdout.splitlines()[-1])
    used, cycles = found["cpu_s"], len(found["late_us"])
    whole = sum(spent for name, spent in used.items() if name not in NOT_DEIMOS)
    return 1e6 * used["controller-run"] / cycles, 1e6 * whole / cycles


def beside_deimos() -> None:
    """Report what 32 simple channels add to a cycle here and there."""
    rigs = [rig_with(groups, SIMPLE) for groups in (0, 1, 8)]
    for rig in rigs:
        play(rig)
    ours, theirs = [], []
    with tempfile.TemporaryDirectory() as folder:
        python = install_deimos(Path(folder))
        for _ in range(DEIMOS_ROUNDS):
            bare, single, eight = (play(rig) for rig in rigs)
            ours.append((single - bare, eight - bare))
            without, with_ = deimos(python, 0), deimos(python, 8)
            theirs.append((with_[0] - without[0], with_[1] - without[1]))
    single, eight = (statistics.median(column) for column in zip(*ours, strict=True))
    loop, whole = (statistics.median(column) for column in zip(*theirs, strict=True))
    noted("32 simple channels in a group, added to a cycle of rigd, virtual time", single, "us")
    noted("32 simple channels in eight groups, added to a cycle, virtual time", eight, "us")
    noted("the same in Deimos, added to its control loop, real time", loop, "us")
    noted("the same in Deimos, added to loop and recorder (CSV), real time", whole, "us")


def main() -> None:
    """Play both rigs in turn and report what the channels add."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--no-deimos", action="store_true", help="leave Deimos out")
    args = parser.parse_args()
    rigs = [rig_with(groups) for groups in (0, 1, 8)]
    for rig in rigs:
        play(rig)
    (bare, _, _), (single, single_us, single_x), (eight, eight_us, _) = in_turn(
        [partial(play, rig) for rig in rigs], ROUNDS
    )
    print(f"a cycle in virtual time, in us: {bare:.1f}, with 32 channels in a group {single:.1f}, "
          f"in eight groups {eight:.1f}")  # fmt: skip
    at_most("32 derived channels in a group, added to a cycle", single_us, 40, "us")
    at_most("32 derived channels in eight groups, added to a cycle", eight_us, 40, "us")
    at_most("32 derived channels in a group, virtual time longer by", 100 * (single_x - 1), 20, "%")
    peer = plain_python(400)
    noted("the same 32 channels in plain Python with scipy's filter", peer, "us per cycle")
    at_least("plain Python / rigd", peer / eight_us, 5)
    if not args.no_deimos:
        beside_deimos()


if __name__ == "__main__":
    main()
