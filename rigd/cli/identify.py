"""``rigd identify``: recordings to friction parameters with honest uncertainties, and a report."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rigd.evaluate.evaluation import Evaluation

HELP = "identify friction parameters from recordings, and write a report"
EXAMPLES = """\
examples:
  rigd identify runs/20261121-080000-constant_current-pvc.mcap
  rigd identify runs/*constant_current*.mcap       one report on all floors
  rigd identify FILE --json                        for a program; `parameters` and `friction_curve`

  A parameter that the data do not determine is called that, with the excitation that would help.
"""

#: What the verdict adds, said once below the table instead of in every row.
FROM_HERE = " from this excitation"


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
    parser.add_argument("--json", action="store_true", help="print the result as JSON")


def execute(args: argparse.Namespace) -> int:
    """Identify, report, print."""
    from rigd.evaluate.evaluation import Options, evaluate
    from rigd.model.errors import ConfigError, RecordingError

    if not 1 <= args.starts <= 1000:
        raise ConfigError(f"--starts {args.starts} must be between 1 and 1000")
    if args.report is not None and args.report.suffix == ".mcap":
        raise ConfigError(f"--report {args.report} would overwrite a recording")
    options = Options(starts=args.starts, seed=args.seed, robust=args.robust)
    evaluation = evaluate(
        args.files, options, tell=lambda line: print(f"identifying {line}", file=sys.stderr)
    )
    report: Path | None = None
    if not args.no_report:
        report = args.report or args.files[0].with_suffix(".html")
        try:
            report.write_text(evaluation.report(), encoding="utf-8")
        except OSError as error:
            raise RecordingError(f"cannot write the report {report}: {error.strerror}") from error
    if args.json:
        print(json.dumps(evaluation.to_json(), indent=2, allow_nan=False))
    else:
        print_parameters(evaluation)
        if report is not None:
            print(f"report: {report}")
    return 0


def print_parameters(evaluation: Evaluation) -> None:
    """Print one table of all groups, and the advice below it."""
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    from rigd.identify.report import summary_rows
    from rigd.identify.result import Verdict

    rows = summary_rows(evaluation.sections)
    referenced = {s.reference_label for s in evaluation.sections if s.reference}
    console = Console(highlight=False, width=None if sys.stdout.isatty() else 120)
    table = Table(box=None, pad_edge=False)
    table.add_column("")
    table.add_column("parameter")
    table.add_column("estimate", justify="right")
    table.add_column("95 % interval", justify="right")
    table.add_column("unit")
    if referenced:
        table.add_column(" / ".join(sorted(referenced)), justify="right")
    table.add_column("verdict")
    last = ""
    for row in rows:
        cells = [
            row.section if row.section != last else "",
            row.name,
            f"{row.estimate_text} {row.spread_text}".strip() if row.known else "–",
            row.interval_text if row.known else "",
            row.unit,
        ]
        if referenced:
            cells.append(row.reference_text)
        cells.append(row.verdict.value.removesuffix(FROM_HERE))
        table.add_row(*map(escape, cells), style="" if row.known else "dim")
        last = row.section
    console.print(table)
    advised: dict[str, list[str]] = {}
    for row in rows:
        # The first sentence says what to do; the report has the rest.
        if row.advice:
            first = row.advice.partition(". ")[0].rstrip(".")
            advised.setdefault(first, []).append(f"{row.name} ({row.section})")
    if any(row.verdict is Verdict.UNIDENTIFIABLE for row in rows):
        console.print(f"\nnot identifiable:{FROM_HERE}; no number is printed for what is not known")
    if advised:
        console.print("\nwhat would help:")
    for advice, names in advised.items():
        console.print(f"  {escape(', '.join(names))}: {escape(advice)}.")
