"""``rigd import``: makes recordings of the data files of other programs."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from rigd.cli.options import add_about, read_about

if TYPE_CHECKING:
    from rigd.importing import Imported

HELP = "make recordings of data of other programs: CSV, Parquet, MAT, TDMS, HDF5, MDF4"
EXAMPLES = """\
examples:
  rigd import old/*.csv --map map.yaml
  rigd import old/*.csv --map map.yaml --out imported/
  rigd import old/*.csv --map map.yaml --out W7/ --specimen W7 --meta batch=13

  The map states what the files mean: which column is which channel, in which unit, where the times
  stand, where trials begin, and what `rigd identify` shall evaluate. Each test becomes one
  recording in --out, with the name, size and sha256 of its files and the text of the map. If a
  file has a mistake, no recording is written. `rigd schema map` prints the schema of maps.
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help="data files")
    parser.add_argument(
        "--map", required=True, metavar="MAP", help="map: a file, or the name of a shipped map"
    )
    parser.add_argument(
        "--out", type=Path, default=Path("runs"), metavar="FOLDER",
        help="where to write the recordings (default: runs)",
    )  # fmt: skip
    parser.add_argument("--overwrite", action="store_true", help="replace recordings that exist")
    parser.add_argument("--operator", metavar="NAME", help="who did the tests, for the recordings")
    add_about(parser)


def execute(args: argparse.Namespace) -> int:
    """Write the recordings and print what each holds."""
    from rigd.model.machine.extras import require

    require("import", "rigd import")
    from rigd.importing import import_files, load_map

    about = read_about(args.operator, args.note, args.meta, args.specimen)
    what = load_map(args.map)
    for imported in import_files(what, args.files, args.out, overwrite=args.overwrite, about=about):
        print(_line(imported))
    return 0


def _line(imported: Imported) -> str:
    trials = "1 trial" if imported.trials == 1 else f"{imported.trials} trials"
    rows = ", ".join(
        f"{count} row{'s' * (count != 1)} of {name}" for name, count in imported.rows.items()
    )
    files = [path.name for path in imported.files]
    named = ", ".join(files) if len(files) <= 4 else f"{len(files)} files"
    return f"{imported.path}: {trials}, {rows}, from {named}"


def _count(number: int, what: str) -> str:
    return f"{number} {what}" if number == 1 else f"{number} {what}s"
