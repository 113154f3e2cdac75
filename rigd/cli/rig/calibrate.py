"""``rigd calibrate``: measures constants of a rig and writes them into its calibration."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Final

from rigd.cli import options

if TYPE_CHECKING:
    from rigd.config.rig import RigConfig
    from rigd.daemon.calibrate import Renewal
    from rigd.model.errors import Exit

#: Options of the run, which `--from` has no use for.
_OF_RUNS: Final = ("set", "specimen", "note", "meta", "ask", "seed", "runs")
HELP = "calibrate a rig: run a procedure, evaluate it, update the calibration file"
EXAMPLES = """\
examples:
  rigd calibrate procedures/calibrate_torque.yaml --rig angle-1 --operator "A. Miller"
  rigd calibrate procedures/calibrate_scale.yaml --rig angle-1 --operator "A. Miller" --valid 180d
  rigd calibrate --from runs/20261121-080000-calibrate_torque.mcap --operator "A. Miller"
                                    evaluate once more, without running

The run is like `rigd run`: prompts, limits, interlocks, a recording. The new values are shown
beside the old values, and written only after you agree. Values that it did not measure keep their
dates; values that it replaces move to the history of the file.

exit code: 7 if the data are no calibration; nothing is written then
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument(
        "procedure", nargs="?", help=("procedure file, or the name of a shipped procedure")
    )
    options.add_rig(parser, "rig file, or the rig's name (angle-1)")
    parser.add_argument(
        "--operator",
        required=True,
        type=_person,
        metavar="NAME",
        help="the person who is responsible for the calibration",
    )
    parser.add_argument(
        "--from",
        dest="recording",
        type=Path,
        metavar="RECORDING",
        help="evaluate this recording instead of running; the default rig is the recording's",
    )
    parser.add_argument(
        "--valid",
        type=_days,
        default=365,
        metavar="365d",
        help="number of days for which the values may be used (default 365d)",
    )
    parser.add_argument(
        "--write",
        type=Path,
        metavar="FILE",
        help=("calibration file to update instead of the rig's"),
    )
    options.add_set(parser)
    asked = parser.add_mutually_exclusive_group()
    asked.add_argument(
        "--yes",
        action="store_true",
        help="ask nothing: the procedure answers its prompts, the file is written",
    )
    asked.add_argument(
        "--ask", action="store_true", help="ask at this terminal, also on a simulated rig"
    )
    parser.add_argument(
        "--seed", type=int, default=1, metavar="N", help="seed of the simulation (default 1)"
    )
    options.add_runs(parser)
    options.add_about(parser)
    options.add_json(parser)
    options.add_quiet(parser)
    parser.set_defaults(defaults=parser.get_default)


def execute(args: argparse.Namespace) -> int:
    """Run the procedure or take a recording, evaluate it, show the values, ask, write the file."""
    from rigd.model.machine.extras import require

    require("analysis", "rigd calibrate")  # before anything moves
    from rigd.cli.views.calibration import print_renewal, renewal_json
    from rigd.daemon.calibrate import Signature, evaluated, place_of, renewal
    from rigd.model.errors import Exit

    rig = _rig_of(args)
    place = place_of(
        rig, args.write
    )  # fails early if the file cannot be written: a run may take hours
    recording, code = (args.recording, Exit.OK) if args.recording else _run(args, rig)
    if code is not Exit.OK:
        print("rigd: the run did not complete: nothing is calibrated", file=sys.stderr)
        return int(code)
    evaluation = evaluated(
        recording, rig, place, lambda loss: print(f"warning: {loss}", file=sys.stderr)
    )
    signature = Signature.of(evaluation, args.operator, args.valid)
    planned = renewal(rig, place, evaluation, signature)
    if not args.json:
        print_renewal(evaluation, planned)
    agreed = args.yes or _agreed(planned, recording, may_ask=not args.json)
    if agreed:
        planned.write()
    if args.json:
        as_object = renewal_json(evaluation, planned, written=agreed)
        print(json.dumps(as_object, indent=2, allow_nan=False))
    elif agreed:
        _conclude(planned)
    return int(Exit.OK if agreed else Exit.BLOCKED)


