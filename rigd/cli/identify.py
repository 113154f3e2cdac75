"""``rigd identify``: recordings to friction parameters with uncertainties, and a report."""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path

HELP = "identify friction parameters from recordings, and write a report"
EXAMPLES = """\
examples:
  rigd identify runs/20261121-080000-constant_current-pvc.mcap
  rigd identify runs/*constant_current*.mcap       one report on all floors
  rigd identify FILE --json                        for a program
  rigd identify before.mcap after.mcap --group-by recording
  rigd identify runs/*approach_angles*.mcap        one campaign, whatever files it is in
  rigd identify FILE --calibration new.yaml        raw volts under another calibration

  A parameter that the data do not determine is called that, with the excitation that would help.
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help="recordings")
    parser.add_argument(
        "--report",
        type=Path,
        metavar="FILE",
        help="HTML report to write (default: beside the first recording)",
    )
    parser.add_argument("--no-report", action="store_true", help="write no report")
    parser.add_argument(
        "--starts", type=int, default=8, metavar="N", help="starts of the fit (default 8)"
    )
    parser.add_argument(
        "--seed", type=int, default=1, metavar="N", help="seed of the starts (default 1)"
    )
    parser.add_argument(
        "--robust", action="store_true", help="Huber loss instead of least squares, for outliers"
    )
    parser.add_argument(
        "--calibration",
        type=Path,
        metavar="FILE",
        help="use this calibration on the raw volts, not the one that the recordings carry",
    )
    parser.add_argument(
        "--group-by",
        choices=["recording"],
        help="identify each recording by itself, to compare them",
    )
    parser.add_argument("--json", action="store_true", help="print the result as JSON")


def execute(args: argparse.Namespace) -> int:
    """Identify, report, print."""
    # Before numpy is loaded: the systems to solve are small, and threads of the linear algebra
    # that wait for one another cost twenty times what one alone does.
    for name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")

    from rigd.analysis.analysis import Options
    from rigd.analysis.evaluation import evaluate
    from rigd.cli.evaluation_view import print_terminal_report
    from rigd.model.errors import ConfigError, RecordingError

    if not 1 <= args.starts <= 1000:
        raise ConfigError(f"--starts {args.starts} must be between 1 and 1000")
    if args.report is not None and args.report.suffix == ".mcap":
        raise ConfigError(f"--report {args.report} would overwrite a recording")
    by_recording = args.group_by is not None
    options = Options(args.starts, args.seed, args.robust, args.calibration, by_recording)
    losses: list[str] = []
    evaluation = evaluate(
        args.files,
        options,
        tell=lambda line: print(f"identifying {line}", file=sys.stderr),
        passed_over=losses.append,
    )
    report: Path | None = None
    if not args.no_report:
        report = args.report or args.files[0].with_suffix(".html")
        try:
            report.write_text(evaluation.report(), encoding="utf-8")
        except OSError as error:
            raise RecordingError(f"cannot write the report {report}: {error.strerror}") from error
    if args.json:
        print(json.dumps({**evaluation.to_json(), "lost": losses}, indent=2, allow_nan=False))
    else:
        for loss in losses:
            print(f"warning: {loss}")
        print_terminal_report(evaluation.terminal_report())
        if report is not None:
            print(f"report: {report}")
    return 0
