"""Defines command-line options that several commands share, and reads their values."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final, TypeVar

if TYPE_CHECKING:
    from rigd.model.about import About

#: What stands for the newest recordings: ``last``, ``last:3``.
_LAST: Final = re.compile(r"last(?::([0-9]{1,6}))?")
#: A file as the parser of its command gives it.
File = TypeVar("File", str, Path)


def add_rig(
    parser: argparse.ArgumentParser,
    help: str = "rig file, or the rig's name",
) -> None:
    """Add ``--rig``, for :func:`rig_of`."""
    parser.add_argument("--rig", metavar="RIG", help=help)


def rig_of(args: argparse.Namespace, procedure: str | None = None) -> str:
    """Return the rig of a command, and say on standard error which it is if none is given.

    ``procedure`` is the procedure that it plays.

    Raises:
        ConfigError: no rig is given or stated anywhere; see :func:`chosen_rig`.
    """
    from rigd.procedure.chosen_rig import chosen_rig

    found = chosen_rig(args.rig, procedure)
    if found.why:
        print(found.why, file=sys.stderr)
    return found.rig


def add_set(
    parser: argparse.ArgumentParser,
    help: str = "set a parameter of the procedure to another value, with its unit",
) -> None:
    """Add ``--set``, for :func:`read_assignments`."""
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help=help)


def add_runs(parser: argparse.ArgumentParser) -> None:
    """Add ``--runs``."""
    parser.add_argument(
        "--runs", type=Path, default=Path("runs"), metavar="FOLDER", help="folder of recordings"
    )


def add_json(parser: argparse.ArgumentParser, help: str = "print the result as JSON") -> None:
    """Add ``--json``."""
    parser.add_argument("--json", action="store_true", help=help)


def add_quiet(parser: argparse.ArgumentParser) -> None:
    """Add ``--quiet``."""
    parser.add_argument("--quiet", action="store_true", help="no progress")


def add_about(parser: argparse.ArgumentParser) -> None:
    """Add ``--specimen``, ``--note`` and ``--meta``, for :func:`read_about`."""
    parser.add_argument(
        "--specimen", default="", metavar="NAME", help="the specimen in the rig, such as W7"
    )
    parser.add_argument(
        "--note", default="", metavar="TEXT", help="a note, written into the recording"
    )
    parser.add_argument(
        "--meta",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="a name and a value, written into the recording, such as batch=13",
    )


def read_assignments(texts: Iterable[str], shape: str = "NAME=VALUE") -> dict[str, str]:
    """Return the values by name; for a repeated name the last value counts.

    Raises:
        ConfigError: an assignment has no ``=``, or no name before it.
    """
    from rigd.model.errors import ConfigError

    values = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals or not name.strip():
            raise ConfigError(f"{text!r} is not {shape}", hint="write 'floor=pvc', without spaces")
        values[name.strip()] = value.strip()
    return values


def named_twice(texts: Sequence[str]) -> str | None:
    """Return the first name that has two values in assignments; None if each has one."""
    names = [text.partition("=")[0].strip() for text in texts]
    return next((name for name in names if names.count(name) > 1), None)


def read_about(operator: str | None, note: str, meta: Sequence[str], specimen: str = "") -> About:
    """Return operator, ``--note``, ``--meta`` and ``--specimen`` of a run.

    Raises:
        ConfigError: an entry is too long, is not NAME=VALUE, contains control characters, or a name
            has two values.
    """
    from rigd.model.about import About
    from rigd.model.errors import ConfigError

    values = read_assignments(meta)
    if (twice := named_twice(meta)) is not None:
        raise ConfigError(
            f"--meta gives {twice} two values",
            hint=f"a name has one value: write --meta '{twice}=A, B'",
        )
    try:
        return About((operator or "").strip(), note.strip(), values, specimen.strip())
    except ValueError as error:
        raise ConfigError(
            str(error),
            hint="--operator, --specimen, --note and --meta are written into the recording as text",
        ) from error


def expanded(files: Sequence[File], runs: Path = Path("runs")) -> list[File]:
    """Return the files, and in place of each pattern those that it fits, as a Unix shell does it.

    Shells of Windows leave ``runs/*.mcap`` to the program. A pattern that fits no file stays.
    ``last`` is the newest recording in ``runs``, ``last:3`` are the three newest, oldest first.

    Raises:
        ConfigError: it is no pattern, or there are not so many recordings.
    """
    from rigd.model.errors import ConfigError

    found: list[File] = []
    for file in files:
        path = Path(file)
        fitting = newest(file, runs)
        if not path.exists() and any(mark in str(path) for mark in "*?["):
            try:
                fitting = sorted(Path(path.anchor).glob(str(path.relative_to(path.anchor))))
            except ValueError as error:
                raise ConfigError(f"{path}: {error}", hint="such as runs/*.mcap") from error
        found += [type(file)(each) for each in fitting] or [file]
    return found


def newest(file: str | Path, runs: Path = Path("runs")) -> list[Path]:
    """Return the recordings that ``last`` or ``last:N`` mean; nothing if ``file`` is another name.

    The newest is the one that was written last. A file of that name goes first.

    Raises:
        ConfigError: there are not so many recordings in ``runs``.
    """
    from rigd.model.errors import ConfigError

    match = _LAST.fullmatch(str(file))
    if match is None or Path(file).exists():
        return []
    count = int(match[1] or 1)
    written = sorted(runs.glob("*.mcap"), key=lambda path: (path.stat().st_mtime_ns, path.name))
    if not 1 <= count <= len(written):
        raise ConfigError(
            f"{file}: {len(written) or 'no'} recordings in {runs}",
            hint="`last` is the newest, `last:3` are the three newest; --runs names another folder",
        )
    return written[-count:]


def the_newest(file: Path, runs: Path = Path("runs")) -> Path:
    """Return the one recording that ``last`` means, or ``file`` itself.

    Raises:
        ConfigError: there is none, or it means several.
    """
    from rigd.model.errors import ConfigError

    found = newest(file, runs) or [file]
    if len(found) > 1:
        raise ConfigError(f"{file} are {len(found)} recordings", hint="one is needed: last")
    return found[0]


def name_recordings(args: argparse.Namespace) -> None:
    """Put files in place of patterns and of ``last`` wherever a command takes recordings.

    Raises:
        ConfigError: see :func:`expanded` and :func:`the_newest`.
    """
    runs = getattr(args, "runs", None)
    folder = runs if isinstance(runs, Path) else Path("runs")
    if isinstance(files := getattr(args, "files", None), list):
        args.files = expanded(files, folder)
    if isinstance(groups := getattr(args, "groups", None), list):  # whose patterns are one group
        args.groups = [str(path) for group in groups for path in newest(group, folder) or [group]]
    for name in ("file", "recording", "resume"):
        if isinstance(given := getattr(args, name, None), Path):
            setattr(args, name, the_newest(given, folder))


def port(text: str) -> int:
    """Return a port of TCP; 0 is any free one."""
    if text.isdecimal() and int(text) < 1 << 16:
        return int(text)
    raise argparse.ArgumentTypeError(f"{text!r} is no port: give a whole number from 0 to 65535")