def _rig_of(args: argparse.Namespace) -> RigConfig:
    """Return the rig to calibrate: the given rig, or the rig of the recording."""
    from rigd.config.loader import load_rig
    from rigd.daemon.calibrate import check_calibrates
    from rigd.model.errors import ConfigError
    from rigd.record import Recording

    if args.recording is None:
        if args.procedure is None:
            raise ConfigError(
                "no procedure is given",
                hint="rigd calibrate procedures/calibrate_torque.yaml --rig angle-1 "
                "--operator NAME",
            )
        return load_rig(options.rig_of(args, args.procedure))
    if args.procedure is not None:
        raise ConfigError("--from evaluates a recording; remove the procedure")
    of_runs = [f"--{name}" for name in _OF_RUNS
               if getattr(args, name) != args.defaults(name)]  # fmt: skip
    if of_runs:
        raise ConfigError(
            f"{', '.join(of_runs)} would change nothing: --from runs no procedure",
            hint="remove it, or run the procedure again",
        )
    info = Recording.open(args.recording).info
    rig = load_rig(args.rig or info.rig)
    check_calibrates(info, rig)
    return rig


def _run(args: argparse.Namespace, rig: RigConfig) -> tuple[Path, Exit]:
    """Run the procedure; return the recording, and how the run ended."""
    from rigd.analysis.plan import analysis_of, calibrating, judged
    from rigd.cli.rig.playing import conclusion_of, record
    from rigd.daemon.execute import RunRequest
    from rigd.model.errors import ConfigError
    from rigd.procedure.loader import load_procedure

    source = load_procedure(args.procedure)
    overrides = options.read_assignments(args.set)
    procedure = judged(source, rig, overrides)
    plan = procedure.identify
    if plan is None or not analysis_of(plan).measures:
        raise ConfigError(
            f"procedure {procedure.name} calibrates nothing",
            place=source.document.key_place(("identify",)),
            hint=(
                f"its `identify:` block names no model that calibrates: {', '.join(calibrating())}"
            ),
        )
    request = RunRequest(
        procedure, source.file.text, rig, args.seed, folder=args.runs, overrides=overrides,
        about=options.read_about(args.operator, args.note, args.meta, args.specimen),
        procedure_location=source.location,
    )  # fmt: skip
    by_person = args.ask or (rig.plant is None and rig.simulation is None and not args.yes)
    done = record(request, quiet=args.quiet or args.json, by_person=by_person)
    if done.result.exit_code and not args.json:
        conclusion_of(procedure, done).print()
    return done.path, done.result.exit_code


def _agreed(planned: Renewal, recording: Path, *, may_ask: bool) -> bool:
    """Return whether the user agrees to write the file; False without a terminal."""
    from rigd.cli.asking import ask, is_terminal

    if not (may_ask and is_terminal()):
        print(
            "rigd: not written: no terminal to ask at; give --yes\n  rigd calibrate --from "
            f"{quote(str(recording))} --operator NAME --yes",
            file=sys.stderr,
        )
        return False
    question = f"\nWrite this to {planned.new.path}? [yes/no]: "
    sys.stdout.flush()  # the file name is printed above the question
    if ask(question, sys.stdin, sys.stderr).strip().lower() in ("y", "yes"):
        return True
    print("not written", file=sys.stderr)
    return False


def _conclude(planned: Renewal) -> None:
    print(f"\nwrote {planned.new.path}")
    if planned.place.shipped is not None:
        print(
            f"  instead of {planned.place.shipped}: the file shipped with rigd stays as it "
            "is.\n  To use the new file, copy the rig file into this folder: the path in its "
            "`calibration:` is relative to it"
        )


def _person(text: str) -> str:
    if 1 <= len(text.strip()) <= 100:
        return text.strip()
    raise argparse.ArgumentTypeError(
        "add --operator NAME: the person responsible for the calibration"
    )


def _days(text: str) -> int:
    number = text.strip().removesuffix("d")
    if number.isdecimal() and 1 <= int(number) <= 36500:
        return int(number)
    raise argparse.ArgumentTypeError(f"{text!r} is not a number of days such as 365d")
