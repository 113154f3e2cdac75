"""The approach-angle campaign: 200 runs at 9600 Hz simulated and recorded, then analysed.

python benchmarks/angle_campaign.py                 the whole campaign, about a minute
python benchmarks/angle_campaign.py --set clean_0   a fifth of it

Both as a user does it, through the command line, each pinned to one core; the kernels are compiled
before. Wall time is what the user waits; CPU time is what it costs on any machine.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from figures import at_most

ROOT = Path(__file__).resolve().parents[1]
RIG = ROOT / "configs" / "sim_approach_angle.yaml"
PROCEDURE = ROOT / "procedures" / "approach_angles.yaml"
CAMPAIGN = 200
#: Seconds that 200 runs may take (issue text of the rig: simulated and recorded; analysed).
TARGET_RUN_S = 60.0
TARGET_ANALYSIS_S = 10.0


@dataclass(frozen=True)
class Spent:
    """What one command took, in s."""

    wall: float
    cpu: float


def rigd(*arguments: str) -> tuple[Spent, str]:
    """Run one command of rigd on one core; return what it took and what it printed."""
    core = min(os.sched_getaffinity(0))
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-m", "rigd", *arguments],
        check=False,
        capture_output=True,
        text=True,
        preexec_fn=lambda: os.sched_setaffinity(0, {core}),
    )
    wall, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        raise SystemExit(f"rigd {' '.join(arguments)}: exit {done.returncode}\n{done.stderr}")
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Spent(wall, cpu), done.stdout


def main() -> int:
    """Run and analyse, and print both figures."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--set", help="one set instead of all five", metavar="NAME")
    parser.add_argument("--keep", type=Path, help="keep the recording as this file")
    arguments = parser.parse_args()
    chosen = ["--set", f"set={arguments.set}"] if arguments.set else []
    runs = CAMPAIGN // 5 if arguments.set else CAMPAIGN
    seed = str(int.from_bytes(os.urandom(3), "little") + 1)
    with tempfile.TemporaryDirectory() as folder:
        recording = arguments.keep or Path(folder) / "campaign.mcap"
        warm = Path(folder) / "warm.mcap"
        few = ["--set", "set=clean_0", "--set", "load=8 kg", "--set", "voltage=10 V"]
        rigd("run", str(PROCEDURE), "--rig", str(RIG), *few, "--output", str(warm))
        rigd("identify", str(warm), "--json", "--no-report")
        ran, _ = rigd("run", str(PROCEDURE), "--rig", str(RIG), *chosen, "--seed", seed,
                      "--output", str(recording))  # fmt: skip
        size = recording.stat().st_size
        analysed, printed = rigd("identify", str(recording), "--json", "--no-report")
        reported, _ = rigd("identify", str(recording), "--report", str(Path(folder) / "a.html"))
        report_size = (Path(folder) / "a.html").stat().st_size
    json.loads(printed)
    share = runs / CAMPAIGN
    print(
        f"{runs} runs, seed {seed}, {size / 1e6:.0f} MB recorded\n"
        f"  simulated and recorded  {ran.wall:6.1f} s wall, {ran.cpu:6.1f} s CPU\n"
        f"  analysed from the file  {analysed.wall:6.1f} s wall, {analysed.cpu:6.1f} s CPU\n"
        f"  the same with a report  {reported.wall:6.1f} s wall, {reported.cpu:6.1f} s CPU, "
        f"{report_size / 1e6:.1f} MB"
    )
    at_most(f"{runs} runs simulated and recorded, s CPU", ran.cpu, share * TARGET_RUN_S)
    at_most(f"{runs} runs analysed from MCAP, s CPU", analysed.cpu, share * TARGET_ANALYSIS_S)
    return 0


if __name__ == "__main__":
    sys.exit(main())
