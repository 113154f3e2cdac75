"""``rigd drivers``: lists installed drivers with their options and channels."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from rigd.cli.options import add_json

if TYPE_CHECKING:
    from rich.console import Console

    from rigd.cli.plugins.inventory import InstalledPlugin
    from rigd.model.channels import Channel

HELP = "list installed drivers, links, plants, simulations and observers"
EXAMPLES = """\
examples:
  rigd drivers                        names, kinds and titles
  rigd drivers serial-scale           its options, channels, setpoints and actions
  rigd drivers serial-scale --json

  Any installed package may provide some: see docs/drivers.md and `rigd new driver`.
  Exit code 2: the name does not exist, or the plug-in cannot be loaded.
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("name", nargs="?", metavar="NAME", help="show this plug-in in full")
    add_json(parser, "print everything as JSON")


def execute(args: argparse.Namespace) -> int:
    """List the installed plug-ins; a broken one does not hide the others."""
    from rigd.cli.plugins.inventory import look_at_plugin, points
    from rigd.cli.views.screen import open_console
    from rigd.config.problems import suggest
    from rigd.model.errors import ConfigError, Exit

    everything = list(points())
    wanted = [item for item in everything if args.name in (None, item[1].name)]
    if not everything and not args.json:
        print("no plug-ins are installed", file=sys.stderr)
    if not wanted and args.name is not None:
        names = {point.name for _, point in everything}
        raise ConfigError(
            f"{args.name!r} is not installed",
            hint=suggest(args.name, names) or "`rigd drivers` lists the installed names",
        )
    in_full = args.json or args.name is not None
    found = [look_at_plugin(group, point, in_full=in_full) for group, point in wanted]
    if args.json:
        print(json.dumps([_as_json(item) for item in found], indent=2, ensure_ascii=False))
    elif args.name is None:
        _print_list(open_console(), found)
    else:
        for item in found:
            _print_plugin(open_console(), item)
    broken = args.name is not None and any(item.broken for item in found)
    return int(Exit.BAD_INPUT if broken else Exit.OK)


def _as_json(installed: InstalledPlugin) -> dict[str, Any]:
    from dataclasses import asdict

    data = asdict(installed)
    for option in data["options"]:
        del option["bare"]
    for key in ("channels", "setpoints"):
        for channel in data[key] or ():
            for bound in ("low", "high"):  # JSON has no infinity
                if channel[bound] in (float("inf"), float("-inf")):
                    channel[bound] = None
    return data


def _print_list(console: Console, found: list[InstalledPlugin]) -> None:
    from rich.markup import escape

    from rigd.cli.plugins.inventory import GROUPS, print_list

    for kind in GROUPS.values():
        members = [item for item in found if item.kind == kind.name]
        if members:
            console.print(f"[bold]{kind.name}s[/]   {escape(kind.where)}")
            print_list(console, members, "  ")


def _print_plugin(console: Console, installed: InstalledPlugin) -> None:
    from rich.markup import escape

    from rigd.cli.views.screen import wrapped

    console.print(
        f"[bold]{installed.name}[/]  {installed.kind} of {installed.package} {installed.version}"
    )
    if installed.broken:
        console.print(f"  [red]broken: {escape(installed.broken)}[/]", soft_wrap=True)
        return
    for line in installed.doc.splitlines():
        console.print(wrapped(f"  {line}", console.width), markup=False, soft_wrap=True)
    if installed.kind == "driver":
        needs = (
            f"a link of kind {installed.link_kind!r}"
            if installed.link_kind
            else "no link of the rig file"
        )
        console.print(f"  stands on {needs}")
    rows = [
        (
            option.name,
            "required" if option.required else option.default,
            option.kind,
            option.doc.partition("\n\n")[0].replace("\n", " "),
        )
        for option in installed.options
    ]
    _print_table(console, "options", ("", "default", "takes", ""), rows)
    if installed.kind != "driver":
        return
    if installed.channels is None:
        console.print("channels and setpoints depend on its options")
        return
    of = f" of {installed.example}" if installed.example else ""
    channels = [*map(_channel_row, installed.channels)]
    if installed.has_status:
        words = "".join(f"{word} {mask:#x}, " for word, mask in installed.status_bits.items())
        channels.append(("status", "", "", f"bits of the device: {words}stale 0x80000000"))
    _print_table(console, f"channels{of}", ("", "unit", "range", ""), channels)
    _print_table(
        console,
        f"setpoints{of}",
        ("", "unit", "range", ""),
        [*map(_channel_row, installed.setpoints)],
    )
    _print_table(console, "actions", ("", ""), list(installed.actions.items()))


def _channel_row(channel: Channel) -> tuple[str, str, str, str]:
    shown = f"{channel.low:g} to {channel.high:g}"
    return channel.name, channel.unit, "" if shown == "-inf to inf" else shown, channel.doc


def _print_table(
    console: Console, title: str, columns: tuple[str, ...], rows: Sequence[tuple[str, ...]]
) -> None:
    from rich.markup import escape

    from rigd.cli.views.screen import folding_table, print_table

    if not rows:
        return
    console.print(f"[bold]{title}[/]")
    table = folding_table(*columns)
    for row in rows:
        first, *rest = map(escape, row)
        table.add_row(f"  {first}", *rest)
    print_table(console, table)
