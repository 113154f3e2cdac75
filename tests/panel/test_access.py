"""Nothing reaches the rig that does not come from the panel's own page and a session of its own."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path
from socket import create_connection
from time import monotonic

import pytest
from support.panel.played_campaign import RECORDING
from support.panel.served import ServedPanel, Visitor
from websockets.exceptions import ConnectionClosed, InvalidStatus

from rigd.model.errors import ConfigError
from rigd.panel.login import sessions
from rigd.panel.server import Listen
from rigd.remote.request_rates import Bucket


@pytest.fixture
def panel() -> Iterator[ServedPanel]:
    with ServedPanel() as served:
        yield served


def changes(panel: ServedPanel) -> int:
    return panel.rig.changes


def test_link_works_once_and_its_code_stays_secret(panel: ServedPanel) -> None:
    link = panel.links["operator"]
    address, _, code = link.partition("#")
    assert "?" not in address and len(code) >= 40
    first, second = Visitor(panel), Visitor(panel)
    assert first.login(code) == 200
    assert second.login(code) == 403
    assert second.post("/api/ask/describe", args={})[0] == 401


def test_cookie_is_unreachable_for_scripts_and_other_sites(panel: ServedPanel) -> None:
    code = panel.links["operator"].partition("#")[2]
    body = json.dumps({"code": code, "name": "Ada"}).encode()
    _, headers, _ = Visitor(panel).send("POST", "/api/login", body)
    cookie = headers["set-cookie"].lower()
    assert "httponly" in cookie and "samesite=strict" in cookie
    assert cookie.startswith(f"rigd-{panel.port}="), "cookies do not know ports"


@pytest.mark.parametrize(
    ("header", "status"),
    [
        ({"origin": "http://evil.example"}, 403),
        ({"origin": "http://127.0.0.1:1"}, 403),
        ({"origin": "null"}, 403),
        ({"origin": None}, 403),
        ({"x-rigd": None}, 403),
        ({"host": "evil.example"}, 421),
        ({"host": None}, 421),
        ({"content-type": "text/plain"}, 415),
        ({"content-type": "application/x-www-form-urlencoded"}, 415),
        ({"content-length": None}, 411),
        ({"cookie": None}, 401),
        ({"cookie": "rigd=1"}, 401),
    ],
)
@pytest.mark.parametrize("path", ["/api/stop/estop", "/api/command/lease_take", "/api/invite"])
def test_request_from_elsewhere_changes_nothing(
    panel: ServedPanel, path: str, header: dict[str, str | None], status: int
) -> None:
    visitor = panel.visitor()
    before = len(panel.rig.requests)
    assert visitor.send("POST", path, b"{}", **header)[0] in (status, 400)
    assert panel.rig.lease.view().holder is None
    verbs = {item.verb.name for item in panel.rig.requests[before:]}
    assert verbs <= {"describe", "events", "latest"}, verbs


def test_a_body_that_is_too_long_is_refused(panel: ServedPanel) -> None:
    body = json.dumps({"args": {"x": "y" * 100_000}}).encode()
    assert panel.visitor().send("POST", "/api/command/dry_run", body)[0] == 413


def test_reading_an_address_never_changes_anything(panel: ServedPanel) -> None:
    visitor = panel.visitor()
    for path in ("/api/stop/stop", "/api/command/start", "/api/command/lease_take", "/api/logout"):
        assert visitor.get(path)[0] == 405
    assert changes(panel) == 0


def test_the_page_may_load_nothing_from_elsewhere(panel: ServedPanel) -> None:
    status, headers, body = Visitor(panel).get("/")
    assert status == 200
    policy = headers["content-security-policy"]
    assert "default-src 'none'" in policy and "script-src 'self'" in policy
    assert "unsafe" not in policy and "frame-ancestors 'none'" in policy
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["referrer-policy"] == "no-referrer"
    assert b"http" not in body.replace(b"http-equiv", b"")
    assert b"style=" not in body and b"<script>" not in body


def test_a_report_is_a_page_without_rights(panel: ServedPanel) -> None:
    run = panel.rig.runs[1].run
    visitor = panel.visitor()
    status, headers, body = visitor.get(f"/api/run/{run}/report")
    assert status == 200 and b"LuGre model" in body
    drawn = visitor.get(f"/api/run/{run}/report?page=run")
    assert drawn[0] == 200 and b"What was recorded" in drawn[2]
    assert drawn[1]["content-security-policy"] == headers["content-security-policy"]
    policy = headers["content-security-policy"]
    assert policy.startswith("sandbox;") and "allow" not in policy
    assert "script-src" not in policy and "default-src 'none'" in policy
    assert Visitor(panel).get(f"/api/run/{run}/report")[0] == 401


def test_recording_download_is_complete(panel: ServedPanel) -> None:
    status, headers, body = panel.visitor().get(f"/api/run/{panel.rig.runs[0].run}/recording")
    assert (status, body) == (200, RECORDING)
    assert headers["content-disposition"].startswith("attachment")


@pytest.mark.parametrize("name", ["", "   ", "x" * 41, "a\x00b", "a\nb"])
def test_a_name_is_asked_for(panel: ServedPanel, name: str) -> None:
    code = panel.links["operator"].partition("#")[2]
    wanted = 200 if name == "a\nb" else 400  # white space becomes one space
    assert Visitor(panel).login(code, name) == wanted


def test_codes_cannot_be_tried_out(panel: ServedPanel) -> None:
    answers = [Visitor(panel).login(f"guess {n}") for n in range(15)]
    assert answers.count(403) <= 10 and answers[-1] == 429


def test_a_page_of_another_site_gets_no_socket(panel: ServedPanel) -> None:
    visitor = panel.visitor()
    for origin in ("http://evil.example", f"http://localhost.evil.example:{panel.port}"):
        with pytest.raises(InvalidStatus) as refused:
            visitor.page(origin)
        assert refused.value.response.status_code == 403


def test_socket_without_session_is_closed_with_reason(panel: ServedPanel) -> None:
    with Visitor(panel).page() as page:
        with pytest.raises(ConnectionClosed) as closed:
            page.recv(10)
        assert closed.value.rcvd is not None and closed.value.rcvd.code == 4401


def test_logout_closes_all_pages_of_user(panel: ServedPanel) -> None:
    visitor = panel.visitor()
    with visitor.page() as page:
        assert visitor.post("/api/logout")[0] == 200
        with pytest.raises(ConnectionClosed) as closed:
            while True:
                page.recv(10)
    assert closed.value.rcvd is not None and closed.value.rcvd.code == 4401
    assert visitor.post("/api/ask/runs", args={})[0] == 401


@pytest.mark.parametrize("said", ["something", "", b"drawn", "x" * 900])
def test_socket_with_unknown_message_is_closed(panel: ServedPanel, said: str | bytes) -> None:
    with panel.visitor().page() as page:
        page.send(said)
        with pytest.raises(ConnectionClosed):
            while True:
                page.recv(10)


def test_observer_watches_and_stops_but_does_not_command(panel: ServedPanel) -> None:
    visitor = panel.visitor("observer", "Olga")
    assert visitor.told["role"] == "observer"
    for path in ("/api/command/lease_take", "/api/command/lease_request", "/api/command/dry_run"):
        assert visitor.post(path, args={})[0] == 403
    assert visitor.post("/api/command/pause", args={})[0] == 403
    assert visitor.post("/api/ask/runs", args={})[0] == 200
    assert visitor.post("/api/invite", role="operator")[0] == 403
    status, answer = visitor.post("/api/invite", role="observer")
    assert status == 200 and Visitor(panel).login(answer["code"]) == 200
    panel.rig.state = "running"
    assert visitor.post("/api/stop/stop")[0] == 200
    assert panel.rig.users("stop") == ["Olga"]


def test_stops_pass_when_all_else_is_limited(
    panel: ServedPanel, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sessions, "Bucket", partial(Bucket, now=lambda: 0.0))
    visitor = panel.visitor()
    panel.rig.state = "running"
    answers = [visitor.post("/api/ask/runs", args={})[0] for _ in range(70)]
    assert (answers[0], answers[-1]) == (200, 429)
    assert visitor.post("/api/stop/stop")[0] == 200


def test_only_what_the_page_needs_can_be_asked(panel: ServedPanel) -> None:
    visitor = panel.visitor()
    for what in ("fetch", "report", "lease", "anything"):
        assert visitor.post(f"/api/ask/{what}", args={})[0] == 404
    for verb in ("lease_renew", "anything"):
        assert visitor.post(f"/api/command/{verb}", args={})[0] == 404


def test_daemon_without_answer_is_shown_as_lost() -> None:
    with ServedPanel() as panel:
        visitor = panel.visitor()
        panel.line.is_cut = True
        status, answer = visitor.post("/api/stop/estop")
        assert (status, answer["error"]["code"]) == (504, "unreachable")
        assert answer["error"]["hint"]


def test_beyond_this_machine_only_with_tls(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="without TLS"):
        Listen(host="0.0.0.0")
    with pytest.raises(ConfigError, match="together"):
        Listen(certificate=tmp_path / "a.crt")
    with pytest.raises(ConfigError, match="does not exist"):
        Listen(certificate=tmp_path / "a.crt", key=tmp_path / "a.key")
    with Listen(port=0).bind() as taken, pytest.raises(ConfigError, match="cannot listen"):
        Listen(port=taken.getsockname()[1]).bind()


def test_idle_connections_do_not_block_stop(panel: ServedPanel) -> None:
    visitor = panel.visitor()
    upgrade = (
        f"GET /api/live HTTP/1.1\r\nhost: 127.0.0.1:{panel.port}\r\norigin: {panel.origin}\r\n"
        "upgrade: websocket\r\nconnection: upgrade\r\nsec-websocket-version: 13\r\n"
        "sec-websocket-key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n"
    )
    with ExitStack() as held:
        for said in ["GET / HTTP/1.1\r\n"] * 150 + [upgrade] * 150:
            socket = held.enter_context(create_connection(("127.0.0.1", panel.port), 30))
            with suppress(OSError):  # it had to make way
                socket.sendall(said.encode())
        assert visitor.post("/api/stop/stop")[0] == 200


def test_slow_request_head_closes_connection(
    panel: ServedPanel, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rigd.panel.connections.HEAD_S", 0.3)
    with create_connection(("127.0.0.1", panel.port), 30) as socket:
        socket.settimeout(0.05)
        socket.sendall(b"GET / HTTP/1.1\r\n")
        deadline = monotonic() + 30
        with pytest.raises(ConnectionError):
            while monotonic() < deadline:
                socket.sendall(b"x")
                with suppress(TimeoutError):
                    if not socket.recv(1):
                        raise ConnectionError


def test_watching_pages_leave_room_for_commanding_page(
    panel: ServedPanel, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rigd.panel.feed.MOST_WATCHING", 1)
    watching, commanding = panel.visitor("observer"), panel.visitor()
    with watching.page() as first, watching.page() as second:
        first.recv(30)
        with pytest.raises(ConnectionClosed) as closed:
            second.recv(30)
        assert closed.value.rcvd is not None and closed.value.rcvd.code == 4429
        with commanding.page() as page:
            page.recv(30)
