"""``rigd serve``: the daemon of a rig."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

HELP = "serve a rig to those who steer it from elsewhere, and to the panel"
EXAMPLES = """\
examples:
  rigd serve --rig configs/sim_lugre.yaml         prints the panel's address
  rigd serve --rig wire-1 --no-panel --foxglove
  rigd remote start procedures/quick.yaml --rig lugre-1 --watch       in another terminal

It listens on this machine only, unless the rig file opens it up (`remote:`). Ctrl-C and SIGTERM
stop the run under way, then `finish` plays, and the file is finished; once more aborts, a third
time drops power. Recordings, the audit log and what has tripped are kept in --runs.
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("--rig", required=True, metavar="RIG", help="rig file, or the name in it")
    parser.add_argument(
        "--runs", type=Path, default=Path("runs"), metavar="FOLDER", help="folder of recordings"
    )
    parser.add_argument(
        "--procedures",
        type=Path,
        default=Path("procedures"),
        metavar="FOLDER",
        help="folder of your own procedures, offered beside the shipped ones",
    )
    parser.add_argument(
        "--panel",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="start a panel for browsers of this machine (default: yes)",
    )
    parser.add_argument(
        "--foxglove",
        type=int,
        nargs="?",
        const=8765,
        metavar="PORT",
        help="serve the live streams to the Foxglove app on this machine (default port 8765)",
    )
    parser.add_argument(
        "--monitor",
        action="store_true",
        help="show the channels between runs too; keeps the devices open, unarmed",
    )
    parser.add_argument(
        "--log",
        choices=("auto", "text", "json"),
        default="auto",
        help="lines for people, or JSON (auto: JSON where standard error is no terminal)",
    )


def execute(args: argparse.Namespace) -> int:
    """Serve until a signal."""
    from rigd.config.loader import load_rig
    from rigd.daemon.serve import Options, logging_to, serve
    from rigd.model.errors import Exit

    rig = load_rig(args.rig)
    options = Options(
        rig,
        args.runs.absolute(),
        args.procedures.absolute(),
        monitored=args.monitor,
        foxglove=args.foxglove,
    )
    with logging_to(sys.stderr, as_json=None if args.log == "auto" else args.log == "json"):
        serve(options, lambda line: print(line, flush=True))
    return int(Exit.OK)
