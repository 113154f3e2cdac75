"""``rigd can``: reads EDS files, which describe CAN devices; opens no connection."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from rigd.cli.options import add_json

if TYPE_CHECKING:
    from rigd.sdk import DeviceSheet

HELP = "check and show the EDS or DCF of a CANopen device"
EXAMPLES = """\
examples:
  rigd can eds drive.eds              is the file valid, and which device does it describe?
  rigd can eds drive.eds --objects    every object, with type, access and limits
  rigd can eds drive.eds --json
  rigd can eds eds/rigd_servo.eds     the file of the simulated drives

A device of a rig file names it as `options: {eds: drive.eds}`: see docs/devices.md.
Exit code 2: the file is wrong; every problem is named with its line.
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the commands."""
    commands = parser.add_subparsers(metavar="COMMAND", required=True)
    eds = commands.add_parser("eds", help=HELP, description=HELP[0].upper() + HELP[1:] + ".")
    eds.add_argument(
        "file", metavar="FILE", help=("an EDS or DCF file (CiA 306), your own or a shipped one")
    )
    eds.add_argument("--objects", action="store_true", help="list every object")
    add_json(eds, "print everything as JSON")


def execute(args: argparse.Namespace) -> int:
    """Read the file and print its contents."""
    import json
    from dataclasses import asdict
    from pathlib import Path

    from rigd.config.registry import find_link
    from rigd.model.errors import Exit
    from rigd.sdk import shipped_configs

    path, shipped = Path(args.file), shipped_configs()
    there = (each for each in (path, shipped.parent / path, shipped / path) if each.is_file())
    sheet = find_link("can").read_sheet(next(there, path))
    if args.json:
        print(json.dumps(asdict(sheet), indent=2, ensure_ascii=False))
    else:
        _print(sheet, objects=args.objects)
    return int(Exit.OK)


def _print(sheet: DeviceSheet, *, objects: bool) -> None:
    from rich.markup import escape
    from rich.table import Table

    from rigd.cli.views.screen import open_console, print_table

    console = open_console()
    for name, fact in sheet.facts.items():
        console.print(f"{name:<16}{escape(fact)}")
    for remark in sheet.remarks:
        console.print(f"[yellow]remark[/]          {escape(remark)}")
    if objects:
        table = Table(*sheet.columns, box=None, pad_edge=False)
        for row in sheet.objects:
            table.add_row(*map(escape, row))
        print_table(console, table)
