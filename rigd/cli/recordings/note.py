"""``rigd note``: adds a note to a recording."""

from __future__ import annotations

import argparse
from pathlib import Path

HELP = "add a note to a recording, for those who read it later"
EXAMPLES = """\
examples:
  rigd note runs/20261121-080000-quick.mcap "the wheel was worn, as seen later"
  rigd note FILE "not to be used: wrong floor" --author "A. Miller"

The note has a date and an author, and is shown by `rigd info`, `rigd runs` and every report.
No sample changes. A note is never removed: add another one.
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("file", type=Path, metavar="FILE", help="recording")
    parser.add_argument("text", metavar="TEXT", help="the note")
    parser.add_argument(
        "--author", metavar="NAME", help="who writes it (default: the user of this computer)"
    )


def execute(args: argparse.Namespace) -> int:
    """Add the note."""
    from rigd.model.about import plain
    from rigd.model.errors import ConfigError
    from rigd.record import add_note

    author = _user() if args.author is None else args.author
    try:
        note = add_note(args.file, args.text, author)
    except ValueError as error:
        raise ConfigError(
            str(error), hint='write: rigd note FILE "what is to be known" --author NAME'
        ) from error
    print(f"{args.file}: {plain(str(note))}")
    return 0


def _user() -> str:
    """Return the name of the user at this computer; "" if it has none."""
    import getpass

    try:
        return getpass.getuser()
    except (OSError, KeyError, ImportError):  # a user without an entry, as in some containers
        return ""
