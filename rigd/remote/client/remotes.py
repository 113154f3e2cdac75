"""Reads the client's list of rigs: endpoint and credentials of each.

    # ~/.config/rigd/remotes.yaml
    remotes:
      lugre-1: {endpoint: tcp/127.0.0.1:7447}
      wire-1:
        endpoint: tls/rig.lab:7447
        tls: {ca: certs/ca.crt, certificate: certs/alice.crt, key: certs/alice.key}

The client does not search the network for rigs. If a rig is not in the list, the client looks for
it on this machine.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

from pydantic import Field

from rigd.config.binding import bind
from rigd.config.document import read_document
from rigd.config.problems import Problems, suggest
from rigd.config.remote import DEFAULT_ENDPOINT, TlsFiles
from rigd.config.source import Identity, Source, TlsSource
from rigd.model.errors import ConfigError
from rigd.remote.client.target import Target, make_target


class RemoteLine(Source):
    """One rig in the list."""

    endpoint: str = DEFAULT_ENDPOINT
    """The address of its daemon, such as tls/rig.lab:7447."""
    tls: TlsSource | None = None
    """Certificates; paths are relative to this file."""
    identity: Identity | None = None
    """The client's name, if there is no certificate; by default that of the user."""


class RemotesSource(Source):
    """The list."""

    remotes: Annotated[dict[Identity, RemoteLine], Field(max_length=256)]
    """Rigs by name."""


@dataclass(frozen=True)
class Remote:
    """A rig of the list."""

    endpoint: str = DEFAULT_ENDPOINT
    tls: TlsFiles | None = None
    identity: str | None = None


def list_path() -> Path:
    """Return the path of the list, by the XDG base directory specification."""
    home = os.environ.get("XDG_CONFIG_HOME") or ""
    base = Path(home) if Path(home).is_absolute() else Path.home() / ".config"
    return base / "rigd" / "remotes.yaml"


def read_remotes() -> Mapping[str, Remote]:
    """Return the list by name; empty if there is none.

    Raises:
        ConfigError: it is wrong; names every problem with its place.
    """
    path = list_path()
    if not path.exists():
        return {}
    problems = Problems()
    source = bind(read_document(path), RemotesSource, problems)
    problems.raise_any()
    lines = {} if source is None else source.remotes
    return {name: _remote(line, path.parent) for name, line in lines.items()}


def find_target(
    rig: str | None = None,
    endpoint: str | None = None,
    tls: TlsFiles | None = None,
    identity: str | None = None,
) -> Target:
    """Return the target for ``rig``: from the list, with the values given here in place of its own.

    Without a name it is the only rig of the list or, if that is empty, the only rig on this
    machine.

    Raises:
        ConfigError: the list or an argument is wrong, or it has several rigs and none is named.
        Refusal: a name is not allowed in a key.
    """
    if endpoint is not None:
        return make_target(rig, endpoint, tls, identity)
    known = read_remotes()
    if rig is None and len(known) > 1:
        raise ConfigError(
            f"which rig? {list_path()} has {', '.join(sorted(known))}", hint="name one (--rig NAME)"
        )
    if rig is None and known:
        rig = next(iter(known))
    found = Remote() if rig is None else known.get(rig, Remote())
    target = make_target(rig, found.endpoint, tls or found.tls, identity or found.identity)
    if rig is None or rig in known or not known:
        return target
    unknown = f"{rig} is not in {list_path()} ({suggest(rig, known)})"
    return replace(target, note=f"{unknown}, so rigd looked for it on this machine; ")


def _remote(line: RemoteLine, folder: Path) -> Remote:
    tls = None
    if line.tls is not None:
        tls = TlsFiles(*(
            (folder / Path(name).expanduser()).absolute()
            for name in (line.tls.ca, line.tls.certificate, line.tls.key)
        ))  # fmt: skip
    return Remote(line.endpoint, tls, line.identity)
