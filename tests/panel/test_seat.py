"""Who has control at the panel, and what becomes of it when they go away."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from support.panel import ServedPanel, Visitor
from support.played_rig import PlayedRig

from rigd.panel import seat
from rigd.panel.session_store import SessionStore


@pytest.fixture
def panel(monkeypatch: pytest.MonkeyPatch) -> Iterator[ServedPanel]:
    monkeypatch.setattr(seat, "GRACE_S", 0.3)
    monkeypatch.setattr(seat, "RENEW_S", 0.1)
    with ServedPanel() as served:
        yield served


def further(panel: ServedPanel, visitor: Visitor, name: str) -> Visitor:
    """Return somebody who was invited by ``visitor``."""
    _, answer = visitor.post("/api/invite", role="operator")
    other = Visitor(panel)
    assert other.login(answer["code"], name) == 200
    return other


def wait_until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 20
    while not condition():
        assert time.monotonic() < deadline, "waited 20 s"
        time.sleep(0.02)


def renewals(panel: ServedPanel) -> int:
    return sum(verb == "lease_renew" for verb, _ in panel.rig.given)


def test_one_at_a_time_and_the_other_is_told_who(panel: ServedPanel) -> None:
    ada = panel.visitor()
    bob = further(panel, ada, "Bob")
    with ada.page(), bob.page():
        assert bob.post("/api/command/pause", args={})[1]["error"]["code"] == "no_lease"
        assert ada.post("/api/control/take", args={})[0] == 200
        assert panel.rig.users["lease_take"] == "Ada"
        status, answer = bob.post("/api/control/take", args={})
        assert (status, answer["error"]["code"]) == (409, "lease_held")
        assert "Ada" in answer["error"]["message"]
        assert bob.post("/api/command/pause", args={})[1]["error"]["code"] == "lease_held"
        assert "pause" not in [verb for verb, _ in panel.rig.given]


def test_of_two_who_take_it_at_once_one_has_it(panel: ServedPanel) -> None:
    ada = panel.visitor()
    bob = further(panel, ada, "Bob")
    with ada.page(), bob.page(), ThreadPoolExecutor(2) as pool:
        panel.rig.delay_s = 0.2
        takes = [pool.submit(item.post, "/api/control/take", args={}) for item in (ada, bob)]
        assert sorted(take.result()[0] for take in takes) == [200, 409]


def test_control_is_handed_over_to_who_has_asked_and_to_nobody_else(panel: ServedPanel) -> None:
    ada = panel.visitor()
    bob = further(panel, ada, "Bob")
    with ada.page(), bob.page():
        ada.post("/api/control/take", args={})
        number = bob.told["session"]
        assert ada.post("/api/control/give", args={"session": number})[0] == 404
        assert bob.post("/api/control/ask", args={})[0] == 200
        assert bob.post("/api/control/give", args={"session": number})[0] == 409
        assert ada.post("/api/control/give", args={"session": number})[0] == 200
        assert ada.post("/api/control/release", args={})[0] == 409
        assert bob.post("/api/control/release", args={})[0] == 200
        assert panel.rig.holder is None


def test_control_is_handed_to_a_client_elsewhere(panel: ServedPanel) -> None:
    ada = panel.visitor()
    with ada.page():
        ada.post("/api/control/take", args={})
        assert ada.post("/api/control/give", args={"client": "bob"})[0] == 200
        assert panel.rig.holder == "bob"
        assert ada.post("/api/command/pause", args={})[1]["error"]["code"] == "no_lease"
        assert ada.post("/api/control/give", args={"client": "bob"})[0] == 409
        assert ada.post("/api/control/ask", args={})[0] == 200
        assert panel.rig.asked_by == ("panel",)


def test_the_lease_is_renewed_while_the_page_is_open_and_not_after(panel: ServedPanel) -> None:
    ada = panel.visitor()
    with ada.page():
        ada.post("/api/control/take", args={})
        before = renewals(panel)
        wait_until(lambda: renewals(panel) > before + 8)
        assert panel.rig.users["lease_renew"] == "Ada", "the daemon knows whose page it is"
    wait_until(lambda: ada.post("/api/command/pause", args={})[1]["error"]["code"] == "no_lease")
    after = renewals(panel)
    time.sleep(0.5)
    assert renewals(panel) == after
    released = [verb for verb, _ in panel.rig.given if verb == "lease_release"]
    assert not released, "it runs out, so that the daemon knows its user is lost"


def test_a_page_that_is_loaded_anew_keeps_control(panel: ServedPanel) -> None:
    ada = panel.visitor()
    with ada.page():
        ada.post("/api/control/take", args={})
    with ada.page():
        time.sleep(0.6)
        panel.rig.state = "running"
        assert ada.post("/api/command/pause", args={})[0] == 200


def killed_with_control(path: Path) -> tuple[str, int]:
    """Leave in ``path`` what a panel killed with Ada in control does; return cookie and port."""
    with ServedPanel(book=SessionStore(path)) as killed:
        ada = killed.visitor()
        with ada.page():
            assert ada.post("/api/control/take", args={})[0] == 200
            kept = path.read_bytes()
    path.write_bytes(kept)
    return ada.cookie, killed.port


@pytest.mark.usefixtures("panel")  # which makes the times short
def test_control_outlives_the_panel(tmp_path: Path) -> None:
    path = tmp_path / "sessions.json"
    cookie, port = killed_with_control(path)
    rig = PlayedRig()
    rig.holder, rig.state = "panel", "running"
    with ServedPanel(rig, SessionStore(path)) as second:
        again = Visitor(second)
        again.cookie = cookie.replace(f"rigd-{port}=", f"rigd-{second.port}=")
        with again.page():
            wait_until(lambda: renewals(second) > 3)
            assert again.post("/api/command/pause", args={})[0] == 200


def test_control_ends_with_panel_and_lease(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The page says at once that control is free: nobody waits until Ada counts as gone."""
    monkeypatch.setattr(seat, "GRACE_S", 600.0)
    path = tmp_path / "sessions.json"
    killed_with_control(path)
    with ServedPanel(PlayedRig(), SessionStore(path)) as second:
        bob = second.visitor(name="Bob")
        with bob.page() as page:
            told: dict[str, Any] = {}
            while told.get("kind") != "status":
                told = json.loads(page.recv(30))
            assert told["status"]["control"]["holder"] is None
            status, answer = bob.post("/api/control/take", args={})
            assert status == 200, answer
            assert second.rig.users["lease_take"] == "Bob"


def test_control_that_was_lost_elsewhere_is_not_believed_in(panel: ServedPanel) -> None:
    ada = panel.visitor()
    with ada.page():
        ada.post("/api/control/take", args={})
        panel.rig.holder = "carol"  # a maintainer has seized it
        wait_until(
            lambda: ada.post("/api/command/pause", args={})[1]["error"]["code"] == "no_lease"
        )


def test_who_has_gone_keeps_nobody_waiting(panel: ServedPanel) -> None:
    ada = panel.visitor()
    bob = further(panel, ada, "Bob")
    with bob.page():
        with ada.page():
            ada.post("/api/control/take", args={})
        wait_until(lambda: bob.post("/api/control/take", args={})[0] == 200)


def test_logging_out_gives_up_control(panel: ServedPanel) -> None:
    ada = panel.visitor()
    bob = further(panel, ada, "Bob")
    with ada.page(), bob.page():
        ada.post("/api/control/take", args={})
        ada.post("/api/logout")
        wait_until(lambda: bob.post("/api/control/take", args={})[0] == 200)
