"""``rigd recover``: repairs damaged recordings and completes recordings of interrupted runs."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

HELP = "repair damaged recordings, keep the damaged files, complete those of killed runs"
EXAMPLES = """\
examples:
  rigd recover runs/20261121-080000-constant_current-pvc.mcap
  rigd recover runs/*.mcap
  rigd recover          # complete the recordings of all runs that were killed

  An intact file is not changed. In a damaged file the damaged parts are left out and all the rest
  is kept; trials that lost rows are marked. The damaged file is kept as FILE.orig until you remove
  it. Samples that a killed run left in memory are added first.
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument(
        "files",
        nargs="*",
        type=Path,
        metavar="FILE",
        help="recordings; by default those of runs that were killed on this machine",
    )


def execute(args: argparse.Namespace) -> int:
    """Repair every file; a file that cannot be repaired does not stop the others."""
    from rigd.model.errors import Exit
    from rigd.model.machine.system import require_linux

    require_linux("`rigd recover`")
    went_well = [_recover(path) for path in args.files] if args.files else _recover_killed()
    return int(Exit.OK if all(went_well) else Exit.BAD_DATA)


def _recover_killed() -> list[bool]:
    """Recover the recordings of all killed runs; return whether each is intact."""
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
            went_well.append(_recover(path, killed=True))
    if not went_well:
        print("there is no recording of a killed run to complete")
    return went_well


def _recover(path: Path, *, killed: bool = False) -> bool:
    """Complete a file with a killed run's samples in memory, repair it; return if it is intact.

    A run in progress is not touched. ``killed``: a killed run names the file, which may not exist.
    """
    from rigd.engine.recorder import drain_into
    from rigd.model.errors import Blocked, RigdError

    completed = True
    try:
        if drain_into(path, command="rigd recover"):
            print(f"{path}: completed with samples that its killed run left in memory")
    except Blocked as error:
        print(f"rigd: {path}: {'; '.join(error.reasons)}", file=sys.stderr)
        return False
    except RigdError as error:
        print(f"rigd: {error}", file=sys.stderr)
        completed = False
    if killed and completed and not path.exists():
        print(f"{path}: its run was killed before it recorded anything")
        return True
    return _repair(path) and completed


def _repair(path: Path) -> bool:
    """Repair one file and print the result; return whether it is intact now."""
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
    if report.original is None:  # only the end was missing
        print(f"{path}: recovered {rows} messages; its end was missing ({report.problem})")
        return True
    damaged = sum(damage.end - damage.start for damage in report.damages)
    print(f"{path}: recovered {rows} messages; {damaged} bytes are damaged ({report.problem})")
    for line in verify(path).lines():
        print(f"  {line}")
    print(f"  the damaged file is kept as {report.original}; remove it when you no longer need it")
    return report.another is None or _repair_second(path, report.original, report.another)


def _repair_second(path: Path, original: Path, at: int) -> bool:
    """Repair the recording that begins at byte ``at`` of a damaged file; return if it is intact."""
    from rigd.model.errors import RecordingError
    from rigd.record.repair.recover import split_off

    try:
        second = split_off(original, at, path)
    except RecordingError as error:
        print(f"rigd: {error}", file=sys.stderr)
        return False
    print(f"  it contained two recordings: this file is the first, {second} is the second")
    return _repair(second)
