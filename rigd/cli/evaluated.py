"""Options and output that `rigd identify` and `rigd validate` share: page, JSON, terminal."""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from rigd.cli.options import add_json, add_set, read_assignments

if TYPE_CHECKING:
    from rigd.analysis.analysis import Evaluation
    from rigd.analysis.corrections import Corrections
    from rigd.analysis.source import Correction


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
    from rigd.analysis.corrections import Corrections
    from rigd.model.errors import ConfigError
    from rigd.procedure.loader import load_procedure

    if args.report is not None and args.report.suffix == ".mcap":
        raise ConfigError(f"--report {args.report} would overwrite a recording")
    procedure = None if args.plan is None else load_procedure(args.plan)
    return Corrections(read_assignments(args.set), procedure)


@dataclass
class Remarks:
    """The losses and the corrections of the recordings, reported beside the result."""

    losses: list[str] = field(default_factory=list)
    corrected: list[Correction] = field(default_factory=list)


def show(args: argparse.Namespace, evaluation: Evaluation, remarks: Remarks, page: Path) -> None:
    """Write what the options ask for, and print the result; ``page`` is the report's own place.

    Raises:
        RecordingError: a file cannot be written.
    """
    from rigd.cli.evaluation_view import print_evaluation

    report = None if args.no_report else args.report or page
    if report is not None:
        _write(report, evaluation.report())
    figures = None if args.figures is None else _figures(args.figures, evaluation)
    if args.json:
        print(json.dumps({**evaluation.to_json(), **_plain(remarks)}, indent=2, allow_nan=False))
        return
    for loss in remarks.losses:
        print(f"warning: {loss}")
    for line in dict.fromkeys(f"corrected {item.what}: {item}" for item in remarks.corrected):
        print(line)
    if args.plan is not None and not remarks.corrected:
        print(f"corrected nothing: the recordings already have the plan of {args.plan}")
    print_evaluation(evaluation)
    if report is not None:
        print(f"report: {report}")
    if figures is not None:
        print(
            f"figures: {args.figures}, {figures} as SVG, PDF and CSV; index.csv says what each is"
        )


def _plain(remarks: Remarks) -> dict[str, Sequence[object]]:
    corrected = [{**asdict(item), "recording": str(item.recording)} for item in remarks.corrected]
    return {"lost": remarks.losses, "corrected": corrected}


def _figures(folder: Path, evaluation: Evaluation) -> int:
    """Write the figures of the report; return how many there are."""
    from rigd.analysis.report.files import saving_figures
    from rigd.model.errors import RecordingError

    try:
        with saving_figures(folder) as files:
            evaluation.report()
    except OSError as error:
        raise RecordingError(f"cannot write figures to {folder}: {error.strerror}") from error
    return len(files.shown)


def _write(path: Path, text: str) -> None:
    from rigd.model.errors import RecordingError

    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise RecordingError(f"cannot write the report {path}: {error.strerror}") from error
