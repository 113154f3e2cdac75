"""``rigd recover``: repairs damaged recordings and completes those of killed runs."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from shlex import quote

HELP = "repair damaged recordings, keep the damaged files, complete those of killed runs"
EXAMPLES = """\
examples:
  rigd recover runs/20261121-080000-constant_current-pvc.mcap
  rigd recover runs/*.mcap
  rigd recover          # complete the recordings of all runs that were killed

  An intact file is left as it is. Of a damaged one, what is damaged is left out and all the rest
  is kept; trials that lost rows are marked. The damaged file stays beside it as FILE.orig until
  you remove it. Samples that a killed run left in memory are added first.
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument(
        "files",
        nargs="*",
        type=Path,
        metavar="FILE",
        help="recordings; without any, those of runs that were killed on this machine",
    )


def execute(args: argparse.Namespace) -> int:
    """Repair every file; one that cannot be never keeps the others from being repaired."""
    from rigd.model.errors import Exit
    from rigd.record.access import require_writing

    require_writing()
    went_well = [_recover(path) for path in args.files] if args.files else _recover_left()
    return int(Exit.OK if all(went_well) else Exit.BAD_DATA)


def _recover_left() -> list[bool]:
    """Recover the recordings of all killed runs; return how each went."""
    from rigd.engine.shared import leftovers
    from rigd.model.errors import RecordingError

    went_well: list[bool] = []
    for folder in leftovers():
        try:
            path = folder.job.recording
        except RecordingError as error:
            print(f"rigd: {error}", file=sys.stderr)
            went_well.append(False)
        else:
            went_well.append(_recover(path, left=True))
    if not went_well:
        print("no killed run has left anything behind")
    return went_well


def _recover(path: Path, *, left: bool = False) -> bool:
    """Add what a killed run left in memory for a file, then repair it; return whether it is well.

    A run that is under way is left alone. ``left``: a killed run names the file, which it may not
    have come to make.
    """
    from rigd.engine.recorder import drain_into
    from rigd.model.errors import Blocked, RigdError

    completed = True
    try:
        if drain_into(path, command="rigd recover"):
            print(f"{path}: completed with what its killed run had left in memory")
    except Blocked as error:
        print(f"rigd: {path}: {'; '.join(error.reasons)}", file=sys.stderr)
        return False
    except RigdError as error:
        print(f"rigd: {error}", file=sys.stderr)
        completed = False
    if left and completed and not path.exists():
        print(f"{path}: its run was killed before it recorded anything")
        return True
    return _repair(path) and completed


def _repair(path: Path) -> bool:
    """Repair one file and say what was done; return whether it is sound now."""
    from rigd.model.errors import RecordingError
    from rigd.record import recover, verify

    try:
        report = recover(path)
    except RecordingError as error:
        print(f"rigd: {error}", file=sys.stderr)
        return False
    if report.intact:
        print(f"{path}: intact")
        return True
    rows = sum(report.rows_kept.values())
    if report.original is None:  # nothing but the end was missing
        print(f"{path}: recovered {rows} messages; its end was missing ({report.problem})")
        return True
    damaged = sum(damage.end - damage.start for damage in report.damages)
    print(f"{path}: recovered {rows} messages; {damaged} bytes are damaged ({report.problem})")
    for line in verify(path).lines():
        print(f"  {line}")
    if report.another is not None:
        print(
            f"  two recordings stood in it, of which this is the first; the second stands in "
            f"{report.original} from byte {report.another} on:\n    tail -c +{report.another + 1} "
            f"{quote(str(report.original))} > second.mcap"
        )
    print(f"  the damaged file is kept as {report.original}; remove it when you no longer need it")
    return True
