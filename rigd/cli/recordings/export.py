"""``rigd export``: writes recordings for other programs."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rigd.config.lab.publication import Author, Publication
    from rigd.record import Recording, RunInfo
    from rigd.record.export import Format
    from rigd.record.read.joined_table import TimeBase

HELP = "export recordings for other programs or publication: Parquet, CSV, MATLAB, HDF5, RO-Crate"
EXAMPLES = """\
examples:
  rigd export runs/20261121-080000-quick.mcap --to parquet
  rigd export FILE --to csv --stream carriage --stream wheel_servo --output tables/
  rigd export FILE --to mat --trials 7,12-15          only the rows of these trials
  rigd export FILE --to hdf5                          all tables in FILE.h5
  rigd export FILE --to mdf4 --output quick.mf4       for ASAM tools, such as asammdf
  rigd export FILE --to csv --rate "100 Hz"           all streams in one table
  rigd export FILE --to csv --on carriage --between linear
  rigd export runs/*.mcap --to parquet --output tables/
  rigd export FILE --to csv --derived friction.yaml   with channels computed from others
  rigd export FILE --to rocrate --license CC-BY-4.0 --author "Ada Lovelace"

  One table per stream, with t_ns (UTC), time (s), trial (-1 outside trials), trial_time (s since
  the trial began), step and a column per channel, the numbers as recorded, in SI; one of the
  events; one of the trials with their parameters and what the procedure measures (measure_NAME);
  one of the steps as they were played. hdf5 and mdf4 have all tables in one file.
  --trials takes the rows of these trials alone, none between them.
  --rate or --on puts all streams into one table. A gap stays one, and nothing is extrapolated.
  rocrate makes one RO-Crate of all FILEs, a zip file or a folder, to be published with a DOI:
  recordings, procedures, rigs, calibrations, tables, and who made them with what. It needs a
  licence, and authors if no operator is stated; `publication:` in the file of the lab states both.
  Each of several files gets a folder of its own; if two have the same name, the folders of the
  recordings are kept: tables/monday/run. Of a damaged file, what is intact is exported, and
  what is lost is named.
"""


#: Options that only a crate has.
_OF_CRATES = (
    "license", "author", "title", "description", "publisher", "keyword", "doi", "lab", "tables",
)  # fmt: skip


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help="recordings")
    parser.add_argument(
        "--to",
        choices=("parquet", "csv", "mat", "hdf5", "mdf4", "rocrate"),
        required=True,
        help="format",
    )
    parser.add_argument(
        "--stream", action="append", metavar="NAME", help="only this stream (default: all streams)"
    )
    parser.add_argument(
        "--trials", metavar="LIST", help="only these trials, such as 1,4,7-9 (default: all rows)"
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
        "for hdf5 and mdf4 a folder, or the file; for rocrate a folder, or a file .zip",
    )
    parser.add_argument(
        "--derived",
        type=Path,
        metavar="FILE",
        help="also the channels below `derived:` in this file: a procedure, a map, a rig, or a "
        "file of these alone",
    )
    parser.add_argument("--overwrite", action="store_true", help="replace files that exist")
    crate = parser.add_argument_group("rocrate")
    crate.add_argument(
        "--license", metavar="LICENSE", help="such as CC-BY-4.0, or the address of its text"
    )
    crate.add_argument(
        "--author",
        action="append",
        metavar="'NAME ORCID'",
        help="an author, with the ORCID iD if there is one (default: those of the lab, or the "
        "operators)",
    )
    crate.add_argument("--title", metavar="TEXT", help="title (default: that of the procedure)")
    crate.add_argument("--description", metavar="TEXT", help="what the data are")
    crate.add_argument("--publisher", metavar="NAME", help="who publishes the data")
    crate.add_argument("--keyword", action="append", metavar="WORD", help="a word to find it by")
    crate.add_argument("--doi", metavar="DOI", help="a DOI that is reserved for the data")
    crate.add_argument(
        "--lab", type=Path, metavar="FILE", help="file of the lab, with what holds for all its data"
    )
    crate.add_argument(
        "--tables", choices=("csv", "parquet"), help="format of the tables (default: csv)"
    )


def execute(args: argparse.Namespace) -> int:
    """Write the tables and print their names."""
    from rigd.model.machine.extras import require

    require("analysis", "rigd export")
    if args.to != "mat":
        require("export", f"rigd export --to {args.to}")
    from rigd.analysis.recordings.corrections import with_derived_of
    from rigd.analysis.run_page import Selection, parse_selection
    from rigd.config.document import read_document
    from rigd.model.errors import ConfigError
    from rigd.procedure.loader import load_procedure
    from rigd.record import Recording
    from rigd.record.export import export
    from rigd.record.read.derived import sources_in

    if args.between and args.rate is None and args.on is None:
        raise ConfigError(
            "--between is for one table of all streams",
            hint="give --rate RATE or --on STREAM, too",
        )
    files: list[Path] = list(dict.fromkeys(args.files))
    if args.to == "rocrate":
        return _publish(args, files)
    for name in _OF_CRATES:
        if getattr(args, name) is not None:
            raise ConfigError(f"--{name} is for --to rocrate")
    targets = _targets(files, args.output, args.to)
    selection = Selection() if args.trials is None else parse_selection(args.trials)
    derived = None if args.derived is None else read_document(args.derived)
    is_procedure = derived is not None and derived.get(("procedure",)) is not None
    procedure = load_procedure(args.derived) if is_procedure else None
    for file, target in zip(files, targets, strict=True):
        recording = Recording.open(file, partial=True)
        if procedure is not None:
            recording = with_derived_of(recording, procedure)
        elif derived is not None:
            recording = recording.with_channels(derived, sources_in(derived))
        info = recording.info
        selection.check(info)
        _require_columns(info)
        written = export(
            recording,
            target,
            args.to,
            streams=args.stream,
            base=_base(recording, args),
            trials=selection.numbers,
            overwrite=args.overwrite,
            measures=_measures(recording),
        )
        for path in written:
            print(path)
        for loss in info.losses:
            print(f"warning: {loss}", file=sys.stderr)
        if info.topics and args.stream is None:
            print(
                f"warning: {file}: not exported, because rigd cannot read them as columns: "
                f"{', '.join(map(str, info.topics))}",
                file=sys.stderr,
            )
    return 0


def _require_columns(info: RunInfo) -> None:
    """Refuse a file of another program that has messages, but none that rigd reads.

    Raises:
        RecordingError: it would give empty tables.
    """
    from rigd.model.errors import RecordingError
    from rigd.record.read.info import NO_RUN

    topics = [str(topic) for topic in info.topics if topic.messages]
    if topics and not any(stream.rows for stream in info.streams) and info.state == NO_RUN:
        raise RecordingError(
            f"{info.path} has no topic that rigd reads as columns: {', '.join(topics)}",
            hint="rigd reads JSON, and CDR messages of the schema encoding ros2msg.",
        )


def _publish(args: argparse.Namespace, files: Sequence[Path]) -> int:
    """Write a crate of all recordings and print its name.

    Raises:
        ConfigError: an option is for tables, or what a publication needs is missing or wrong.
        RecordingError: see :func:`rigd.record.export.rocrate.export_rocrate`.
    """
    from rigd.model.errors import ConfigError
    from rigd.record import Recording
    from rigd.record.export.rocrate import Published, export_rocrate

    for name in ("stream", "trials", "rate", "on", "between", "derived"):
        if getattr(args, name) is not None:
            raise ConfigError(f"--{name} is not for --to rocrate, which has all that was recorded")
    recordings = [Recording.open(file, partial=True) for file in files]
    publication = _publication(args, recordings)
    name = files[0].stem if len(files) == 1 else "recordings"
    target: Path = args.output or files[0].with_name(f"{name}.crate.zip")
    sources = [Published(recording, _measures(recording)) for recording in recordings]
    written = export_rocrate(
        sources, target, publication, tables=args.tables or "csv", overwrite=args.overwrite
    )
    print(written)
    return 0


def _publication(args: argparse.Namespace, recordings: Sequence[Recording]) -> Publication:
    """Return what the options, the lab and the recordings state of the data.

    Raises:
        ConfigError: licence or authors are missing, or something is wrong.
    """
    from rigd.config.lab.lab import load_lab
    from rigd.config.lab.publication import LICENSES, Author, Publication, PublicationSource
    from rigd.model.errors import ConfigError
    from rigd.record.export.rocrate import operators_of

    lab = PublicationSource() if args.lab is None else load_lab(args.lab).publication
    license = args.license or lab.license
    if not license:
        raise ConfigError(
            "data without a licence can be used by nobody",
            hint=f"give --license, such as {next(iter(LICENSES))} or CC-BY-4.0, or --lab with "
            "`publication: {license: CC-BY-4.0}`",
        )
    try:
        authors = [_author(text) for text in args.author or ()]
        authors = authors or [author.author() for author in lab.authors]
        authors = authors or [Author(name) for name in operators_of(recordings)]
        if not authors:
            raise ConfigError(
                "a publication has authors, and the recordings state no operator",
                hint='give --author "Ada Lovelace 0000-0002-1825-0097"',
            )
        return Publication(
            license,
            args.title or "",
            args.description or "",
            tuple(authors),
            args.publisher or lab.publisher or "",
            tuple(args.keyword or lab.keywords),
            args.doi or "",
        )
    except ValueError as error:
        raise ConfigError(str(error)) from error


def _author(text: str) -> Author:
    """Return the author of ``NAME ORCID``; the ORCID iD may be left out.

    Raises:
        ValueError: the ORCID iD is wrong, or there is no name.
    """
    from rigd.config.lab.publication import Author

    name, _, last = text.strip().rpartition(" ")
    if name and any(letter.isdigit() for letter in last):
        return Author(name.strip(), last.strip("<>()"))
    return Author(text.strip())


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
    from rigd.record.read.joined_table import Between, TimeBase

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
