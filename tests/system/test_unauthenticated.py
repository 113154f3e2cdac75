"""Connections that never authenticate do not keep a run, or its clients, from anything."""

from __future__ import annotations

import json
import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import pytest
from support.daemon.process import Daemon, Refused
from support.daemon.served_rig import free_port
from support.wire import ROOT

from rigd.record import Recording
from rigd.remote.tls import SERVER, setup_tls

#: The wheel turns to and fro until it is stopped.
SHAKE = """\
procedure: shake
title: Moves
doc: For tests.
trial:
  steps:
    - step: shake
      set: {wheel_servo.current: {sine: {amplitude: 0.3 A, frequency: 2 Hz}}}
      for: 1 h
finish:
  - step: hold
    set: {wheel_servo.current: 0 A}
    for: 0.2 s
"""
#: Far more than the daemon may have descriptors.
CONNECTIONS = 400
DESCRIPTORS = 128
NAME = "lugre-1"


@pytest.fixture
def daemon(tmp_path: Path) -> Iterator[Daemon]:
    """The shipped simulation, served over TLS by a process that may open little."""
    certificates = tmp_path / "certs"
    setup_tls(certificates, ["localhost", "127.0.0.1"], ["alice"])
    endpoint = f"tls/127.0.0.1:{free_port()}"
    rig = tmp_path / "rig.yaml"
    text = (ROOT / "configs/sim_lugre.yaml").read_text()
    plant = ROOT / "configs/plants/lugre.yaml"
    files = f"{{ca: certs/ca.crt, certificate: certs/{SERVER}.crt, key: certs/{SERVER}.key}}"
    rig.write_text(
        f"{text.replace('plants/lugre.yaml', str(plant))}\n"
        f"remote: {{listen: [{endpoint}], tls: {files}, roles: {{alice: maintainer}}}}\n"
    )
    state = tmp_path / "state"
    state.mkdir(mode=0o700)
    with Daemon(
        rig, NAME, endpoint, tmp_path, state,
        certificates=certificates, descriptors=DESCRIPTORS,
    ) as served:  # fmt: skip
        served.notified("READY=1")
        yield served


@contextmanager
def unauthenticated(daemon: Daemon, first_words: bytes) -> Iterator[None]:
    """Connections that send no more than that, as many as the daemon accepts."""
    host, _, port = daemon.endpoint.partition("/")[2].rpartition(":")
    with ExitStack() as all_of_them:
        for _ in range(CONNECTIONS):
            found = all_of_them.enter_context(socket.socket())
            found.setblocking(False)
            found.connect_ex((host, int(port)))
            with suppress(BlockingIOError):
                found.send(first_words)
        yield


def audited(daemon: Daemon, what: str) -> list[str]:
    """The results of the lines of ``what`` in the audit log."""
    lines = (daemon.runs / f"{NAME}.audit.jsonl").read_text().splitlines()
    return [item["result"] for item in map(json.loads, lines) if item["what"] == what]


@pytest.mark.parametrize("first_words", [b"", b"\x16\x03"], ids=["silent", "half a handshake"])
def test_a_run_ends_in_order_among_unauthenticated_connections(
    daemon: Daemon, first_words: bytes
) -> None:
    recording = daemon.start(SHAKE)
    daemon.until(lambda status: status["step"] == "shake")
    with unauthenticated(daemon, first_words):
        assert daemon.request("stop", "stop", reason="crowded")["acted"]
        last = daemon.until(lambda status: status["last"])["last"]
        assert (last["ending"], last["exit_code"]) == ("stopped", 5)
        daemon.request("cmd", "lease_release")
        assert audited(daemon, "stop") == ["done"]
        assert audited(daemon, "lease_release") == ["done"]
        assert audited(daemon, "audit") == []  # no line is missing
        until_others_connect(daemon)
    assert Recording.open(recording).info.state == "stopped"
    until_others_connect(daemon)
    told = daemon.status["daemon"]
    assert told["descriptors"] < told["descriptors_most"] == DESCRIPTORS
    if first_words:
        assert told["accept_pauses"] > 0
        assert audited(daemon, "unauthenticated")


def until_others_connect(daemon: Daemon) -> None:
    """Wait until a new client is let in."""
    deadline = time.monotonic() + 60
    while True:
        try:
            with daemon.connect() as client:
                assert client.alive("rigd/*/alive") == [f"rigd/{NAME}/alive"]
                return
        except Refused:
            assert time.monotonic() < deadline, daemon.told
