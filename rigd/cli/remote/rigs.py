"""``rigd remote list``: lists the rigs that this computer can reach."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from rigd.cli.options import add_json
from rigd.cli.remote.command import RemoteCommand, print_json

if TYPE_CHECKING:
    from rigd.remote.client.discovery import DiscoveredRig


def _execute(args: argparse.Namespace) -> int:
    import asyncio

    from rigd.model.machine.system import on_linux
    from rigd.remote.client.discovery import discover_rigs

    served = {}
    if on_linux():  # no other system serves rigs
        from rigd.engine.shared import served_rigs

        served = served_rigs()
    found = asyncio.run(discover_rigs(served))
    if args.json:
        print_json([_as_json(item) for item in found])
    else:
        show_rigs(found)
    return 0


def show_rigs(found: list[DiscoveredRig]) -> None:
    """Print a line for each rig, or what to do if there is none."""
    from rich.markup import escape

    from rigd.cli.views.screen import folding_table, open_console, print_table
    from rigd.config.remote import DEFAULT_ENDPOINT
    from rigd.remote.client.rigs.address import list_path

    console = open_console()
    if not found:
        console.print(
            f"no rig at {DEFAULT_ENDPOINT}, and no entry in {escape(str(list_path()))}\n"
            "  `rigd serve --rig RIG` serves a rig; a rig of another computer or user at another "
            "address needs an entry, as in `rigd remote list --help`",
            soft_wrap=True,
        )
        return
    table = folding_table("rig", "address", "state", "procedure", "trials", "control", "title")
    for item in found:
        status = item.status
        if status is None:
            silent = "[red]not reached[/]"
            table.add_row(escape(item.rig), escape(item.endpoint), silent, "", "", "",
                          escape(item.problem))  # fmt: skip
            continue
        trials = f"{status.trials_done}/{status.trials_total}" if status.procedure else ""
        texts = (
            item.rig,
            item.endpoint,
            status.state,
            status.procedure or "",
            trials,
            str(status.lease.holder or ""),
            status.title,
        )
        table.add_row(*map(escape, texts))
    print_table(console, table)


def _as_json(seen: DiscoveredRig) -> dict[str, object]:
    from rigd.remote.protocol import as_json

    status = None if seen.status is None else as_json(seen.status)
    return {
        "rig": seen.rig,
        "endpoint": seen.endpoint,
        "alive": seen.status is not None,
        "problem": seen.problem or None,
        "status": status,
    }


COMMANDS = {
    "list": RemoteCommand(
        "list the known rigs, reachable or not",
        _execute,
        add_json,
        """\
The command asks the addresses in ~/.config/rigd/remotes.yaml, those at which you serve a rig on
this computer (`rigd serve`), and tcp/127.0.0.1:7447, nothing else. An entry gives other commands
the address and the certificates of a rig by its name:

  remotes:
    lugre-1: {endpoint: tcp/127.0.0.1:7447}
    wire-1:
      endpoint: tls/rig.lab:7447
      tls: {ca: certs/ca.crt, certificate: certs/alice.crt, key: certs/alice.key}
""",
        connects=False,
    )
}
