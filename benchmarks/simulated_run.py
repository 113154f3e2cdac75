"""A whole simulated run, engine, interlocks, plant and recording, against real time at 1 kHz.

The baseline is the rig's own time: seconds of rig time per second of wall and of CPU, measured
from the first cycle to the closed file, kernels compiled beforehand.
"""

from __future__ import annotations

import os
import statistics
import tempfile
import time
from pathlib import Path

from figures import at_least, noted

from rigd.config.loader import load_rig
from rigd.daemon.execute import RunRequest, execute
from rigd.procedure.compile import compile_procedure
from rigd.procedure.loader import load_procedure

ROUNDS = 5


def one_run(name: str, folder: Path, seed: int, overrides: dict[str, str]) -> tuple[float, ...]:
    """Return rig time, wall time and CPU time (all threads) in s, and the file's size in bytes."""
    rig = load_rig("lugre-1")
    source = load_procedure(name)
    procedure = compile_procedure(source, rig, overrides)
    path = folder / f"{seed}.mcap"
    request = RunRequest(procedure, source.file.text, rig, seed, output=path)
    wall, cpu = time.perf_counter(), time.process_time()
    recorded = execute(request)
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    return recorded.result.run_s, wall, cpu, path.stat().st_size


def main() -> None:
    """Run the paper's sweep several times with fresh seeds."""
    with tempfile.TemporaryDirectory() as folder:
        one_run("quick", Path(folder), 0, {})
        rows = []
        for _ in range(ROUNDS):
            seed = int.from_bytes(os.urandom(3), "little") + 1
            rig_s, wall, cpu, size = one_run(
                "constant_current", Path(folder), seed, {"floor": "pvc"}
            )
            rows.append((rig_s / wall, rig_s / cpu))
            print(
                f"{rig_s:6.1f} s of rig time in {wall:5.2f} s wall, {cpu:5.2f} s CPU: "
                f"{rig_s / wall:5.1f} x, {1e3 * cpu / rig_s:5.1f} us CPU a cycle, "
                f"{size / 1e6:.1f} MB"
            )
    at_least("simulated run, rig time / wall time", statistics.median(r[0] for r in rows), 20)
    cpu_ms = 1e3 / statistics.median(r[1] for r in rows)
    noted("simulated run, CPU time of a second of the rig", cpu_ms, "ms")


if __name__ == "__main__":
    main()
