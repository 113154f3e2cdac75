"""``rigd measure``: reads what a procedure measures off recordings, and judges it."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from rigd.cli.options import add_json

HELP = "read the measures of a procedure off recordings: mean, repeatability, verdict"
EXAMPLES = """\
examples:
  rigd measure runs/20261121-080000-breakaway.mcap
  rigd measure runs/*breakaway*.mcap                trials of several runs together
  rigd measure FILE --plan breakaway                the `measure` and `accept` of that procedure,
                                                    not the recorded ones
  rigd measure FILE --json
  rigd measure FILE --junit result.xml              a test case for each result

A result is judged by its interval: accepted if all of it lies within `accept`, rejected if all of
it lies outside, else not decided. Exit code 9 if a result is rejected or not decided, or a
measure could be read in no trial.
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help="recordings")
    parser.add_argument(
        "--plan",
        metavar="PROCEDURE",
        help="use the `measure` and `accept` blocks of this procedure, not the recorded ones",
    )
    add_json(parser)
    parser.add_argument(
        "--junit",
        type=Path,
        metavar="FILE",
        help="write the verdicts as JUnit XML, a test case per result",
    )


def execute(args: argparse.Namespace) -> int:
    """Read, print and judge."""
    from rigd.model.machine.extras import require

    require("analysis", "rigd measure")
    from rigd.analysis.measures import measured
    from rigd.analysis.measures.view import result_json
    from rigd.cli.views.junit import Suite, cases_of_measures, check_writable, write_junit
    from rigd.cli.views.measures import print_measures
    from rigd.model.errors import Exit
    from rigd.procedure.loader import load_procedure
    from rigd.record import Recording

    if args.junit is not None:
        check_writable(args.junit)
    plan = None if args.plan is None else load_procedure(args.plan)
    recordings = [Recording.open(file) for file in args.files]
    result = measured(recordings, plan)
    if args.junit is not None:
        name = plan.name if plan is not None else recordings[0].info.procedure
        write_junit(args.junit, Suite(name or "measure", cases_of_measures(result)))
    if args.json:
        print(json.dumps(result_json(result), indent=2, ensure_ascii=False, allow_nan=False))
    else:
        print_measures(result)
    for recording in recordings:
        for loss in recording.info.losses:
            print(f"warning: {loss}", file=sys.stderr)
    return int(Exit.OK if result.is_right else Exit.REJECTED)
