"""Users of the panel take, hand over and lose the control lease."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from support.panel.played_rig import PlayedRig
from support.panel.served import ServedPanel, Visitor

from rigd.panel.login.session_store import SessionStore
from rigd.remote.client.lease import renewing
from rigd.remote.protocol import ClientUser

#: How long a lease lasts here, in s; it is renewed every 0.1 s.
LEASE_S = 1.5


@pytest.fixture
def panel(monkeypatch: pytest.MonkeyPatch) -> Iterator[ServedPanel]:
    monkeypatch.setattr(renewing, "RENEW_S", 0.1)
    with ServedPanel(PlayedRig(lease_s=LEASE_S)) as served:
        yield served


def further(panel: ServedPanel, visitor: Visitor, name: str) -> Visitor:
    """Return a visitor whom ``visitor`` has invited."""
    _, answer = visitor.post("/api/invite", role="operator")
    other = Visitor(panel)
    assert other.login(answer["code"], name) == 200
    return other


def wait_until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 20
    while not condition():
        assert time.monotonic() < deadline, "waited 20 s"
        time.sleep(0.02)


def lease(visitor: Visitor, verb: str, **args: str) -> int:
    """Send a command about the lease; return its status."""
    return visitor.post(f"/api/command/lease_{verb}", args=args)[0]


def code_of_pause(visitor: Visitor) -> str:
    code: str = visitor.post("/api/command/pause", args={})[1]["error"]["code"]
    return code


def renewals(panel: ServedPanel) -> int:
    return len(panel.rig.given("lease_renew"))


def user(name: str) -> ClientUser:
    return ClientUser.of("panel", name)


def test_second_user_is_refused_with_the_holder(panel: ServedPanel) -> None:
    ada = panel.visitor()
    bob = further(panel, ada, "Bob")
    with ada.page(), bob.page():
        assert code_of_pause(bob) == "no_lease"
        assert lease(ada, "take") == 200
        assert panel.rig.lease.view().holder == user("Ada")
        status, answer = bob.post("/api/command/lease_take", args={})
        assert (status, answer["error"]["code"]) == (409, "lease_held")
        assert "Ada" in answer["error"]["message"]
        assert code_of_pause(bob) == "no_lease"
        assert panel.rig.changes == 1


def test_two_users_of_one_name_share_no_lease(panel: ServedPanel) -> None:
    ada = panel.visitor()
    other = further(panel, ada, "Ada")
    with ada.page(), other.page():
        assert lease(ada, "take") == 200
        assert code_of_pause(other) == "no_lease"


def test_concurrent_takes_leave_one_holder(panel: ServedPanel) -> None:
    ada = panel.visitor()
    bob = further(panel, ada, "Bob")
    with ada.page(), bob.page(), ThreadPoolExecutor(2) as pool:
        takes = [pool.submit(lease, item, "take") for item in (ada, bob)]
        assert sorted(take.result() for take in takes) == [200, 409]


def test_control_passes_to_requesting_user(panel: ServedPanel) -> None:
    ada = panel.visitor()
    bob = further(panel, ada, "Bob")
    to_bob = {"to": "panel", "user": "Bob"}
    with ada.page(), bob.page():
        lease(ada, "take")
        assert lease(ada, "give", **to_bob) == 404
        assert lease(bob, "request") == 200
        assert lease(bob, "give", **to_bob) == 409
        assert lease(ada, "give", **to_bob) == 200
        assert lease(ada, "release") == 409
        assert lease(bob, "release") == 200
        assert panel.rig.lease.view().holder is None


def test_control_does_not_pass_to_departed_user(panel: ServedPanel) -> None:
    ada = panel.visitor()
    bob = further(panel, ada, "Bob")
    with ada.page():
        lease(ada, "take")
        with bob.page():
            assert lease(bob, "request") == 200
        wait_until(lambda: lease(ada, "give", to="panel", user="Bob") == 404)
        assert panel.rig.lease.view().holder == user("Ada")


def test_control_passes_to_a_client_elsewhere(panel: ServedPanel) -> None:
    ada = panel.visitor()
    with ada.page():
        lease(ada, "take")
        assert lease(ada, "give", to="bob") == 404
        panel.rig.lease.request(ClientUser.of("bob"))
        assert lease(ada, "give", to="bob") == 200
        assert panel.rig.lease.view().is_held_by("bob")
        assert code_of_pause(ada) == "no_lease"
        assert lease(ada, "give", to="bob") == 409
        assert lease(ada, "request") == 200
        assert panel.rig.lease.view().asked_by == (user("Ada"),)


def test_lease_is_renewed_only_while_page_is_open(panel: ServedPanel) -> None:
    ada = panel.visitor()
    with ada.page():
        lease(ada, "take")
        before = renewals(panel)
        wait_until(lambda: renewals(panel) > before + 8)
        assert panel.rig.users("lease_renew")[-1] == "Ada", "the daemon gets the name of the user"
    wait_until(lambda: panel.rig.lease.lost() == (user("Ada"),))
    after = renewals(panel)
    time.sleep(0.5)
    assert renewals(panel) == after
    assert code_of_pause(ada) == "no_lease"


def test_reloaded_page_keeps_control(panel: ServedPanel) -> None:
    ada = panel.visitor()
    with ada.page():
        lease(ada, "take")
    with ada.page():
        time.sleep(LEASE_S + 0.2)
        panel.rig.state = "running"
        assert ada.post("/api/command/pause", args={})[0] == 200


def killed_with_control(path: Path) -> tuple[str, int]:
    """Leave in ``path`` what a panel killed with Ada in control does; return cookie and port."""
    with ServedPanel(store=SessionStore(path)) as killed:
        ada = killed.visitor()
        with ada.page():
            assert lease(ada, "take") == 200
            kept = path.read_bytes()
    path.write_bytes(kept)
    return ada.cookie, killed.port


def test_control_outlives_the_panel(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(renewing, "RENEW_S", 0.1)
    path = tmp_path / "sessions.json"
    cookie, port = killed_with_control(path)
    rig = PlayedRig()
    rig.hold_lease("panel", "Ada")
    rig.state = "running"
    with ServedPanel(rig, SessionStore(path)) as second:
        again = Visitor(second)
        again.cookie = cookie.replace(f"rigd-{port}=", f"rigd-{second.port}=")
        with again.page():
            wait_until(lambda: renewals(second) > 3)
            assert again.post("/api/command/pause", args={})[0] == 200


def test_control_ends_with_panel_and_lease(tmp_path: Path) -> None:
    path = tmp_path / "sessions.json"
    killed_with_control(path)
    with ServedPanel(PlayedRig(), SessionStore(path)) as second:
        bob = second.visitor(name="Bob")
        with bob.page() as page:
            told: dict[str, Any] = {}
            while told.get("kind") != "status":
                told = json.loads(page.recv(30))
            assert told["status"]["lease"]["holder"] is None
            assert lease(bob, "take") == 200
            assert second.rig.lease.view().holder == user("Bob")


def test_seized_lease_is_not_renewed(panel: ServedPanel) -> None:
    ada = panel.visitor()
    with ada.page():
        lease(ada, "take")
        panel.rig.hold_lease("carol")
        assert code_of_pause(ada) == "no_lease"
        wait_until(lambda: panel.rig.lease.view().holder is None)  # carol does not renew it


@pytest.mark.parametrize("leaves", ["closes the page", "logs out"])
def test_control_is_free_after_its_user_left(panel: ServedPanel, leaves: str) -> None:
    ada = panel.visitor()
    bob = further(panel, ada, "Bob")
    with bob.page():
        with ada.page():
            lease(ada, "take")
            if leaves == "logs out":
                ada.post("/api/logout")
        wait_until(lambda: lease(bob, "take") == 200)
