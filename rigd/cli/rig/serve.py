"""``rigd serve``: runs the daemon of a rig, which supervises runs and serves clients."""

from __future__ import annotations

import argparse
import faulthandler
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rigd.cli.options import add_rig, add_runs, port, rig_of
from rigd.cli.views.output import outlive_output

if TYPE_CHECKING:  # imported when it is needed: a command line that only prints help is quick
    from rigd.config.rig import RigConfig

HELP = "serve a rig to remote clients and to the panel"
EXAMPLES = """\
examples:
  rigd serve --rig configs/sim_lugre.yaml         prints the panel's address
  rigd serve --rig wire-1 --no-panel --foxglove
  rigd remote start quick --rig lugre-1 --watch             in another terminal

The daemon listens on this machine only, unless `remote:` in the rig file adds addresses. Ctrl-C and
SIGTERM stop the run in progress, then `finish` plays, and the file is completed; a second signal
aborts, a third drops power. Recordings, the audit log and trips are kept in --runs.
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    add_rig(parser)
    add_runs(parser)
    parser.add_argument(
        "--procedures",
        type=Path,
        metavar="FOLDER",
        help="folder of your own procedures, offered together with the shipped ones (default: "
        "procedures)",
    )
    parser.add_argument(
        "--panel",
        action=argparse.BooleanOptionalAction,
        help="start a panel for browsers of this machine (default: if its extra is installed)",
    )
    parser.add_argument(
        "--panel-port",
        type=port,
        metavar="PORT",
        help="port of the panel (default 8423, or a free port if 8423 is in use)",
    )
    parser.add_argument(
        "--foxglove",
        type=port,
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
        help="lines for people, or JSON (auto: JSON if standard error is not a terminal)",
    )


def execute(args: argparse.Namespace) -> int:
    """Serve until a signal."""
    from rigd.model.machine.system import require_linux

    require_linux("`rigd serve`")
    # A service manager ends a hanging daemon by SIGABRT: each thread then prints its stack.
    faulthandler.enable()
    from rigd.config.loader import load_rig
    from rigd.config.shipped_files import titled
    from rigd.daemon.serve import DaemonOptions, logging_to, serve
    from rigd.model.errors import ConfigError, Exit
    from rigd.model.machine.extras import is_installed, missing, require

    outlive_output()
    if args.panel:
        require("panel", "rigd serve --panel")
    has_panel = args.panel is not False and is_installed("panel")
    rig = load_rig(rig_of(args))
    if args.procedures is not None and not args.procedures.is_dir():
        raise ConfigError(
            f"there is no folder {args.procedures}", hint="make it, or leave --procedures out"
        )
    options = DaemonOptions(
        rig,
        args.runs.absolute(),
        (args.procedures or Path("procedures")).absolute(),
        monitored=args.monitor,
        foxglove=args.foxglove,
        panel=_panel_of(rig, args.runs.absolute(), args.panel_port) if has_panel else (),
    )
    print(f"rig {titled(rig.name, rig.source.location)}", flush=True)
    if args.panel is None and not has_panel:
        print(f"no panel: {missing('it', 'panel')}", flush=True)
    with logging_to(sys.stderr, as_json=None if args.log == "auto" else args.log == "json"):
        serve(options, lambda line: print(line, flush=True))
    return int(Exit.OK)


def _panel_of(rig: RigConfig, runs: Path, page_port: int | None) -> Sequence[str]:
    """Return the command that starts a panel for browsers of this machine.

    If clients need certificates, the panel's own (``panel.crt``) is in the folder of the daemon's.

    Raises:
        ConfigError: it is missing.
    """
    from rigd.cli.rig.panel import IDENTITY
    from rigd.engine.shared.folder import folder_name
    from rigd.engine.system.child import module
    from rigd.model.errors import ConfigError
    from rigd.remote.tls import files_of

    command = module("rigd", "panel", "--rig", rig.name)
    command += ["--endpoint", rig.remote.endpoint]
    command += ["--sessions", str(runs / f"{folder_name(rig.name)}.panel.json")]
    if page_port is not None:
        command += ["--port", str(page_port)]
    if rig.remote.tls is not None:
        files = files_of(rig.remote.tls.certificate.parent, IDENTITY)
        if not files.certificate.is_file():
            raise ConfigError(
                f"the panel has no certificate: {files.certificate} does not exist",
                hint=f"make a certificate for a client named {IDENTITY} with `rigd remote "
                "setup-tls` and give it a role in the rig file, or start without a "
                "panel: --no-panel",
            )
        command += ["--ca", str(rig.remote.tls.ca), "--certificate", str(files.certificate)]
        command += ["--key", str(files.key)]
    return command
