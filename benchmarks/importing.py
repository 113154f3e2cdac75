"""Import of a CSV file against pyarrow, which only reads it: wall and CPU time, and memory.

The file has a time in ns and four columns of numbers with all their digits, as a logger of doubles
writes it. Each round reads it once with pyarrow, into memory, and imports it once to a recording on
disk, each in a process of its own; both count from after the imports of modules. The ratio is that
of the best rounds. On a busy machine the ratio of the CPU times says more.

    python benchmarks/importing.py [--size 1e9] [--rounds 3]
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
from figures import at_most, noted

ROWS: Final = 200_000
MAP: Final = """\
map: bench
rig: bench
sources:
  samples:
    time: {column: t_ns, unit: ns, since: 1970-01-01}
    channels:
      force: {column: force, unit: N}
      speed: {column: speed, unit: m/s}
      position: {column: position, unit: m}
      current: {column: current, unit: A}
"""


def write(path: Path, size: float) -> None:
    """Write a file of at least ``size`` bytes."""
    rng, done = np.random.default_rng(1), 0
    with path.open("wb") as file:
        file.write(b"t_ns,force,speed,position,current\n")
        while file.tell() < size:
            times = np.arange(done, done + ROWS) * 1_000_000 + 1_500_000_000_000_000_000
            columns = [times, *(rng.normal(size=ROWS) for _ in range(4))]
            table = pa.table(columns, names=list("abcde"))
            pa_csv.write_csv(table, file, pa_csv.WriteOptions(include_header=False))
            done += ROWS


def read(path: Path) -> None:
    """Read the file with pyarrow, as `rigd import` is measured against it."""
    began, cpu = time.perf_counter(), time.process_time()
    rows = pa_csv.read_csv(path).num_rows
    _report(began, cpu, rows)


def bring_in(path: Path) -> None:
    """Import the file."""
    from rigd.importing import import_files, parse_map
    from rigd.importing.source import TextTableSource
    from rigd.importing.tables.csv_table import CsvTable  # what a first file loads besides

    CsvTable(path, TextTableSource())
    what = parse_map(MAP, Path("map.yaml"))
    began, cpu = time.perf_counter(), time.process_time()
    (made,) = import_files(what, [path], path.parent / "runs", overwrite=True)
    _report(began, cpu, made.rows["samples"])


def _report(began: float, cpu: float, rows: int) -> None:
    usage = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    spent = {"wall": time.perf_counter() - began, "cpu": time.process_time() - cpu}
    print(json.dumps({**spent, "rows": rows, "memory": usage}))


def _measured(what: str, path: Path) -> dict[str, float]:
    done = subprocess.run(
        [sys.executable, __file__, what, str(path)], check=True, capture_output=True, text=True
    )
    found: dict[str, float] = json.loads(done.stdout)
    return found


def main() -> None:
    """Measure both, interleaved."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", type=float, default=1e9, help="bytes of the file")
    parser.add_argument("--rounds", type=int, default=3)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "old.csv"
        write(path, args.size)
        best: dict[str, dict[str, float]] = {}
        for _ in range(args.rounds):
            for what in ("pyarrow", "import"):
                found = _measured(what, path)
                print(f"{what:<8} {found['wall']:6.2f} s wall, {found['cpu']:6.2f} s CPU, "
                      f"{found['memory'] / 1e6:6.0f} MB")  # fmt: skip
                old = best.get(what, found)
                best[what] = {key: min(value, old[key]) for key, value in found.items()}
        ours, theirs = best["import"], best["pyarrow"]
        noted("size of the file", path.stat().st_size / 1e6, "MB")
        at_most("import / pyarrow's read, wall", ours["wall"] / theirs["wall"], 2.0)
        noted("import / pyarrow's read, CPU", ours["cpu"] / theirs["cpu"], "x")
        at_most("memory of an import", ours["memory"] / 1e6, 500, "MB")


if __name__ == "__main__":
    if sys.argv[1:2] == ["pyarrow"]:
        read(Path(sys.argv[2]))
    elif sys.argv[1:2] == ["import"]:
        bring_in(Path(sys.argv[2]))
    else:
        main()
