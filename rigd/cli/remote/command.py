"""Defines options and helper functions that the commands of ``rigd remote`` share."""

from __future__ import annotations

import argparse
import json
import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rigd.config.remote import TlsFiles
    from rigd.remote import AsyncClient, Client
    from rigd.remote.client.rigs.target import Target


@dataclass(frozen=True)
class RemoteCommand:
    """One command; ``configure`` adds its own options, ``execute`` returns the exit code."""

    help: str
    execute: Callable[[argparse.Namespace], int]
    configure: Callable[[argparse.ArgumentParser], None] = lambda parser: None
    examples: str = ""
    connects: bool = True
    """Whether the command talks to one rig, and so has the options that find it."""


def add_target(parser: argparse.ArgumentParser) -> None:
    """Add the options that find the rig, and give the client's identity."""
    rig = parser.add_argument_group("the rig")
    rig.add_argument(
        "--rig",
        metavar="NAME",
        help="name of the rig, from ~/.config/rigd/remotes.yaml or else on this machine "
        "(default: the only rig)",
    )
    rig.add_argument("--endpoint", metavar="ADDRESS", help="such as tls/rig.lab:7447")
    rig.add_argument(
        "--ca",
        type=Path,
        metavar="FILE",
        help=("certificate authority of the daemon's certificate"),
    )
    rig.add_argument("--certificate", type=Path, metavar="FILE", help="your own")
    rig.add_argument("--key", type=Path, metavar="FILE", help="the key of your certificate")
    rig.add_argument(
        "--as",
        dest="identity",
        metavar="NAME",
        help="your name, if no certificate gives it (default: your login)",
    )


def connect(args: argparse.Namespace) -> Client:
    """Return a client of the rig that the options name.

    Raises:
        ConfigError: the options contradict each other, or name no rig.
        LinkError: the rig cannot be reached.
    """
    from rigd.remote import Client

    return Client(args.rig, endpoint=args.endpoint, tls=_tls(args), identity=args.identity)


def find(args: argparse.Namespace) -> Target:
    """Return where the rig is that the options name, and who asks.

    Raises:
        ConfigError: the options contradict each other, or name no rig.
    """
    from rigd.remote.client.rigs.target import find_target

    return find_target(args.rig, args.endpoint, _tls(args), args.identity)


def connect_async(args: argparse.Namespace) -> AsyncClient:
    """Return a client of the rig that the options name; it is not connected yet.

    Raises:
        ConfigError: the options contradict each other, or name no rig.
    """
    from rigd.remote import AsyncClient

    return AsyncClient(args.rig, endpoint=args.endpoint, tls=_tls(args), identity=args.identity)


def _tls(args: argparse.Namespace) -> TlsFiles | None:
    from rigd.config.remote import TlsFiles
    from rigd.model.errors import ConfigError

    files: list[Path | None] = [args.ca, args.certificate, args.key]
    given = [path.absolute() for path in files if path is not None]
    if not given:
        return None
    if len(given) < len(files):
        raise ConfigError("--ca, --certificate and --key must be given together")
    return TlsFiles(*given)


def again(args: argparse.Namespace) -> str:
    """Return the options that found the rig, to append to a suggested command."""
    named = {
        "--rig": args.rig,
        "--endpoint": args.endpoint,
        "--ca": args.ca,
        "--certificate": args.certificate,
        "--key": args.key,
        "--as": args.identity,
    }
    given = {option: value for option, value in named.items() if value is not None}
    return "".join(f" {option} {shlex.quote(str(value))}" for option, value in given.items())


def print_json(result: Mapping[str, Any] | Sequence[Any]) -> None:
    """Print a result for a program."""
    print(json.dumps(result, indent=2, ensure_ascii=False))
