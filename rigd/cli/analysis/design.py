"""``rigd design``: chooses tests for a saved model, and writes them as a procedure."""

from __future__ import annotations

import argparse
import json
import re
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from rigd.cli.options import add_json, add_rig, rig_of

if TYPE_CHECKING:
    from rigd.analysis.design.command import Designed
    from rigd.analysis.terminal import TerminalTable

HELP = "choose the tests that make the intervals of a model narrow, as a procedure ready to run"
EXAMPLES = """\
examples:
  rigd identify identified.mcap --json > oe.json
  rigd design --model oe.json --minutes 5 --rig lugre-1
  rigd design --model oe.json --minutes 1 --rig lugre-1 --for mu_s,g@50mm/s -o mu_s.yaml

  The procedure stays within the limits of the rig, as the model predicts the motion. Its head
  states which intervals it promises; the table compares them with the base procedure in equal time.
  Of several models in the file, the tests are for all of them together; --group takes one.
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument(
        "--model", type=Path, required=True, metavar="MODEL",
        help="JSON of `rigd identify`",
    )  # fmt: skip
    parser.add_argument(
        "--minutes", type=float, required=True, metavar="N", help="rig time of all tests"
    )
    parser.add_argument(
        "--for", dest="targets", default="", metavar="NAMES",
        help="quantities to know best, such as mu_s,g@50mm/s (default: all parameters, and g at 5, "
        "10, 20 and 50 mm/s)",
    )  # fmt: skip
    add_rig(parser)
    parser.add_argument(
        "--base", default="constant_current", metavar="PROCEDURE",
        help="procedure that gives the steps around the tests, signals and constants "
        "(default: constant_current)",
    )  # fmt: skip
    parser.add_argument(
        "--group", default="", metavar="NAME", help="take this model of several in the file"
    )
    parser.add_argument(
        "-o", "--output", type=Path, default=Path("designed.yaml"), metavar="FILE",
        help="procedure to write (default: designed.yaml)",
    )  # fmt: skip
    add_json(parser)


def execute(args: argparse.Namespace) -> int:
    """Design, write the procedure, print what it promises."""
    from rigd.cli.analysis.evaluation import one_thread
    from rigd.model.machine.extras import require

    require("analysis", "rigd design")
    one_thread()

    from rigd.analysis.design.command import design
    from rigd.cli.views.evaluation import print_terminal_report
    from rigd.config.loader import load_rig
    from rigd.model.errors import ConfigError, Exit, RecordingError
    from rigd.model.machine.folders import make_folder
    from rigd.procedure.loader import load_procedure

    output: Path = args.output
    if output.exists():
        raise ConfigError(f"{output} exists already", hint="give another file with -o")
    if output.suffix != ".yaml":
        raise ConfigError(f"{output} must end in .yaml")
    name = re.sub(r"\W+", "_", output.stem)
    if not re.fullmatch(r"[a-z][a-z0-9_]{0,59}", name):
        raise ConfigError(
            f"{output}: {name!r} is not a valid name of a procedure",
            hint="small letters, digits and _, a letter first, at most 60, such as designed.yaml",
        )
    make_folder(output.parent, "-o")  # known before the minutes that a design takes
    designed = design(
        args.model,
        load_rig(rig_of(args)),
        load_procedure(args.base),
        args.minutes,
        [name for name in args.targets.split(",") if name.strip()],
        name,
        group=args.group,
        notify=lambda line: print(f"designing {line}", file=sys.stderr),
    )
    try:
        output.write_text(_head(designed, args) + designed.text, encoding="utf-8")
    except OSError as error:
        raise RecordingError(f"cannot write {output}: {error.strerror}") from error
    if args.json:
        found = asdict(designed)
        del found["text"]
        print(json.dumps({"procedure": str(output), **found}, indent=2, allow_nan=False))
        return Exit.OK
    count = f"{designed.trials} tests in {designed.duration_s:.0f} s, as predicted"
    print_terminal_report((count, _table(designed, args.base), *designed.notes))
    print(f"procedure: {output}")
    return Exit.OK


def _head(designed: Designed, args: argparse.Namespace) -> str:
    """Return the comment that states the promise and its origin."""
    widest = max(len(item.target) for item in designed.promises)
    groups = max(len(item.group) for item in designed.promises)
    rows = [
        f"#   {item.group:<{groups}}  {item.target:<{widest}}  {_percent(item.half_width)}"
        for item in designed.promises
    ]
    asked = args.targets or "all parameters and g"
    return "\n".join(
        (
            f"# Designed by `rigd design` for {asked} in {args.minutes:g} min, from the model",
            f"# {args.model.name}. Promised half widths of the 95 % intervals, which output error",
            "# gives on recordings that the model predicts:",
            *rows,
            "",
        )
    )


def _table(designed: Designed, base: str) -> TerminalTable:
    from rigd.analysis.terminal import Column, TableRow, TerminalTable

    several = len({item.group for item in designed.promises}) > 1
    rows = [
        TableRow((
            *((item.group,) if several else ()), item.target, _percent(item.half_width),
            _percent(item.base),
        ))
        for item in designed.promises
    ]  # fmt: skip
    columns = (
        *((Column("model"),) if several else ()), Column("target"),
        Column("promised", right=True), Column(f"{Path(base).stem}, equal time", right=True),
    )  # fmt: skip
    return TerminalTable(columns, tuple(rows), "Half widths of the 95 % intervals")


def _percent(half_width: float | None) -> str:
    return "open" if half_width is None else f"±{100.0 * half_width:.2g} %"
