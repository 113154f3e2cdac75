"""Rigs that are served, with and without certificates."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from support.daemon.served_rig import Served, free_port, serve

from rigd.config.remote import RemoteSetup
from rigd.remote.tls import SERVER, files_of, setup_tls


@pytest.fixture(scope="session")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The certificates of a lab."""
    folder = tmp_path_factory.mktemp("certificates")
    setup_tls(folder, ["localhost", "127.0.0.1"], ["alice", "bob", "carol", "mallory"])
    return folder


@pytest.fixture(scope="module")
def over_tls(certificates: Path) -> Iterator[Served]:
    """A rig for an operator, an observer and a maintainer; mallory has no role on it."""
    setup = RemoteSetup(
        (f"tls/127.0.0.1:{free_port()}",),
        files_of(certificates, SERVER),
        {"alice": "operator", "bob": "observer", "carol": "maintainer"},
    )
    with serve(setup, certificates) as served:
        yield served


@pytest.fixture(scope="module")
def on_loopback() -> Iterator[Served]:
    """A rig as it is served unless its file overrides it."""
    with serve() as served:
        yield served
