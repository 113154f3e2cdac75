"""Checking 100 procedure files against a rig: in one process, and with the interpreter's start.

The files are the shipped procedures under other names, each read, parsed, bound and compiled for
every trial of its sweep. The rig is loaded once, as `rigd check FILE... --rig NAME` does.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

from figures import at_most, noted

from rigd.config.loader import load_rig
from rigd.procedure.compile import compile_procedure
from rigd.procedure.loader import load_procedure
from rigd.sdk.shipped_files import shipped_folder

FILES = 100
ROUNDS = 5
#: What would make every check slow if it were loaded.
HEAVY = ("numpy", "numba", "scipy", "matplotlib", "pyarrow")


def write_files(folder: Path) -> list[Path]:
    """Write the shipped procedures under new names until there are :data:`FILES`."""
    shipped = sorted(shipped_folder("procedures").glob("*.yaml"))
    paths = []
    for number in range(FILES):
        source = shipped[number % len(shipped)]
        path = folder / f"p{number:03}.yaml"
        text = source.read_text().replace("\nprocedure: ", f"\nprocedure: n{number:03}_", 1)
        path.write_text(text)
        paths.append(path)
    return paths


def check(folder: Path) -> tuple[float, float, int]:
    """Return the seconds for the rig and for the procedures of ``folder``, and the trials."""
    start = time.perf_counter()
    rig = load_rig("lugre-1")
    loaded = time.perf_counter()
    paths = sorted(folder.glob("p*.yaml"))
    trials = sum(len(compile_procedure(load_procedure(path), rig).trials) for path in paths)
    return loaded - start, time.perf_counter() - loaded, trials


def main() -> None:
    """Check all files a few times in this process, and in processes of their own."""
    if len(sys.argv) > 1:
        check(Path(sys.argv[1]))
        return
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        size = sum(path.stat().st_size for path in write_files(folder))
        inside, whole = [], []
        for _ in range(ROUNDS):
            rig_s, files_s, trials = check(folder)
            inside.append(files_s)
            start = time.perf_counter()
            subprocess.run([sys.executable, __file__, name], check=True)
            whole.append(time.perf_counter() - start)
    loaded = [module for module in HEAVY if module in sys.modules]
    print(f"{FILES} files, {size / FILES / 1024:.1f} KiB and {trials / FILES:.1f} trials each; "
          f"rig file {1e3 * rig_s:.0f} ms; heavy modules loaded: {loaded or 'none'}")  # fmt: skip
    at_most(f"check {FILES} procedures, in process", min(inside), 1.0, "s")
    noted(f"check {FILES} procedures, with start of the interpreter", min(whole), "s")
    noted("check one procedure", 1e3 * min(inside) / FILES, "ms")


if __name__ == "__main__":
    main()
