"""``rigd remote setup-tls``: creates the certificates for the daemons and clients of a lab."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from rigd.cli.options import add_json
from rigd.cli.remote.command import RemoteCommand, print_json


def _configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", type=Path, help="folder for the files; created if missing")
    parser.add_argument(
        "--host",
        action="append",
        default=[],
        metavar="NAME",
        help="name or address by which clients reach the rig; may be repeated",
    )
    parser.add_argument(
        "--client",
        action="append",
        default=[],
        metavar="NAME",
        help="name of a client that gets a certificate; may be repeated",
    )
    add_json(parser)


def _execute(args: argparse.Namespace) -> int:
    from rigd.model.errors import ConfigError
    from rigd.remote.tls import setup_tls

    if not args.host and not (args.folder / "rigd.crt").exists():
        raise ConfigError("the name or address of the rig is missing", hint="--host rig.lab")
    made = setup_tls(args.folder, args.host, args.client)
    if args.json:
        kinds = {"made": made.files, "kept": made.kept}
        print_json({kind: [str(file) for file in files] for kind, files in kinds.items()})
        return 0
    for path in made.files:
        print(f"made  {path}")
    for path in made.kept:
        print(f"kept  {path}")
    print(_advice(args.folder.absolute(), args.host, args.client))
    return 0


def _advice(folder: Path, hosts: Sequence[str], clients: Sequence[str]) -> str:
    host = hosts[0] if hosts else "HOST"
    name = clients[0] if clients else "NAME"
    roles = ", ".join(f"{client}: ROLE" for client in clients) or "NAME: ROLE"
    return f"""
in the rig file, on the machine of the rig:
  remote:
    listen: [tls/0.0.0.0:7447]
    tls: {{ca: {folder}/ca.crt, certificate: {folder}/rigd.crt, key: {folder}/rigd.key}}
    roles: {{{roles}}}          # ROLE: observer, operator or maintainer

for each client, in ~/.config/rigd/remotes.yaml, beside ca.crt and the client's own two files:
  remotes:
    RIG:
      endpoint: tls/{host}:7447
      tls: {{ca: ca.crt, certificate: {name}.crt, key: {name}.key}}

Keep ca.key secret and off the network; give each client only its own key."""


COMMANDS = {
    "setup-tls": RemoteCommand(
        "make certificates for a lab: an authority, one for the rig, and one for each client",
        _execute,
        _configure,
        """\
examples:
  rigd remote setup-tls certs --host rig.lab --host 192.168.0.7 --client alice --client panel
  rigd remote setup-tls certs --client bob        another client, later; existing files are kept
""",
        connects=False,
    )
}
