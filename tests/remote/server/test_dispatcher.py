"""What becomes of a request between its arrival and its answer."""

from __future__ import annotations

import json
import time
from contextlib import suppress
from typing import Any

import pytest
from support.daemon.served_rig import key, request
from support.panel.played_rig import PlayedRig

from rigd.config.remote import RemoteSetup
from rigd.remote.protocol import Keys
from rigd.remote.protocol.limits import ASK_BURST, ASK_PER_S, FRESH_S
from rigd.remote.server.dispatcher import Dispatcher
from rigd.remote.server.refusal_log import Refused, TooManyQuestions


class Desk:
    """A dispatcher, and clocks that stand until they are moved."""

    def __init__(self) -> None:
        self.began_ns = time.time_ns()
        self.now_ns = 0
        self.rig = PlayedRig()
        self.rig.hold_lease("alice")
        self.dispatcher = Dispatcher(
            Keys("lugre-1"),
            RemoteSetup(("tcp/127.0.0.1:1",), roles={}),
            self.rig,
            self.rig.lease,
            Refused(),
            clock=lambda: self.now_ns,
            wall=lambda: self.began_ns + self.now_ns,
        )
        self.pass_s(60.0)

    def pass_s(self, seconds: float) -> None:
        self.now_ns += round(seconds * 1e9)

    def code(self, verb: str, payload: bytes, waits_s: float) -> Any:
        """Return the code of the refusal of a request that waits for its turn; "" if none."""
        routed = self.dispatcher.sort(key("cmd", "alice", verb), payload)
        self.pass_s(waits_s)
        said = json.loads(self.dispatcher.answer(routed).payload)
        return said.get("error", {}).get("code", "")


@pytest.fixture
def desk() -> Desk:
    return Desk()


def sent(desk: Desk, verb: str) -> bytes:
    return request(verb, sent_ns=desk.began_ns + desk.now_ns)


def test_dry_run_may_wait_for_another(desk: Desk) -> None:
    payload = sent(desk, "dry_run")
    assert desk.code("dry_run", payload, waits_s=FRESH_S + 1) == ""
    assert desk.code("dry_run", payload, waits_s=800.0) == ""  # answered from memory
    assert desk.rig.verbs() == ["dry_run"]
    desk.pass_s(200.0)
    assert desk.code("dry_run", sent(desk, "dry_run"), waits_s=0.0) == ""  # forgets the first
    assert desk.code("dry_run", payload, waits_s=0.0) == "replayed"
    assert desk.rig.verbs() == ["dry_run", "dry_run"]


def test_start_that_waited_too_long_is_refused(desk: Desk) -> None:
    assert desk.code("start", sent(desk, "start"), waits_s=FRESH_S + 1) == "replayed"
    assert desk.rig.verbs() == []


def asked(desk: Desk, count: int, identity: str = "eve", session: str = "") -> int:
    """Return how many of some questions, asked at once, are answered."""
    answered = 0
    for _ in range(count):
        with suppress(TooManyQuestions):
            desk.dispatcher.sort(key("ask", identity, "latest"), b"", session)
            answered += 1
    return answered


def test_client_beyond_its_rate_hinders_no_other(desk: Desk) -> None:
    assert asked(desk, 2000) == ASK_BURST
    assert asked(desk, 10, "bob") == 10
    desk.pass_s(1.0)
    assert asked(desk, 2000) == pytest.approx(ASK_PER_S, abs=1)
    assert desk.code("pause", sent(desk, "pause"), waits_s=0.0) == ""  # commands have no rate


def test_session_without_certificate_has_one_rate(desk: Desk) -> None:
    assert sum(asked(desk, 100, f"mallory{number}", "ab") for number in range(20)) == ASK_BURST
    assert asked(desk, 10, "mallory1", "cd") == 10


def test_stops_have_no_rate(desk: Desk) -> None:
    for _ in range(2000):
        desk.dispatcher.sort(key("stop", "eve", "stop"), b"")
