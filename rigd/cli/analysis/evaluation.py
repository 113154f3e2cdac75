"""Options and output that `rigd identify` and `rigd validate` share: page, JSON, terminal."""

from __future__ import annotations

import argparse
import json
import os
from pathlib import Path
from typing import TYPE_CHECKING

from rigd.cli.options import add_json, add_set, read_assignments

if TYPE_CHECKING:
    from rigd.analysis.api import Result
    from rigd.analysis.recordings.corrections import Corrections


def add_evaluated(parser: argparse.ArgumentParser) -> None:
    """Add the options of what is written, and of constants that are corrected."""
    parser.add_argument(
        "--report",
        type=Path,
        metavar="FILE",
        help="HTML report to write (default: beside the first recording)",
    )
    parser.add_argument("--no-report", action="store_true", help="write no report")
    parser.add_argument(
        "--figures",
        type=Path,
        metavar="DIR",
        help="write every figure of the report there, as SVG, PDF and CSV (data)",
    )
    add_set(parser, "another value for a constant, such as wheel_radius='50 mm +- 0.1 mm'")
    parser.add_argument(
        "--plan",
        metavar="PROCEDURE",
        help="use the `identify` block of this procedure, not the recorded block",
    )
    add_json(parser)


def one_thread() -> None:
    """Keep linear algebra to one thread; before numpy is loaded.

    The systems to solve are small, and several threads take twenty times as long as one thread,
    because they wait for one another.
    """
    for name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")


def read_corrections(args: argparse.Namespace) -> Corrections:
    """Return the corrections that ``--set`` and ``--plan`` give.

    Raises:
        ConfigError: one of them is wrong, or ``--report`` would overwrite a recording.
    """
    from rigd.analysis.api import corrections_of, refuse_recording

    if args.report is not None:
        refuse_recording("--report", args.report)
    return corrections_of(read_assignments(args.set), args.plan)


def show(args: argparse.Namespace, result: Result, page: Path) -> None:
    """Write what the options ask for, and print the result; ``page`` is the report's own place.

    Raises:
        RecordingError: a file cannot be written.
    """
    from rigd.cli.views.evaluation import print_evaluation

    report = None if args.no_report else result.report(args.report or page)
    figures = None if args.figures is None else result.figures(args.figures)
    if args.json:
        print(json.dumps(result.to_json(), indent=2, allow_nan=False))
        return
    for loss in result.losses:
        print(f"warning: {loss}")
    for line in dict.fromkeys(f"corrected {item.what}: {item}" for item in result.corrections):
        print(line)
    if args.plan is not None and not result.corrections:
        print(f"corrected nothing: the recordings already have the plan of {args.plan}")
    print_evaluation(result.evaluation)
    if report is not None:
        print(f"report: {report}")
    if figures is not None:
        print(
            f"figures: {args.figures}, {figures} as SVG, PDF and CSV; index.csv says what each is"
        )
