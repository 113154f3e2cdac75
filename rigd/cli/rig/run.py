"""``rigd run``: runs a procedure on a rig and records it."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from rigd.cli import options

if TYPE_CHECKING:
    from rigd.daemon.execute import RunRequest

HELP = "run a procedure on a rig and record every sample"
EXAMPLES = """\
examples:
  rigd run procedures/quick.yaml    on the simulated rig that it names; nothing moves
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

without --rig:
  the rig is what RIGD_RIG names, or default_rig in rigd.yaml of this folder, or the simulated rig
  that the procedure names (try_on). One line says which.

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
    options.add_rig(parser, "rig file, or the rig's name (lugre-1)")
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
        help="run at X times real time (1 is real time), or in `virtual` time (default)",
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
    from rigd.cli.views.junit import check_writable, suite_of_error, write_junit
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
    from rigd.cli.rig.playing import play
    from rigd.cli.views.junit import suite_of_complete, write_junit
    from rigd.daemon.resume import read_resume_point
    from rigd.daemon.run_request import requested
    from rigd.model.errors import ConfigError
    from rigd.model.machine.extras import require

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
    if resume is not None:
        procedure_name = procedure_name or resume.procedure
        args.rig = args.rig or resume.rig
    if procedure_name is None:
        raise ConfigError("no procedure is given", hint="rigd run procedures/quick.yaml")
    rig_name = options.rig_of(args, procedure_name)
    request = requested(
        procedure_name,
        rig_name,
        overrides=overrides,
        about=about,
        seed=args.seed,
        pace=args.pace,
        start_ns=args.start,
        output=args.output,
        folder=args.runs,
        resume=resume,
        compression=args.compression or "zstd",
    )
    procedure, rig = request.procedure, request.rig
    if resume is not None and len(resume.done) == len(procedure.trials):
        print(f"{resume.path}: all {len(resume.done)} trials are complete, nothing is missing")
        if args.junit is not None:
            write_junit(args.junit, suite_of_complete(procedure, rig.name, resume.path))
        return 0
    if procedure.measures and not args.dry_run:
        require("analysis", "a procedure that measures")
    if args.dry_run:
        if without_effect := _without_effect(args):
            print(
                "warning: without effect in a dry run, which records nothing and asks nobody: "
                f"{', '.join(without_effect)}",
                file=sys.stderr,
            )
        return _dry_run(request, as_json=args.json)
    by_person = args.ask or (rig.plant is None and rig.simulation is None and not args.yes)
    return play(request, as_json=args.json, quiet=args.quiet, by_person=by_person, junit=args.junit)


def _without_effect(args: argparse.Namespace) -> list[str]:
    """Return the options given that only a run has."""
    given = {
        "--output": args.output is not None,
        "--pace": args.pace is not None,
        "--ask": args.ask,
        "--compression": args.compression is not None,
    }
    return [option for option, is_given in given.items() if is_given]


def _dry_run(request: RunRequest, *, as_json: bool) -> int:
    """Play and print the dry run."""
    from rigd.cli.views.dry_run import dry_run_json, print_dry_run
    from rigd.daemon.rehearsal import rehearse
    from rigd.model.errors import Exit

    if not as_json:
        print(f"dry run: {request.title}", flush=True)
    found = rehearse(request.procedure, request.rig, request.seed, request.start_ns)
    if as_json:
        print(json.dumps(dry_run_json(found), indent=2))
    else:
        print_dry_run(found)
    return int(Exit.BLOCKED if found.refusals else Exit.OK)


def _seed(text: str) -> int:
    if text.isdecimal() and int(text) < 2**32:
        return int(text)
    raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from 0 to 4294967295")


def _pace(text: str) -> float:
    """Return the pace, 0 for virtual time."""
    if text == "virtual":
        return 0.0
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if 0.01 <= value <= 100:
        return value
    raise argparse.ArgumentTypeError(
        f"{text!r} is neither a number from 0.01 to 100, such as 0.5, nor 'virtual'"
    )


def _time(text: str) -> int:
    from datetime import UTC, datetime

    try:
        moment = datetime.fromisoformat(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(
            f"{text!r} is not a time such as 2026-11-21T08:00:00"
        ) from error
    if moment.tzinfo is None:
        moment = moment.replace(tzinfo=UTC)
    seconds = int(moment.timestamp())
    if seconds < 0 or moment.year > 2261:  # a recording has times in ns since 1970
        raise argparse.ArgumentTypeError(f"{text!r} is not between the years 1970 and 2261")
    return seconds * 1_000_000_000
