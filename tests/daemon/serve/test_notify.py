"""Messages to the service manager, read by a socket of our own in its place."""

from __future__ import annotations

import logging
import os
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from rigd.daemon.serve.upkeep.notify import Notifier


@pytest.fixture(params=["path", "abstract"])
def manager(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[socket.socket, str]]:
    name = str(tmp_path / "notify")
    shown = name if request.param == "path" else f"@rigd-test-{os.getpid()}"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as link:
        link.bind(shown.replace("@", "\0"))
        link.settimeout(10)
        yield link, shown


def test_service_manager_gets_start_life_and_end(manager: tuple[socket.socket, str]) -> None:
    link, name = manager
    with Notifier({"NOTIFY_SOCKET": name}) as notifier:
        notifier.ready()
        notifier.alive("quick: running, 1 of 3 trials")
        notifier.alive("quick: running, 1 of 3 trials")  # too soon after the other to be sent
        notifier.hanging("no descriptor is left")
        notifier.ending()
    assert link.recv(1000) == b"READY=1"
    assert link.recv(1000) == b"WATCHDOG=1\nSTATUS=quick: running, 1 of 3 trials"
    assert link.recv(1000) == b"STATUS=clients are not served any more: no descriptor is left"
    assert link.recv(1000) == b"STOPPING=1\nSTATUS=ending"


def test_notifier_without_manager_sends_nothing() -> None:
    with Notifier({}) as notifier:
        notifier.ready()


def test_missing_service_manager_is_logged_once(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    gone = Notifier({"NOTIFY_SOCKET": str(tmp_path / "gone")})
    with gone as notifier, caplog.at_level(logging.WARNING):
        notifier.ready()
        notifier.alive("idle")
    assert len(caplog.records) == 1
