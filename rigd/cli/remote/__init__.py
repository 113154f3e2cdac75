"""``rigd remote``: sends commands to rigs that a daemon serves, on this machine or another."""

from __future__ import annotations

import argparse
from typing import Final

from rigd.cli.remote import lease, look, procedures, recordings, rigs, start, steer, tls
from rigd.cli.remote.command import RemoteCommand, add_target

HELP = "send commands to a rig that `rigd serve` serves, here or on another machine"
EXAMPLES = """\
examples:
  rigd remote list                                 known rigs, reachable or not
  rigd remote start quick --rig lugre-1 --watch
  rigd remote status
  rigd remote stop --reason "wrong floor"          every client may stop
  rigd remote fetch RUN                            continues a broken transfer

Commands hold the control lease for as long as they need it; `rigd remote lease` shows its holder.
A stop is a request. The safety function is the hardware chain of the rig.

exit codes: like rigd; 3 if the daemon refuses, 4 if no daemon answers
"""

#: In the order in which a new user needs them.
COMMANDS: Final[dict[str, RemoteCommand]] = {
    **rigs.COMMANDS,
    **look.COMMANDS,
    **start.COMMANDS,
    **steer.COMMANDS,
    **lease.COMMANDS,
    **recordings.COMMANDS,
    **procedures.COMMANDS,
    **tls.COMMANDS,
}


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the commands."""
    subparsers = parser.add_subparsers(metavar="COMMAND", required=True)
    for name, command in COMMANDS.items():
        subparser = subparsers.add_parser(
            name,
            help=command.help,
            description=command.help[0].upper() + command.help[1:] + ".",
            epilog=command.examples,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        # Given here or before the command; a default here would override the option before it.
        subparser.add_argument(
            "--debug", action="store_true", default=argparse.SUPPRESS, help=argparse.SUPPRESS
        )
        command.configure(subparser)
        if command.connects:
            add_target(subparser)
        subparser.set_defaults(remote=command)


def execute(args: argparse.Namespace) -> int:
    """Execute the command."""
    command: RemoteCommand = args.remote
    return command.execute(args)
