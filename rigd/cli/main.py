"""Runs the ``rigd`` command: calls a subcommand and turns errors into messages and exit codes."""

from __future__ import annotations

import argparse
import atexit
import difflib
import gc
import re
import sys
from collections.abc import Sequence
from contextlib import suppress
from types import ModuleType
from typing import Any, Final, NoReturn

from rigd import __version__
from rigd.cli import remote
from rigd.cli.analysis import analyses, compare, design, identify, measure, validate
from rigd.cli.options import name_recordings
from rigd.cli.plugins import can, completion, drivers, new, schema
from rigd.cli.recordings import (
    export,
    filter,
    import_,
    info,
    layout,
    note,
    recover,
    report,
    runs,
    verify,
)
from rigd.cli.rig import calibrate, check, doctor, jog, panel, read, run, serve, sim, tare
from rigd.cli.views.output import OutputLost, screened
from rigd.model.errors import Exit, RigdError
from rigd.model.machine import compiling

#: In the order in which a new user needs them.
COMMANDS: tuple[ModuleType, ...] = (
    run,
    jog,
    read,
    tare,
    report,
    measure,
    identify,
    compare,
    validate,
    design,
    calibrate,
    check,
    runs,
    info,
    note,
    export,
    import_,
    layout,
    filter,
    verify,
    recover,
    doctor,
    serve,
    remote,
    panel,
    sim,
    drivers,
    analyses,
    can,
    new,
    schema,
    completion,
)

#: The error of argparse for an unknown command.
_NO_CHOICE: Final = re.compile(r"invalid choice: '(.*?)' \(choose from (.*)\)")

#: What a person reads on the error output while the first start after an installation compiles.
COMPILING: Final = "rigd: compiles its functions, once after an installation: half a minute"

EPILOG = """\
examples:
  rigd run procedures/quick.yaml --rig configs/sim_lugre.yaml
                                         a first run on the simulated rig
  rigd run procedures/constant_current.yaml --rig lugre-1 --set floor=pvc
                                         ten currents on PVC, recorded to runs/
  rigd identify runs/*constant_current*.mcap
                                         friction parameters with uncertainties, and a report
  rigd check my_procedure.yaml           is this file valid? nothing moves
  rigd doctor --rig wire-1               are this machine and rig fit? nothing moves

exit codes:
  0  done                         4  an interlock or a device fault ended the run
  1  an error inside rigd         5  a person stopped the run before its end
  2  bad arguments or a bad file  6  a step did not end as the procedure demands
  3  blocked: preflight refused   7  a recording cannot be written, read or used, or the
                                     output cannot be written
                                  8  a model does not fit the data, or is rejected
                                  9  a result is rejected, not decided or not read
"""


class Parser(argparse.ArgumentParser):
    """A parser that suggests a command if the given command is missing or unknown.

    The parser of a command refuses itself what it does not know, below its own usage.
    """

    def parse_known_args(self, *args: Any, **named: Any) -> tuple[Any, list[str]]:
        """Return the options; exit with the error if there are arguments beside them."""
        known, unknown = super().parse_known_args(*args, **named)
        if unknown:
            self.error(f"unrecognized arguments: {' '.join(unknown)}")
        return known, unknown

    def error(self, message: str) -> NoReturn:
        """Exit with the error; without a command, print the help."""
        if message == "the following arguments are required: COMMAND":
            self.print_help()
            self.exit(Exit.OK)
        wrong = _NO_CHOICE.search(message)
        if wrong is not None:
            known = re.findall(r"'([^']*)'", wrong[2])
            nearest = difflib.get_close_matches(wrong[1], known, n=1)
            is_command = "COMMAND" in message[: wrong.start()]
            if is_command:
                message = f"unknown command {wrong[1]!r}"
            if nearest:
                meant = f"{self.prog} {nearest[0]}" if is_command else nearest[0]
                message += f", did you mean `{meant}`?"
        super().error(message)


def command_name(command: ModuleType) -> str:
    """Return the name of a command, from that of its module: `import_` is one that Python needs."""
    return command.__name__.rpartition(".")[2].rstrip("_")


def build_parser() -> argparse.ArgumentParser:
    """Return the complete parser; import nothing that only a running command needs."""
    parser = Parser(
        prog="rigd",
        description="Controller and data acquisition for friction and traction test rigs.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"rigd {__version__}")
    parser.add_argument("--debug", action="store_true", help="show tracebacks of errors")
    subparsers = parser.add_subparsers(metavar="COMMAND", required=True)
    for command in COMMANDS:
        name = command_name(command)
        subparser = subparsers.add_parser(
            name,
            help=command.HELP,
            description=command.HELP[0].upper() + command.HELP[1:] + ".",
            epilog=command.EXAMPLES,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        subparser.add_argument(
            "--debug",
            action="store_true",
            default=argparse.SUPPRESS,  # else it would undo the one before the command
            help="show tracebacks of errors",
        )
        command.configure(subparser)
        subparser.set_defaults(execute=command.execute, parser=parser)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code (see :class:`rigd.model.errors.Exit`)."""
    # At its end the interpreter searches all imported modules for garbage: 0.1 s of a check, 0.5 s
    # of a simulated run. What is frozen is left out.
    atexit.register(gc.freeze)
    code = int(Exit.OK)
    try:
        with screened():
            code = _main(argv)
    except OutputLost as lost:
        if lost.unread or lost.why is None:
            return code
        with suppress(OSError), screened():
            print(f"rigd: standard output cannot be written: {lost.why.strerror}", file=sys.stderr)
        return code or int(Exit.BAD_DATA)
    return code


def _main(argv: Sequence[str] | None) -> int:
    args = build_parser().parse_args(argv)
    compiling.announce_once(lambda: print(COMPILING, file=sys.stderr, flush=True))
    try:
        name_recordings(args)
        return int(args.execute(args))
    except RigdError as error:
        if args.debug:
            raise
        print(f"rigd: {error}", file=sys.stderr)
        return int(error.exit_code)
    except OutputLost:
        raise
    except KeyboardInterrupt:
        if args.debug:
            raise
        print("rigd: interrupted", file=sys.stderr)
        return int(Exit.STOPPED)
    except (
        Exception
    ) as error:  # the outermost boundary: an exception here is a bug, and is reported as a bug
        if args.debug:
            raise
        print(
            f"rigd: internal error: {type(error).__name__}: {error}\n  this is a bug in rigd; "
            "--debug prints the traceback",
            file=sys.stderr,
        )
        return int(Exit.INTERNAL)


if __name__ == "__main__":
    sys.exit(main())
