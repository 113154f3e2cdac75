"""``rigd compare``: shows what differs between campaigns, with intervals."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from rigd.cli.analysis.evaluation import one_thread
from rigd.cli.options import add_json, add_set, read_assignments

HELP = "compare campaigns: differences of parameters with intervals, tests, trends"
EXAMPLES = """\
examples:
  rigd compare before.mcap after.mcap
  rigd compare before/ after/                      all recordings of two folders
  rigd compare 'runs/*W7*.mcap' 'runs/*W8*.mcap'   patterns in quotes: one group each
  rigd compare before.json after.json              results of `rigd identify --json`
  rigd compare runs/*constant_current*.mcap --by month
  rigd compare runs/*constant_current*.mcap --by meta.batch
  rigd compare before.mcap after.mcap --json

  Each argument is a group, identified by itself, or, without an `identify` block, what its
  procedure measures. With --by all recordings are pooled and grouped. Uncertainty that comes from
  constants which all groups state alike cancels in the differences. Exit code 8 if a model does
  not fit; 7 if a group cannot be compared.
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument(
        "groups", nargs="+", metavar="GROUP", help="recording, folder, pattern in quotes, or JSON"
    )
    parser.add_argument(
        "--by",
        metavar="WHAT",
        help="group the recordings by year, month, day, recording, specimen or meta.KEY",
    )
    parser.add_argument(
        "--method",
        choices=["slip-force", "output-error"],
        default="",
        help="estimation method, the same for all groups (default: that of the analysis)",
    )
    parser.add_argument("--law", default="", metavar="NAME", help="fit this friction law")
    add_set(parser, "another value for a constant, in all groups")
    parser.add_argument("--report", type=Path, metavar="FILE", help="HTML report to write")
    add_json(parser)


def execute(args: argparse.Namespace) -> int:
    """Identify each group, compare, print."""
    from rigd.model.machine.extras import require

    require("analysis", "rigd compare")
    one_thread()

    from rigd.analysis.analysis import Options
    from rigd.analysis.api import corrections_of, refuse_recording
    from rigd.analysis.compare.api import compared
    from rigd.analysis.compare.campaign import grouped, named_groups
    from rigd.analysis.side_by_side import cores
    from rigd.cli.views.evaluation import print_evaluation
    from rigd.model.errors import Exit

    if args.report is not None:
        refuse_recording("--report", args.report)
    groups = named_groups(args.groups)
    if args.by is not None:
        groups = grouped([path for part in groups.values() for path in part], args.by)
    found = compared(
        groups,
        Options(method=args.method, law=args.law, processes=cores()),
        corrections_of(read_assignments(args.set), None),
        notify=lambda line: print(f"comparing {line}", file=sys.stderr),
    )
    if args.report is not None:
        found.report(args.report)
    if args.json:
        print(json.dumps(found.to_json(), indent=2, allow_nan=False))
    else:
        for loss in found.losses:
            print(f"warning: {loss}")
        print_evaluation(found.evaluation)
        if args.report is not None:
            print(f"report: {args.report}")
    return int(Exit.OK if found.fits else Exit.MISFIT)
