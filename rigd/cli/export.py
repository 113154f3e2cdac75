"""``rigd export``: writes recordings as tables for other programs."""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rigd.record import Recording

HELP = "export recordings to Parquet, CSV or MATLAB files"
EXAMPLES = """\
examples:
  rigd export runs/20261121-080000-quick.mcap --to parquet
  rigd export FILE --to csv --stream carriage --stream wheel_servo --output tables/
  rigd export FILE --to mat
  rigd export FILE --to csv --joined 100
  rigd export runs/*.mcap --to parquet --output tables/

  One table per stream, with t_ns (UTC), time (s), trial (-1 outside trials), trial_time (s since
  the trial began), step and a column per channel; one table of the events; one of the trials with
  their parameters and what the procedure measures (measure_NAME, in SI).
  --joined puts all streams into one table. Each of several files gets a folder of its own; if
  two have the same name, the folders of the recordings are kept: tables/monday/run.
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help="recordings")
    parser.add_argument("--to", choices=("parquet", "csv", "mat"), required=True, help="format")
    parser.add_argument(
        "--stream", action="append", metavar="NAME", help="only this stream (default: all streams)"
    )
    parser.add_argument(
        "--joined",
        type=_rate,
        metavar="RATE",
        help="one table of all streams at RATE, such as 100 or '100 Hz': each value is the "
        "last sample at or before that time; a gap has no value",
    )
    parser.add_argument(
        "--output",
        type=Path,
        metavar="FOLDER",
        help=("default: a folder with the recording's name"),
    )
    parser.add_argument("--overwrite", action="store_true", help="replace files that exist")


def execute(args: argparse.Namespace) -> int:
    """Write the tables and print their names."""
    from rigd.model.extras import require

    require("analysis", "rigd export")
    from rigd.model.errors import ConfigError
    from rigd.record import Recording, run_info
    from rigd.record.export import export

    files: list[Path] = list(dict.fromkeys(args.files))
    folders = [args.output or file.with_suffix("") for file in files]
    if args.output and len(files) > 1:
        folders = [args.output / name for name in _names(files)]
    if len(set(folders)) < len(folders):
        raise ConfigError(
            "two of the recordings would be written to the same folder",
            hint="export them separately, each with its own --output",
        )
    for file, folder in zip(files, folders, strict=True):
        recording = Recording.open(file)
        written = export(
            recording,
            folder,
            args.to,
            streams=args.stream,
            joined_hz=args.joined,
            overwrite=args.overwrite,
            measures=_measures(recording),
        )
        for path in written:
            print(path)
        for loss in run_info(recording).losses:
            print(f"warning: {loss}", file=sys.stderr)
    return 0


def _measures(recording: Recording) -> dict[str, tuple[str, dict[int, float]]]:
    """Return what the procedure of a recording measures; nothing if that cannot be read."""
    from rigd.analysis.measures import measured_if_any
    from rigd.analysis.measures.view import trial_columns
    from rigd.model.errors import RigdError

    try:
        result = measured_if_any(recording)
    except RigdError as error:
        print(f"warning: no measures in the table of the trials: {error.message}", file=sys.stderr)
        return {}
    return {} if result is None else trial_columns(result)


def _names(files: list[Path]) -> list[Path]:
    """Return a folder for each file: its name; for files of one name, their folders and name."""
    named = [file.stem for file in files]
    if len(set(named)) == len(named):
        return [Path(name) for name in named]
    full = [file.resolve().with_suffix("") for file in files]
    common = Path(os.path.commonpath([path.parent for path in full]))
    return [path.relative_to(common) for path in full]


def _rate(text: str) -> float:
    from rigd.model.units import parse_quantity, parse_unit

    try:
        rate = parse_quantity(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error
    if rate.unit.dimension not in (parse_unit("1").dimension, parse_unit("Hz").dimension):
        raise argparse.ArgumentTypeError(f"{text!r} is not a rate: give it in Hz, such as 100")
    if rate.value <= 0:
        raise argparse.ArgumentTypeError(f"{text!r} is not a rate: it must be above 0")
    return rate.value
