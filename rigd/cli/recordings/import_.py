"""``rigd import``: makes recordings of the data files of other programs."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from rigd.cli.options import add_about, read_about
from rigd.model.errors import ConfigError, RecordingError

if TYPE_CHECKING:
    from rigd.importing import Imported

HELP = "make recordings of data of other programs: CSV, Parquet, MAT, TDMS, HDF5, MDF4"
EXAMPLES = """\
examples:
  rigd import old/*.csv --propose
  rigd import old/*.csv --map map.yaml
  rigd import old/*.csv --map map.yaml --out imported/
  rigd import old/*.csv --map map.yaml --out W7/ --specimen W7 --meta batch=13

  The map states what the files mean: which column is which channel, in which unit, where the times
  stand, where trials begin, and what `rigd identify` shall evaluate. Each test becomes one
  recording in --out, with the name, size and sha256 of its files and the text of the map. If a
  file has a mistake, no recording is written. `rigd schema map` prints the schema of maps.

  --propose writes a map from what stands in the files. What they do not show, such as units, is a
  line to fill in, with the reason.
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help="data files")
    parser.add_argument("--map", metavar="MAP", help="map: a file, or the name of a shipped map")
    parser.add_argument(
        "--propose", action="store_true",
        help="import nothing: write a map for the files, to --map or the current folder",
    )  # fmt: skip
    parser.add_argument(
        "--out", type=Path, default=Path("runs"), metavar="FOLDER",
        help="where to write the recordings (default: runs)",
    )  # fmt: skip
    parser.add_argument("--overwrite", action="store_true", help="replace recordings that exist")
    parser.add_argument("--operator", metavar="NAME", help="who did the tests, for the recordings")
    add_about(parser)


def execute(args: argparse.Namespace) -> int:
    """Write the recordings and print what each holds; or write a map."""
    from rigd.model.machine.extras import require

    require("import", "rigd import")
    if args.propose:
        return _propose(args)
    if args.map is None:
        raise ConfigError("--map is missing", hint="`--propose` writes a map for the files")
    from rigd.importing import import_files, load_map

    about = read_about(args.operator, args.note, args.meta, args.specimen)
    what = load_map(args.map)
    for imported in import_files(what, args.files, args.out, overwrite=args.overwrite, about=about):
        print(_line(imported))
    return 0


def _propose(args: argparse.Namespace) -> int:
    """Write a map for the files; never over another file."""
    from rigd.importing import propose

    for name in ("overwrite", "operator", "note", "meta", "specimen"):
        if getattr(args, name):
            raise ConfigError(f"--{name} is not for --propose, which imports nothing")
    proposal = propose(args.files)
    path = Path(args.map or f"{proposal.name}.yaml")
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(proposal.text)
    except FileExistsError as error:
        raise ConfigError(
            f"there is a file {path} already", hint="name another by --map"
        ) from error
    except OSError as error:
        raise RecordingError(f"cannot write {path}: {error.strerror}") from error
    lines = ", ".join(map(str, proposal.blanks))
    print(f"{path}: {f'to fill in: lines {lines}' if lines else 'nothing is left to fill in'}")
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
