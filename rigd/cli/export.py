"""``rigd export``: writes recordings for other programs."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rigd.record import Recording
    from rigd.record.export import Format
    from rigd.record.joined import TimeBase

HELP = "export recordings for other programs: Parquet, CSV, MATLAB, HDF5, ASAM MDF 4"
EXAMPLES = """\
examples:
  rigd export runs/20261121-080000-quick.mcap --to parquet
  rigd export FILE --to csv --stream carriage --stream wheel_servo --output tables/
  rigd export FILE --to mat
  rigd export FILE --to hdf5                          all tables in FILE.h5
  rigd export FILE --to mdf4 --output quick.mf4       for ASAM tools, such as asammdf
  rigd export FILE --to csv --rate "100 Hz"           all streams in one table
  rigd export FILE --to csv --on carriage --between linear
  rigd export runs/*.mcap --to parquet --output tables/

  One table per stream, with t_ns (UTC), time (s), trial (-1 outside trials), trial_time (s since
  the trial began), step and a column per channel, the numbers as recorded, in SI; one of the
  events; one of the trials with their parameters and what the procedure measures (measure_NAME);
  one of the steps as they were played. hdf5 and mdf4 have all tables in one file.
  --rate or --on puts all streams into one table. A gap stays one, and nothing is extrapolated.
  Each of several files gets a folder of its own; if two have the same name, the folders of the
  recordings are kept: tables/monday/run. Of a damaged file, what is intact is exported, and
  what is lost is named.
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help="recordings")
    parser.add_argument(
        "--to", choices=("parquet", "csv", "mat", "hdf5", "mdf4"), required=True, help="format"
    )
    parser.add_argument(
        "--stream", action="append", metavar="NAME", help="only this stream (default: all streams)"
    )
    times = parser.add_mutually_exclusive_group()
    times.add_argument(
        "--rate",
        "--joined",
        type=_rate,
        metavar="RATE",
        help="one table of all streams at RATE, such as 100 or '100 Hz'",
    )
    times.add_argument(
        "--on",
        metavar="STREAM",
        help="one table of all streams at the times of the samples of STREAM (or of a channel of "
        "it: carriage.position)",
    )
    parser.add_argument(
        "--between",
        choices=("last", "linear"),
        help="value of a joined table between two samples: the last sample (default), or on the "
        "straight line to the next",
    )
    parser.add_argument(
        "--output",
        type=Path,
        metavar="PATH",
        help="folder of the tables (default: one with the recording's name); "
        "for hdf5 and mdf4 a folder, or the file",
    )
    parser.add_argument("--overwrite", action="store_true", help="replace files that exist")


def execute(args: argparse.Namespace) -> int:
    """Write the tables and print their names."""
    from rigd.model.extras import require

    require("analysis", "rigd export")
    if args.to in ("hdf5", "mdf4"):
        require("export", f"rigd export --to {args.to}")
    from rigd.model.errors import ConfigError
    from rigd.record import Recording, run_info
    from rigd.record.export import export

    if args.between and args.rate is None and args.on is None:
        raise ConfigError(
            "--between is for one table of all streams",
            hint="give --rate RATE or --on STREAM, too",
        )
    files: list[Path] = list(dict.fromkeys(args.files))
    targets = _targets(files, args.output, args.to)
    for file, target in zip(files, targets, strict=True):
        recording = Recording.open(file, partial=True)
        written = export(
            recording,
            target,
            args.to,
            streams=args.stream,
            base=_base(recording, args),
            overwrite=args.overwrite,
            measures=_measures(recording),
        )
        for path in written:
            print(path)
        for loss in run_info(recording).losses:
            print(f"warning: {loss}", file=sys.stderr)
    return 0


def _targets(files: Sequence[Path], output: Path | None, to: Format) -> list[Path]:
    """Return the folder, or the file, that each recording is exported to.

    Raises:
        ConfigError: two are the same.
    """
    from rigd.model.errors import ConfigError
    from rigd.record.export import FORMATS

    kind = FORMATS[to]
    if output is None:
        targets = [file.with_suffix("") for file in files]
    elif len(files) > 1:
        targets = [output / name for name in _names(files)]
    elif kind.together and output.suffix.lower() not in kind.suffixes:
        targets = [output / files[0].stem]
    else:
        targets = [output]
    if kind.together:
        targets = [
            target
            if target.suffix.lower() in kind.suffixes
            else target.with_name(target.name + kind.suffixes[0])
            for target in targets
        ]
    if len(set(targets)) < len(targets):
        raise ConfigError(
            "two of the recordings would be written to the same place",
            hint="export them separately, each with its own --output",
        )
    return targets


def _base(recording: Recording, args: argparse.Namespace) -> TimeBase | None:
    """Return the times of a joined table; None if none is asked for.

    Raises:
        RecordingError: there is no such stream or channel.
    """
    from rigd.model.errors import RecordingError
    from rigd.record.joined import Between, TimeBase

    between: Between = args.between or "last"
    if args.rate is not None:
        return TimeBase(rate_hz=args.rate, between=between)
    if args.on is None:
        return None
    if args.on in recording.streams:
        return TimeBase(stream=args.on, between=between)
    stream, _, channel = args.on.rpartition(".")
    known = recording.streams.get(stream)
    if known is None or channel not in [each.name for each in known.channels]:
        raise RecordingError(
            f"{recording.path} has no stream or channel {args.on!r}",
            hint=f"It has the streams {sorted(recording.streams)}.",
        )
    return TimeBase(stream=stream, between=between)


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


def _names(files: Sequence[Path]) -> list[Path]:
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
