"""Start-up of the command line against the bare interpreter: `rigd --help`, `rigd check`.

Whole processes, interleaved; the minimum of many runs is the figure that a busy machine spoils
least.
"""

from __future__ import annotations

import statistics
import subprocess
import sys
import time
from pathlib import Path

from figures import at_most, noted

ROOT = Path(__file__).parent.parent
ROUNDS = 15
COMMANDS = {
    "python -c pass": ["-c", "pass"],
    "rigd --help": ["-m", "rigd", "--help"],
    "rigd check": ["-m", "rigd", "check", "constant_current", "--rig", "lugre-1"],
}


def wall_ms(arguments: list[str]) -> float:
    """Return the wall time of one process in ms."""
    start = time.perf_counter()
    subprocess.run([sys.executable, *arguments], check=True, cwd=ROOT, stdout=subprocess.DEVNULL)
    return 1e3 * (time.perf_counter() - start)


def main() -> None:
    """Time all commands in turn and print their figures."""
    times: dict[str, list[float]] = {name: [] for name in COMMANDS}
    for _ in range(ROUNDS):
        for name, arguments in COMMANDS.items():
            times[name].append(wall_ms(arguments))
    for name, values in times.items():
        print(f"{name:<16} min {min(values):6.1f} ms  median {statistics.median(values):6.1f} ms")
    bare = min(times["python -c pass"])
    at_most("rigd --help", min(times["rigd --help"]), 150, "ms")
    noted("rigd --help / python -c pass", min(times["rigd --help"]) / bare, "x")
    noted("rigd check / python -c pass", min(times["rigd check"]) / bare, "x")


if __name__ == "__main__":
    main()
