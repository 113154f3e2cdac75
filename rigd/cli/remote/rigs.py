"""``rigd remote list``: lists the rigs that this computer can reach."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

from rigd.cli.remote.command import RemoteCommand, add_json, print_json

if TYPE_CHECKING:
    from rigd.remote.client.discovery import DiscoveredRig


def _execute(args: argparse.Namespace) -> int:
    import asyncio

    from rigd.remote.client.discovery import discover_rigs

    found = asyncio.run(discover_rigs())
    if args.json:
        print_json([_as_json(item) for item in found])
    else:
        _print(found)
    return 0


def _print(found: list[DiscoveredRig]) -> None:
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    from rigd.cli.screen import print_table
    from rigd.remote.client.remotes import list_path

    console = Console(highlight=False, width=None if sys.stdout.isatty() else 400)
    if not found:
        console.print(
            f"no rig on this machine, and none in {escape(str(list_path()))}\n"
            "  rigd serve --rig RIG serves one",
            soft_wrap=True,
        )
        return
    table = Table(box=None, pad_edge=False)
    for name in ("rig", "address", "state", "procedure", "trials", "control", "title"):
        table.add_column(name, overflow="fold")
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
            status.lease.holder or "",
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
        "list the rigs that this computer knows, alive or not",
        _execute,
        add_json,
        """\
Asked are the addresses in ~/.config/rigd/remotes.yaml and this machine; nothing else is searched.

  remotes:
    lugre-1: {endpoint: tcp/127.0.0.1:7447}
    wire-1:
      endpoint: tls/rig.lab:7447
      tls: {ca: certs/ca.crt, certificate: certs/alice.crt, key: certs/alice.key}
""",
        connects=False,
    )
}
