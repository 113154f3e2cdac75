"""``rigd validate``: tries an identified model on other recordings, and makes a report."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from rigd.cli.analysis.evaluation import add_evaluated, one_thread, read_corrections, show

HELP = "try an identified model on other recordings: confirmed, rejected, or a constant is off"
EXAMPLES = """\
examples:
  rigd identify identified.mcap --json > model.json
  rigd validate model.json validation.mcap         the measured current into the model
  rigd validate model.json runs/*validation*.mcap  each recording judged by itself
  rigd validate model.json FILE --json             for a program
  rigd validate model.json FILE --group pvc        that model of the file, whatever was recorded
  rigd validate model.json FILE --set torque_constant="29.8 mN m/A"

  MODEL is what `rigd identify --json` prints. Of several models in it, each trial gets that of its
  own conditions, such as the floor. If the motion asks for another constant, that is named.
  Exit code 8: a model is rejected; 7: the recordings cannot tell.
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("model", type=Path, metavar="MODEL", help="JSON of `rigd identify`")
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help="recordings")
    parser.add_argument(
        "--group", default="", metavar="NAME", help="take this model of several in the file"
    )
    add_evaluated(parser)


def execute(args: argparse.Namespace) -> int:
    """Validate, report, print."""
    from rigd.model.machine.extras import require

    require("analysis", "rigd validate")
    one_thread()

    from rigd.analysis.api import Result
    from rigd.analysis.recordings.source import Correction
    from rigd.analysis.validation.evaluation import validate
    from rigd.model.errors import Exit

    losses: list[str] = []
    corrected: list[Correction] = []
    evaluation = validate(
        args.model,
        args.files,
        group=args.group,
        notify=lambda line: print(f"validating {line}", file=sys.stderr),
        passed_over=losses.append,
        corrections=read_corrections(args),
        changed=corrected.append,
    )
    first: Path = args.files[0]
    result = Result(evaluation, tuple(losses), tuple(corrected))
    show(args, result, first.with_name(f"{first.stem}-validation.html"))
    if not evaluation.fits:
        return Exit.MISFIT
    return Exit.OK if evaluation.telling else Exit.BAD_DATA
