"""``rigd recover``: makes a torn recording readable again, in place."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

HELP = "repair recordings that a crash left torn, in place"
EXAMPLES = """\
examples:
  rigd recover runs/20261121-080000-constant_current-pvc.mcap
  rigd recover runs/*.mcap

  An intact file is left as it is. What was recorded up to the damage is kept.
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help="recordings")


def execute(args: argparse.Namespace) -> int:
    """Repair every file; one that cannot be never keeps the others from being repaired."""
    from rigd.model.errors import Exit, RecordingError
    from rigd.record import recover

    failed = False
    for path in args.files:
        try:
            report = recover(path)
        except RecordingError as error:
            failed = True
            print(f"rigd: {error}", file=sys.stderr)
            continue
        if report.intact:
            print(f"{path}: intact")
        else:
            rows = sum(report.rows_kept.values())
            print(
                f"{path}: recovered {rows} messages; {report.lost_bytes} bytes behind the damage "
                f"were cut off ({report.problem})"
            )
    return int(Exit.BAD_DATA if failed else Exit.OK)
