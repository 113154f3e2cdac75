"""``rigd calibrate``: measures constants of a rig and writes them into its calibration."""

from __future__ import annotations

import argparse
import json
import sys
from datetime import UTC, datetime
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING

from rigd.cli.about import add_about, read_about

if TYPE_CHECKING:
    from rigd.analysis.calibration.evaluation import CalibrationEvaluation
    from rigd.config.rig import RigConfig
    from rigd.daemon.calibrate import Renewal
    from rigd.model.errors import Exit

HELP = "calibrate a rig: run a procedure, evaluate it, renew the calibration file"
EXAMPLES = """\
examples:
  rigd calibrate procedures/calibrate_torque.yaml --rig angle-1 --operator "A. Miller"
  rigd calibrate procedures/calibrate_scale.yaml --rig angle-1 --operator "A. Miller" --valid 180d
  rigd calibrate --from runs/20261121-080000-calibrate_torque.mcap --operator "A. Miller"
                                    evaluate once more, without running

The run is as `rigd run`: prompts, limits, interlocks, a recording. What it measured is shown beside
the old values, and written only after you have agreed. Values that it did not measure keep their
own dates; those that it replaces go to the history of the file.

exit code: 7 where the data are no calibration; nothing is written then
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("procedure", nargs="?", help="procedure file, or the name of a shipped one")
    parser.add_argument("--rig", metavar="RIG", help="rig file, or the name in it (angle-1)")
    parser.add_argument(
        "--operator", required=True, type=_person, metavar="NAME", help="who answers for it"
    )
    parser.add_argument(
        "--from",
        dest="recording",
        type=Path,
        metavar="RECORDING",
        help="evaluate this recording instead of running; the rig defaults to its own",
    )
    parser.add_argument(
        "--valid",
        type=_days,
        default=365,
        metavar="365d",
        help="for how many days the values may be used (default 365d)",
    )
    parser.add_argument(
        "--write", type=Path, metavar="FILE", help="calibration file to renew instead of the rig's"
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="give a parameter of the procedure another value, with its unit",
    )
    asked = parser.add_mutually_exclusive_group()
    asked.add_argument(
        "--yes",
        action="store_true",
        help="ask nothing: prompts are answered by the procedure, the file is written",
    )
    asked.add_argument(
        "--ask", action="store_true", help="ask at this terminal, also on a simulated rig"
    )
    parser.add_argument(
        "--seed", type=int, default=1, metavar="N", help="seed of the simulation (default 1)"
    )
    parser.add_argument(
        "--runs", type=Path, default=Path("runs"), metavar="FOLDER", help="folder of recordings"
    )
    add_about(parser)
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    parser.add_argument("--quiet", action="store_true", help="no progress")


def execute(args: argparse.Namespace) -> int:
    """Run or take a recording, evaluate, show, ask, write."""
    from rigd.cli.calibration_view import print_renewal, renewal_json
    from rigd.daemon.calibrate import Signature, place_of, renewal
    from rigd.model.errors import Exit

    rig = _rig_of(args)
    place = place_of(rig, args.write)  # before hours are spent on what could not be written
    recording, code = (args.recording, Exit.OK) if args.recording else _run(args, rig)
    if code is not Exit.OK:
        print("rigd: the run did not come to its end: nothing is calibrated", file=sys.stderr)
        return int(code)
    evaluation = _evaluate(recording, None if place.old is None else place.old.path)
    made = evaluation.made or datetime.now(UTC).date()
    planned = renewal(rig, place, evaluation, Signature(args.operator, made, args.valid))
    if not args.json:
        print_renewal(evaluation, planned)
    agreed = args.yes or _agreed(planned, recording, may_ask=not args.json)
    if agreed:
        planned.write()
    if args.json:
        told = renewal_json(evaluation, planned, written=agreed)
        print(json.dumps(told, indent=2, allow_nan=False))
    elif agreed:
        _conclude(planned)
    return int(Exit.OK if agreed else Exit.BLOCKED)


def _rig_of(args: argparse.Namespace) -> RigConfig:
    """Return the rig to calibrate: the one given, or that of the recording."""
    from rigd.config.loader import load_rig
    from rigd.model.errors import ConfigError, DataError
    from rigd.record import Recording, run_info
    from rigd.record.info import COMPLETE

    if args.recording is None:
        if args.procedure is None or args.rig is None:
            raise ConfigError(
                "which procedure, on which rig?",
                hint="rigd calibrate procedures/calibrate_torque.yaml --rig angle-1 "
                "--operator NAME",
            )
        return load_rig(args.rig)
    if args.procedure is not None:
        raise ConfigError("--from evaluates a recording; leave the procedure out")
    info = run_info(Recording.open(args.recording))
    rig = load_rig(args.rig or info.rig)
    if rig.name != info.rig:
        raise ConfigError(
            f"{args.recording} was recorded on rig {info.rig}, not on {rig.name}",
            hint="a calibration belongs to the rig that it was measured on",
        )
    if info.state != COMPLETE:
        raise DataError(
            f"{args.recording} is of a run that did not come to its end ({info.state}): nothing "
            "is calibrated",
            hint=f"`rigd run --resume {quote(str(args.recording))}` plays the rest, "
            f"`rigd identify {quote(str(args.recording))}` shows what there is",
        )
    return rig


def _run(args: argparse.Namespace, rig: RigConfig) -> tuple[Path, Exit]:
    """Run the procedure; return the recording, and how it ended."""
    from rigd.analysis.plan import analysis_of, calibrating
    from rigd.cli.assignments import read_assignments
    from rigd.cli.console import conclude
    from rigd.cli.playing import record
    from rigd.daemon.execute import RunRequest
    from rigd.model.errors import ConfigError
    from rigd.procedure.compile import compile_procedure
    from rigd.procedure.loader import load_procedure

    source = load_procedure(args.procedure)
    overrides = read_assignments(args.set)
    procedure = compile_procedure(source, rig, overrides)
    plan, place = procedure.identify, source.document.key_place(("identify",))
    if plan is None or not analysis_of(plan, place, procedure.trials[0].parameters, rig).measures:
        raise ConfigError(
            f"procedure {procedure.name} calibrates nothing",
            place=place,
            hint=f"its `identify:` names no model that does: {', '.join(calibrating())}",
        )
    request = RunRequest(
        procedure, source.file.text, rig, args.seed, folder=args.runs, overrides=overrides,
        about=read_about(args.operator, args.note, args.meta),
        procedure_whence=source.whence,
    )  # fmt: skip
    by_person = args.ask or (rig.plant is None and rig.simulation is None and not args.yes)
    done = record(request, quiet=args.quiet or args.json, by_person=by_person)
    if done.result.exit_code and not args.json:
        conclude(procedure, done)
    return done.path, done.result.exit_code


def _evaluate(recording: Path, known: Path | None) -> CalibrationEvaluation:
    """Return what the recording calibrates; ``known`` is the calibration as it stands now."""
    from rigd.analysis.analysis import Options
    from rigd.analysis.calibration.evaluation import CalibrationEvaluation
    from rigd.analysis.evaluation import evaluate
    from rigd.model.errors import DataError

    evaluation = evaluate(
        [recording],
        Options(calibration=known),
        passed_over=lambda loss: print(f"warning: {loss}", file=sys.stderr),
    )
    if not isinstance(evaluation, CalibrationEvaluation):
        raise DataError(
            f"{recording} is a measurement of {evaluation.title}, it calibrates nothing",
            hint=f"rigd identify {quote(str(recording))}",
        )
    return evaluation


def _agreed(planned: Renewal, recording: Path, *, may_ask: bool) -> bool:
    """Return whether a person at this terminal wants the file written; without one, it is not."""
    from rigd.cli.asking import ask, is_terminal

    if not (may_ask and is_terminal()):
        print(
            "rigd: not written: nobody can be asked here; give --yes\n"
            f"  rigd calibrate --from {quote(str(recording))} --operator NAME --yes",
            file=sys.stderr,
        )
        return False
    question = f"\nWrite this to {planned.new.path}? [yes/no]: "
    sys.stdout.flush()  # what it is about stands above it
    if ask(question, sys.stdin, sys.stderr).strip().lower() in ("y", "yes"):
        return True
    print("not written", file=sys.stderr)
    return False


def _conclude(planned: Renewal) -> None:
    print(f"\nwrote {planned.new.path}")
    if planned.place.shipped is not None:
        print(
            f"  in place of {planned.place.shipped}: what is shipped with rigd stays as it is.\n"
            "  A copy of the rig file in this folder uses it: its `calibration:` counts from there"
        )


def _person(text: str) -> str:
    if 1 <= len(text.strip()) <= 100:
        return text.strip()
    raise argparse.ArgumentTypeError("give the name of who answers for the calibration")


def _days(text: str) -> int:
    number = text.strip().removesuffix("d")
    if number.isdecimal() and 1 <= int(number) <= 36500:
        return int(number)
    raise argparse.ArgumentTypeError(f"{text!r} is no number of days such as 365d")
