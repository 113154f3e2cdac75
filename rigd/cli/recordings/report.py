"""``rigd report``: writes an HTML page for any recording."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

HELP = "show recordings as pages: channels, steps, events, limits, parameters of each trial"
EXAMPLES = """\
examples:
  rigd report runs/20261121-080000-quick.mcap        writes runs/20261121-080000-quick-run.html
  rigd report FILE --trials 7,12-15                  each of these trials drawn separately
  rigd report FILE --output page.html

The page shows the recorded data. The report of `rigd identify` shows the estimates.
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help="recordings")
    parser.add_argument(
        "--trials", metavar="LIST", help="trials to draw separately, such as 1,4,7-9"
    )
    parser.add_argument(
        "--output",
        type=Path,
        metavar="FILE",
        help="page to write, for a single recording (default: RECORDING-run.html beside it)",
    )


def execute(args: argparse.Namespace) -> int:
    """Write a page for each recording."""
    from rigd.model.machine.extras import require

    require("analysis", "rigd report")
    from rigd.analysis.run_page import parse_selection, run_report
    from rigd.model.errors import ConfigError, Exit, RecordingError
    from rigd.model.machine.folders import make_folder
    from rigd.model.pages import page_of

    if args.output is not None and len(args.files) > 1:
        raise ConfigError("--output is for one recording", hint="remove it if there are several")
    if args.output is not None and args.output.suffix == ".mcap":
        raise ConfigError(f"--output {args.output} would overwrite a recording")
    selection = None if args.trials is None else parse_selection(args.trials)
    went_well = True
    for file in args.files:
        page = args.output or page_of(file)
        try:
            text = run_report(
                file, selection, lambda loss: print(f"warning: {loss}", file=sys.stderr)
            )
        except RecordingError as error:  # the other pages are still drawn
            print(f"rigd: {error}", file=sys.stderr)
            went_well = False
            continue
        make_folder(page.parent, "--output")
        try:
            page.write_text(text, encoding="utf-8")
        except OSError as error:
            raise RecordingError(f"cannot write the page {page}: {error.strerror}") from error
        print(f"report: {page}")
    return int(Exit.OK if went_well else Exit.BAD_DATA)
