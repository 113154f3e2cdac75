"""``rigd recover``: makes torn recordings readable again, and completes those of killed runs."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

HELP = "repair recordings that a crash left torn, in place"
EXAMPLES = """\
examples:
  rigd recover runs/20261121-080000-constant_current-pvc.mcap
  rigd recover runs/*.mcap
  rigd recover          # complete the recordings of all runs that were killed

  An intact file is left as it is. What was recorded up to the damage is kept. Samples that a
  killed run left in memory are added first.
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

    wanted = {path.resolve() for path in args.files}
    drained = _drain(wanted)
    repaired = [_repair(path) for path in args.files]
    if not args.files and not drained:
        print("no killed run has left anything behind")
    return int(Exit.OK if all([*drained, *repaired]) else Exit.BAD_DATA)


def _drain(wanted: set[Path]) -> list[bool]:
    """Add what killed runs left in memory to ``wanted`` recordings, or to all where it is empty.

    Returns for each such run whether that went well.
    """
    from rigd.engine.recorder import drain_leftovers
    from rigd.engine.shared import RunFolder, leftovers
    from rigd.model.errors import Blocked, RigdError

    went_well: list[bool] = []
    for found in leftovers():
        try:
            job = found.job
            if wanted and job.recording.resolve() not in wanted:
                continue
            folder = RunFolder.take_at(found.path, job.rig, "rigd recover", job.recording)
            try:
                path = drain_leftovers(folder)
            finally:
                folder.release()
        except Blocked as error:  # a run under way, which is nothing to recover
            print(f"rigd: {'; '.join(error.reasons)}", file=sys.stderr)
            went_well.append(not wanted)
            continue
        except RigdError as error:
            print(f"rigd: {error}", file=sys.stderr)
            went_well.append(False)
            continue
        went_well.append(True)
        if path is not None:
            print(f"{path}: completed with what the killed run on {job.rig} had left in memory")
    return went_well


def _repair(path: Path) -> bool:
    """Repair one file and say what was done; return whether it is sound now."""
    from rigd.model.errors import RecordingError
    from rigd.record import recover

    try:
        report = recover(path)
    except RecordingError as error:
        print(f"rigd: {error}", file=sys.stderr)
        return False
    if report.intact:
        print(f"{path}: intact")
    else:
        rows = sum(report.rows_kept.values())
        print(
            f"{path}: recovered {rows} messages; {report.lost_bytes} bytes behind the damage "
            f"were cut off ({report.problem})"
        )
    return True
