"""How large the house is, and how much of it one command walks through.

Lines and files by room, folders with many loose files, circles of imports (those inside functions
included), imports inside functions, names of constants that have several values, files that a
command enters, and what it costs a worker of the suite to collect its tests. It reads the tree in
which it stands; give another one to compare:

    python benchmarks/house.py
    python benchmarks/house.py OTHER_TREE   # that has its own .venv
"""

from __future__ import annotations

import ast
import json
import os
import resource
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import grimp
import numpy as np
from figures import noted
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

PRODUCT: Final = ("rigd", "analyses", "drivers", "sim_backend")
OTHERS: Final = ("tests", "benchmarks")
PACKAGES: Final = ("rigd", "rigd_analyses", "rigd_drivers", "rigd_sim")
#: More loose files than this in one folder are hard to survey.
LOOSE: Final = 15

#: Commands whose files are counted; each leaves what the next one needs.
WALKS: Final = {
    "run": "run constant_current --rig lugre-1 --set floor=pvc --output a.mcap --quiet",
    "identify with report": "identify a.mcap",
    "check": "check constant_current --rig lugre-1",
    "info": "info a.mcap",
}
#: Plays a command under the profiler and prints the files whose functions it entered; what runs
#: as a module is imported is none.
_ENTERED: Final = """
import contextlib, cProfile, inspect, io, json, sys
from rigd.cli.main import main
profile = cProfile.Profile()
with contextlib.redirect_stdout(io.StringIO()):
    profile.runcall(main, sys.argv[1:])
print(json.dumps(sorted({entry.code.co_filename for entry in profile.getstats()
                         if not isinstance(entry.code, str)
                         and entry.code.co_flags & inspect.CO_OPTIMIZED})))
"""


def sources(folder: Path) -> list[Path]:
    """Return the Python files below a folder."""
    return sorted(path for path in folder.rglob("*.py") if ".venv" not in path.parts)


def lines(folder: Path) -> tuple[int, int]:
    """Return the number of files and of their lines below a folder."""
    files = sources(folder)
    return len(files), sum(path.read_text("utf-8").count("\n") for path in files)


def loose(tree: Path) -> dict[str, int]:
    """Return the folders of the product with more than :data:`LOOSE` loose files."""
    counts: dict[str, int] = defaultdict(int)
    for room in PRODUCT:
        for path in sources(tree / room):
            counts[str(path.parent.relative_to(tree))] += path.name != "__init__.py"
    return {folder: count for folder, count in counts.items() if count > LOOSE}


def circles(tree: Path) -> list[list[str]]:
    """Return the sets of modules that import one another, the largest first.

    An import inside a function counts; one below ``if TYPE_CHECKING`` does not, nor does the
    front of `rigd`, whose names are imported when they are used.
    """
    sys.path[:0] = [str(tree), *(str(tree / room) for room in PRODUCT[1:])]
    graph = grimp.build_graph(*PACKAGES, exclude_type_checking_imports=True, cache_dir=None)
    modules = sorted(graph.modules - {"rigd"})
    number = {module: index for index, module in enumerate(modules)}
    arrows = np.array(
        [
            (number[module], number[imported])
            for module in modules
            for imported in graph.find_modules_directly_imported_by(module) - {"rigd"}
        ]
    )
    size = (len(modules), len(modules))
    matrix = csr_array((np.ones(len(arrows)), (arrows[:, 0], arrows[:, 1])), shape=size)
    _, labels = connected_components(matrix, connection="strong")
    found = [[modules[i] for i in np.flatnonzero(labels == label)] for label in set(labels)]
    return sorted((circle for circle in found if len(circle) > 1), key=len, reverse=True)


def late_imports(tree: Path) -> int:
    """Return how many imports of the product itself stand inside functions."""
    return sum(
        isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in PACKAGES
        for path in _product(tree)
        for function in ast.walk(ast.parse(path.read_text("utf-8")))
        if isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef)
        for node in ast.walk(function)
    )


def constants(tree: Path) -> tuple[int, dict[str, set[float]]]:
    """Return how many numbers stand at module level, and the names with three or more values."""
    values: dict[str, list[float]] = defaultdict(list)
    for path in _product(tree):
        for node in ast.parse(path.read_text("utf-8")).body:
            match node:
                case ast.AnnAssign(target=ast.Name(id=name), value=ast.Constant(value=value)):
                    pass
                case ast.Assign(targets=[ast.Name(id=name)], value=ast.Constant(value=value)):
                    pass
                case _:
                    continue
            if isinstance(value, int | float) and not isinstance(value, bool):
                values[name.lstrip("_")].append(value)
    several = {name: set(found) for name, found in values.items() if len(set(found)) > 2}
    return sum(map(len, values.values())), several


def entered(tree: Path) -> dict[str, list[str]]:
    """Return the files of the product of which each of :data:`WALKS` enters a function."""
    result = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, command in WALKS.items():
            words = [str(tree / ".venv/bin/python"), "-c", _ENTERED, *command.split()]
            done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=True)
            files = json.loads(done.stdout.splitlines()[-1])
            result[name] = [
                str(Path(file).relative_to(tree))
                for file in files
                if any(file.startswith(f"{tree / room}/") for room in PRODUCT)
            ]
    return result


def collection(tree: Path) -> tuple[float, float]:
    """Return the CPU time in s and the memory in MB that a worker takes to collect its tests."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    words = [str(tree / ".venv/bin/pytest"), "-q", "-m", "side_by_side", "--collect-only"]
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    subprocess.run(words, cwd=tree, env=environment, check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return spent, after.ru_maxrss / 1024


def _product(tree: Path) -> Iterator[Path]:
    for room in PRODUCT:
        yield from sources(tree / room)


def main() -> None:
    """Print all figures of a tree."""
    tree = Path(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).parent.parent).resolve()
    rooms = [room for top in (*PRODUCT, *OTHERS) for room in (tree / top, *_inner(tree / top))]
    for room in rooms:
        files, count = lines(room)
        print(f"{room.relative_to(tree)!s:<40} {files:5} files {count:8} lines")
    noted("lines of the product", sum(lines(tree / room)[1] for room in PRODUCT), "lines")
    noted("lines of tests", lines(tree / "tests")[1], "lines")
    for place, many in sorted(loose(tree).items(), key=lambda item: -item[1]):
        print(f"{place:<40} {many:5} loose files")
    noted("folders with more than 15 loose files", len(loose(tree)), "")
    found = circles(tree)
    for circle in found:
        print(f"circle of {len(circle)}: {', '.join(circle)}")
    noted("circles of imports", len(found), "")
    noted("imports inside functions", late_imports(tree), "")
    numbers, several = constants(tree)
    for name, values in sorted(several.items(), key=lambda item: -len(item[1])):
        print(f"{name:<20} {', '.join(f'{value:g}' for value in sorted(values))}")
    noted("numbers at module level", numbers, "")
    noted("names with three or more values", len(several), "")
    for command, names in entered(tree).items():
        noted(f"files entered by {command}", len(names), "files")
    spent, memory = collection(tree)
    noted("collection of a worker", spent, "s of CPU")
    noted("memory of a worker that has collected", memory, "MB")


def _inner(room: Path) -> Iterator[Path]:
    for package in sorted(room.iterdir()):
        if not package.is_dir() or not any(package.rglob("*.py")):
            continue
        yield package
        if package.name in PACKAGES:
            yield from (p for p in sorted(package.iterdir()) if p.is_dir() and any(p.rglob("*.py")))


if __name__ == "__main__":
    main()
