"""``rigd run``: runs a procedure on a rig and records it."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from rigd.cli import options

if TYPE_CHECKING:
    from rigd.daemon.execute import RunRequest

HELP = "run a procedure on a rig and record every sample"
EXAMPLES = """\
examples:
  rigd run procedures/quick.yaml --rig lugre-1
  rigd run procedures/constant_current.yaml --rig configs/sim_lugre.yaml --set floor=pvc
  rigd run procedures/constant_current.yaml --rig lugre-1 --dry-run
                                    steps, duration and peaks, nothing moves, nothing is written
  rigd run procedures/quick.yaml --rig wire-1 --dry-run
                                    a real rig: on the plant of its simulated sibling
  rigd run procedures/quick.yaml --rig lugre-1 --junit result.xml
                                    for continuous integration: a test case for each trial
  rigd run procedures/quick.yaml --rig lugre-1 --operator "A. Miller" --specimen W7 --meta batch=13
                                    written into the recording, shown by info, runs, reports
  rigd run --resume runs/interrupted.mcap
                                    continue: only the missing trials

while it runs:
  Ctrl-C    controlled stop, then `finish`; again: abort; a third time: drop power
  Ctrl-Z    hold this step if it can be held, or pause after this trial; again: resume
            (SIGUSR1 does the same)

A software stop is a request. The safety function is the hardware chain of the rig.
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument(
        "procedure", nargs="?", help=("procedure file, or the name of a shipped procedure")
    )
    options.add_rig(parser, "rig file, or the rig's name (lugre-1)", required=False)
    options.add_set(parser)
    parser.add_argument(
        "--dry-run",
        action="store_true",
        help="play it on the simulated plant of the rig or of its sibling, record nothing",
    )
    parser.add_argument(
        "--resume",
        type=Path,
        metavar="RUN",
        help=("continue an interrupted sweep, in its file; by default with its procedure and rig"),
    )
    asked = parser.add_mutually_exclusive_group()
    asked.add_argument(
        "--yes", action="store_true", help="answer prompts with the procedure's own answers"
    )
    asked.add_argument(
        "--ask", action="store_true", help="ask at this terminal, also on a simulated rig"
    )
    parser.add_argument(
        "--seed", type=_seed, metavar="N", help="seed of the simulation (default 1)"
    )
    parser.add_argument(
        "--pace",
        type=_pace,
        metavar="X",
        help="run at X times real time instead of virtual time; 1 is real time",
    )
    parser.add_argument(
        "--output", type=Path, metavar="FILE", help="recording to write (default: a name in --runs)"
    )
    options.add_runs(parser)
    parser.add_argument(
        "--start",
        metavar="TIME",
        type=_time,
        help="UTC time of the first sample in virtual time, such as 2026-11-21T08:00:00",
    )
    parser.add_argument(
        "--compression",
        choices=("zstd", "lz4", "none"),
        default="zstd",
        help="compression of the recording (default: zstd)",
    )
    parser.add_argument("--operator", metavar="NAME", help="operator of the run, for the recording")
    options.add_about(parser)
    options.add_json(parser)
    parser.add_argument(
        "--junit",
        type=Path,
        metavar="FILE",
        help=("write the result as JUnit XML, a test case per trial"),
    )
    options.add_quiet(parser)


def execute(args: argparse.Namespace) -> int:
    """Execute a run or a dry run; errors before the run also go into the JUnit file."""
    from rigd.cli.junit import check_writable, suite_of_error, write_junit
    from rigd.model.errors import ConfigError, RigdError

    if args.junit is None:
        return _execute(args)
    if args.dry_run:
        raise ConfigError(
            "--junit reports a run, and a dry run is not a run",
            hint="remove one of the two options",
        )
    check_writable(args.junit)
    try:
        return _execute(args)
    except RigdError as error:
        name = args.procedure or "rigd run"
        write_junit(args.junit, suite_of_error(Path(name).stem, error))
        raise


def _execute(args: argparse.Namespace) -> int:
    from rigd.cli.junit import suite_of_complete, write_junit
    from rigd.cli.playing import play
    from rigd.daemon.calibration import needed, unusable
    from rigd.daemon.execute import day_of
    from rigd.daemon.requested import requested
    from rigd.daemon.resume import read_resume_point
    from rigd.model.errors import ConfigError
    from rigd.model.extras import require

    about = options.read_about(args.operator, args.note, args.meta, args.specimen)
    resume = None if args.resume is None else read_resume_point(args.resume)
    overrides = options.read_assignments(args.set)
    if resume is not None:
        if args.output is not None or overrides:
            raise ConfigError(
                "--resume continues the run with its own values; remove --output and --set"
            )
        overrides = dict(resume.overrides)
    procedure_name: str | None = args.procedure
    rig_name: str | None = args.rig
    if resume is not None:
        procedure_name = procedure_name or resume.procedure
        rig_name = rig_name or resume.rig
    if procedure_name is None or rig_name is None:
        raise ConfigError(
            "procedure or rig is missing",
            hint="rigd run procedures/quick.yaml --rig lugre-1",
        )
