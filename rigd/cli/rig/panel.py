"""``rigd panel``: serves the operator's page for a rig."""

from __future__ import annotations

import argparse
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path

from rigd.cli.options import port
from rigd.cli.remote.command import add_target, connect_async
from rigd.cli.views.output import outlive_output

HELP = "serve the operator's page of a rig to browsers"
EXAMPLES = """\
examples:
  rigd panel                                 of the only rig on this machine
  rigd panel --rig lugre-1 --port 8500
  rigd panel --rig wire-1 --host 0.0.0.0 --name rig.lab \\
      --https-certificate certs/panel.crt --https-key certs/panel.key

`rigd serve` starts a panel by itself; this command starts another panel, here or on another
machine. The panel is a client like every other and finds its rig in the same way. The command
prints a link that admits a single browser, once; an open page can invite others. Without --host the
panel listens on this machine only; for other machines it needs a certificate.
"""

#: The client name of a panel on the rig's own machine.
IDENTITY = "panel"


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    add_target(parser)
    page = parser.add_argument_group("the page")
    page.add_argument("--host", default="127.0.0.1", help="address to listen on (127.0.0.1)")
    page.add_argument("--port", type=port, help=("default 8423, or a free port if 8423 is in use"))
    page.add_argument(
        "--name",
        action="append",
        default=[],
        metavar="NAME",
        help="name by which browsers reach the panel",
    )
    page.add_argument("--https-certificate", type=Path, metavar="FILE", help="for browsers")
    page.add_argument("--https-key", type=Path, metavar="FILE", help="the key of that certificate")
    page.add_argument(
        "--sessions", type=Path, metavar="FILE", help="file that keeps logins across a restart"
    )
    page.add_argument(
        "--links",
        type=Path,
        metavar="FILE",
        help=("write the links to this file instead of printing them"),
    )
    page.add_argument(
        "--spare",
        action="store_true",
        help="load everything, then wait for a line on standard input before serving",
    )


def execute(args: argparse.Namespace) -> int:
    """Serve until a signal."""
    from rigd.model.machine.system import require_linux

    require_linux("`rigd panel`")
    from rigd.model.machine.extras import require

    require("panel", "rigd panel")
    import asyncio
    import signal
    import sys

    import zenoh  # noqa: F401 - loaded before a spare waits, not after

    from rigd.engine.system.realtime import prefer
    from rigd.model.errors import Exit
    from rigd.panel.login.session_store import SessionStore
    from rigd.panel.server import Listen, serve

    if args.certificate is None and args.identity is None:
        args.identity = IDENTITY
    client = connect_async(args)
    listen = Listen(args.host, args.port, tuple(args.name), args.https_certificate, args.https_key)

    if args.spare and not sys.stdin.readline():
        return int(Exit.OK)  # the daemon that started the spare panel has ended

    store = None if args.sessions is None else SessionStore(args.sessions)

    async def panel() -> None:
        async with client as rig:
            await serve(
                rig.connection, listen, lambda links: _announce(rig.rig, links, args.links), store
            )

    async def until_signal() -> None:
        serving = asyncio.ensure_future(panel())
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            asyncio.get_running_loop().add_signal_handler(number, serving.cancel)
        await asyncio.wait([serving])
        if not serving.cancelled():
            serving.result()

    outlive_output()
    prefer()
    asyncio.run(until_signal())
    return int(Exit.OK)


def _announce(rig: str, links: Mapping[str, str], path: Path | None) -> None:
    """Print the links for the user or program that started the panel; keep them out of logs."""
    if path is None and "JOURNAL_STREAM" in os.environ:  # systemd writes printed lines to its log
        folder = os.environ.get("RUNTIME_DIRECTORY", "").partition(":")[0] or tempfile.gettempdir()
        path = Path(folder) / f"rigd-panel-{rig}.links"
    if path is None:
        print(f"panel of {rig}: {links['operator']}")
        print(
            f"  to watch only: {links['observer']}", "  each link works once", sep="\n", flush=True
        )
        return
    text = "".join(f"{role} {link}\n" for role, link in links.items())
    # A file that other users cannot read from its first byte on.
    with tempfile.NamedTemporaryFile("w", dir=path.parent, prefix=path.name, delete=False) as file:
        file.write(text)
    Path(file.name).replace(path)
    print(f"panel of {rig}: its links are in {path}", flush=True)
