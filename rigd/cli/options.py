"""Defines command-line options that several commands share, and reads their values."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from rigd.model.about import About

#: A file as the parser of its command gives it.
File = TypeVar("File", str, Path)


def add_rig(
    parser: argparse.ArgumentParser,
    help: str = "rig file, or the rig's name",
    *,
    required: bool = True,
) -> None:
    """Add ``--rig``."""
    parser.add_argument("--rig", required=required, metavar="RIG", help=help)


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


def expanded(files: Sequence[File]) -> list[File]:
    """Return the files, and in place of each pattern those that it fits, as a Unix shell does it.

    Shells of Windows leave ``runs/*.mcap`` to the program. A pattern that fits no file stays.

    Raises:
        ConfigError: it is no pattern.
    """
    from rigd.model.errors import ConfigError

    found: list[File] = []
    for file in files:
        path = Path(file)
        fitting: list[Path] = []
        if not path.exists() and any(mark in str(path) for mark in "*?["):
            try:
                fitting = sorted(Path(path.anchor).glob(str(path.relative_to(path.anchor))))
            except ValueError as error:
                raise ConfigError(f"{path}: {error}", hint="such as runs/*.mcap") from error
        found += [type(file)(each) for each in fitting] or [file]
    return found
