"""``rigd verify``: checks whether recordings are intact; changes nothing."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from rigd.cli.options import add_json

HELP = "check every byte of recordings, and list lost rows and trials"
EXAMPLES = """\
examples:
  rigd verify runs/20261121-080000-constant_current-pvc.mcap
  rigd verify runs/*.mcap
  rigd verify FILE --json

  whole    rigd wrote the file, and every byte is as it was written
  valid    another program wrote it: it is read, and what rigd would have added is named
  damaged  bytes are wrong or missing: they are named, and what is lost with them

  The exit code is 0 if every file is whole or valid, and 7 otherwise.
  Nothing is changed: `rigd recover FILE` makes a repaired file and keeps the damaged file as
  FILE.orig; a file that only lacks its end is completed in place.
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help="recordings")
    add_json(parser, "print as JSON, a list")


def execute(args: argparse.Namespace) -> int:
    """Check each file; a file that cannot be read does not stop the others."""
    from rigd.model.errors import Exit, RecordingError
    from rigd.record import verification_json, verify
    from rigd.record.mcap.access import how_to_recover

    sound, found = True, []
    for path in dict.fromkeys(args.files):
        try:
            item = verify(path)
        except RecordingError as error:
            print(f"rigd: {error}", file=sys.stderr)
            sound = False
            found.append(
                {
                    "recording": str(path), "file": "damaged", "sound": False,
                    "problem": error.message,
                }
            )  # fmt: skip
            continue
        sound = sound and item.sound
        found.append(verification_json(item))
        if args.json:
            continue
        rows = ", ".join(
            f"{count} of {topic.removeprefix('/')}" for topic, count in sorted(item.rows.items())
        )
        print(f"{path}: {item.state}, {item.chunks} chunks with {rows or 'no rows'}")
        for line in item.lines():
            print(f"  {line}")
        if not item.sound:
            print(f"  {how_to_recover(path)}")
    if args.json:
        print(json.dumps(found, indent=2))
    return int(Exit.OK if sound else Exit.BAD_DATA)
