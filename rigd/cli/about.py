"""Options that describe a run: ``--operator``, ``--note``, ``--meta``."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rigd.model.about import About


def add_about(parser: argparse.ArgumentParser) -> None:
    """Add ``--note`` and ``--meta``; what they say is recorded."""
    parser.add_argument("--note", default="", metavar="TEXT", help="a note, kept in the recording")
    parser.add_argument(
        "--meta",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="a name and a value, kept in the recording, such as specimen=W7",
    )


def read_about(operator: str | None, note: str, meta: Sequence[str]) -> About:
    """Return what the options say.

    Raises:
        ConfigError: one is too long, is no NAME=VALUE, holds control characters, or names a value
            that another names too.
    """
    from rigd.cli.assignments import read_assignments
    from rigd.model.about import About
    from rigd.model.errors import ConfigError

    values = read_assignments(meta)
    if len(values) < len(meta):
        names = [text.partition("=")[0].strip() for text in meta]
        twice = next(name for name in names if names.count(name) > 1)
        raise ConfigError(
            f"--meta gives {twice} two values",
            hint=f"one value is kept of a name: write --meta '{twice}=A, B'",
        )
    try:
        return About((operator or "").strip(), note.strip(), values)
    except ValueError as error:
        raise ConfigError(
            str(error), hint="--operator, --note and --meta are kept in the recording as text"
        ) from error
