"""``rigd serve``: the daemon of a rig."""

from __future__ import annotations

import argparse
import faulthandler
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # imported when it is needed: a command line that only prints help is quick
    from rigd.config.rig import RigConfig

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
        "--panel-port",
        type=int,
        metavar="PORT",
        help="where the panel is found (default 8423, or another where that is taken)",
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
    # A service manager ends a daemon that hangs by SIGABRT: then each thread says where it stood.
    faulthandler.enable()
    from rigd.config.loader import load_rig
    from rigd.config.shipped import titled
    from rigd.daemon.serve import DaemonOptions, logging_to, serve
    from rigd.model.errors import Exit

    rig = load_rig(args.rig)
    options = DaemonOptions(
        rig,
        args.runs.absolute(),
        args.procedures.absolute(),
        monitored=args.monitor,
        foxglove=args.foxglove,
        panel=_panel_of(rig, args.runs.absolute(), args.panel_port) if args.panel else (),
    )
    print(f"rig {titled(rig.name, rig.source.whence)}", flush=True)
    with logging_to(sys.stderr, as_json=None if args.log == "auto" else args.log == "json"):
        serve(options, lambda line: print(line, flush=True))
    return int(Exit.OK)


def _panel_of(rig: RigConfig, runs: Path, page_port: int | None) -> Sequence[str]:
    """Return the command that starts a panel for browsers of this machine.

    Where clients need certificates, the panel's own (``panel.crt``) lies beside the daemon's.

    Raises:
        ConfigError: it does not.
    """
    from rigd.cli.panel import IDENTITY
    from rigd.engine.child import module
    from rigd.engine.shared.folder import folder_name
    from rigd.model.errors import ConfigError
    from rigd.remote.tls import HERE, files_of

    protocol, _, address = rig.remote.listen[0].partition("/")
    host, _, port = address.rpartition(":")
    host = HERE if host in ("0.0.0.0", "[::]") else host
    command = module("rigd", "panel", "--rig", rig.name)
    command += ["--endpoint", f"{protocol}/{host}:{port}"]
    command += ["--sessions", str(runs / f"{folder_name(rig.name)}.panel.json")]
    if page_port is not None:
        command += ["--port", str(page_port)]
    if rig.remote.tls is not None:
        files = files_of(rig.remote.tls.certificate.parent, IDENTITY)
        if not files.certificate.is_file():
            raise ConfigError(
                f"the panel has no certificate: there is no {files.certificate}",
                hint=f"make one for a client named {IDENTITY} by rigd remote setup-tls and give "
                "it a role in the rig file, or start without: --no-panel",
            )
        command += ["--ca", str(rig.remote.tls.ca), "--certificate", str(files.certificate)]
        command += ["--key", str(files.key)]
    return command
