"""The first rig of the demo: runs it on three floors, and shows what is found beside what is known.

``demo_floors.py FOLDER`` writes recordings, report, picture and page to FOLDER.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from ruamel.yaml import YAML

import rigd

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # twice as fast as with two

ROOT: Final = Path(__file__).resolve().parents[1]
PROCEDURE: Final = ROOT / "procedures" / "constant_current.yaml"
LOOPS: Final = ROOT / "scripts" / "demo_loops.yaml"
RIG: Final = ROOT / "configs" / "sim_lugre.yaml"
#: In the order of the table; what each is.
WORDS: Final = {
    "mu_s": "static friction",
    "mu_c": "Coulomb friction",
    "V_s": "Stribeck speed",
    "sigma_0": "bristle stiffness",
    "sigma_1": "bristle damping",
    "sigma_2": "viscous friction",
}


def main(folder: Path) -> None:
    """Show what is known, run, identify, and show what was found."""
    published = known()
    for floor in published:
        show(f"  rigd run constant_current --rig lugre-1 --set floor={floor}")
        rigd.run(PROCEDURE, rig=RIG, out=folder / f"{floor}.mcap", set={"floor": floor})
    show("  rigd run scripts/demo_loops.yaml --rig lugre-1   (a test that the fit does not see)")
    rigd.run(LOOPS, rig=RIG, out=folder / "loops.mcap")
    show(f"  rigd identify {' '.join(f'{floor}.mcap' for floor in published)}")
    result = rigd.identify([folder / f"{floor}.mcap" for floor in published])
    result.report(folder / "report.html")
    rows = compared(result, published)
    show()
    for row in rows:
        show("  " + "  ".join(row))

    import demo_picture  # matplotlib takes its time

    demo_picture.write(result, published, rows, folder)


def known() -> Mapping[str, Mapping[str, str]]:
    """Show Table I of the paper and return it: the parameters of each floor, with units."""
    file: Any = YAML(typ="safe").load(PROCEDURE)
    table: Mapping[str, Mapping[str, str]] = file["identify"]["reference"]["values"]
    show(f"  {'':34}" + "".join(f"{floor:>16}" for floor in table))
    for name, words in WORDS.items():
        row = "".join(f"{values[name]!s:>16}" for values in table.values())
        show(f"  {name:8} {words:25}{row}")
    show()
    return table


def compared(
    result: rigd.Result, published: Mapping[str, Mapping[str, str]]
) -> list[tuple[str, ...]]:
    """Return the rows of a table: floor, parameter, published, found, its 95 % interval."""
    rows = []
    for floor in published:
        for name in WORDS:
            item = result[floor, name]
            known_value, _, unit = str(published[floor][name]).partition(" ")
            if item.value is None or item.low is None or item.high is None:
                outcome = ("not determined by these tests", "")
            else:
                outcome = (f"{item.value:.4g}", f"{item.low:.4g} to {item.high:.4g}")
            rows.append((floor, name, f"{float(known_value):g}", *outcome, unit))
    heads = ("floor", "", "published", "found", "95 % interval", "unit")
    widths = [max(len(row[i]) for row in (heads, *rows)) for i in range(len(heads))]
    return [
        tuple(text.ljust(width) for text, width in zip(row, widths, strict=True))
        for row in (heads, *rows)
    ]


def show(line: str = "") -> None:
    """Print a line at once."""
    sys.stdout.write(line.rstrip() + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
