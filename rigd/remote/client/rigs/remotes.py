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

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

from pydantic import Field

from rigd.config.binding import bind
from rigd.config.document import read_document
from rigd.config.problems import Problems
from rigd.config.remote import DEFAULT_ENDPOINT, TlsFiles
from rigd.config.source import Identity, Source, TlsSource
from rigd.remote.client.rigs.address import Remote, list_path


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


def _remote(line: RemoteLine, folder: Path) -> Remote:
    tls = None
    if line.tls is not None:
        tls = TlsFiles(*(
            (folder / Path(name).expanduser()).absolute()
            for name in (line.tls.ca, line.tls.certificate, line.tls.key)
        ))  # fmt: skip
    return Remote(line.endpoint, tls, line.identity)
