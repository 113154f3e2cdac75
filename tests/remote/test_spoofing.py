"""A client that is let in reaches its own keys, and no other: none can pose as the rig."""

from __future__ import annotations

import json
from collections.abc import Iterator

import pytest
from support.daemon.served_rig import RIG, Served, key, request
from support.daemon.zenoh_client import ZenohClient

from rigd.remote.protocol import Role

PUBLIC = ("status", "event", "live/wheel")


@pytest.fixture(scope="module", params=["over_tls", "on_loopback"])
def served(request: pytest.FixtureRequest) -> Served:
    """Both ways to serve a rig keep every client from posing as it."""
    served: Served = request.getfixturevalue(request.param)
    return served


@pytest.fixture
def alice(served: Served) -> Iterator[ZenohClient]:
    with served.client("alice") as client:
        yield client


@pytest.fixture
def carol(served: Served) -> Iterator[ZenohClient]:
    with served.client("carol") as client:
        yield client


@pytest.mark.parametrize("what", ["event", "live/wheel", "elsewhere"])
def test_client_cannot_publish(
    alice: ZenohClient, carol: ZenohClient, served: Served, what: str
) -> None:
    alice.subscribe(f"rigd/{RIG}/{what}")
    alice.subscribe(f"rigd/{RIG}/status")
    for _ in range(5):
        carol.put(f"rigd/{RIG}/{what}", b"FAKE")
    # The heartbeat that follows shows that there was time for the fakes to come.
    came = alice.received(least=2, within_s=20)
    assert came.get(f"rigd/{RIG}/{what}", 0) == 0


def test_client_cannot_publish_a_status(
    alice: ZenohClient, carol: ZenohClient, served: Served
) -> None:
    alice.subscribe(f"rigd/{RIG}/status")
    before = served.rig.said
    for _ in range(50):
        carol.put(f"rigd/{RIG}/status", b"FAKE")
    came = alice.received(least=2, within_s=20)
    assert came[f"rigd/{RIG}/status"] <= served.rig.said - before + 1


@pytest.mark.parametrize("pattern", ["cmd/alice/*", "cmd/alice/pause", "cmd/*/*", "**"])
def test_client_cannot_answer_requests(
    alice: ZenohClient, carol: ZenohClient, served: Served, pattern: str
) -> None:
    carol.answer_queries(f"rigd/{RIG}/{pattern}")
    carol.answer_queries(f"rigd/{RIG}/status")
    served.rig.hold_lease("alice")
    before = list(served.rig.done)
    reply = alice.ask(key("cmd", "alice", "pause"), request("pause"))
    assert reply["result"] == {}
    assert served.rig.done[len(before) :] == [("alice", "pause")]
    assert alice.ask(f"rigd/{RIG}/status", b"")["rig"] == RIG


def test_client_cannot_pretend_to_be_a_rig(alice: ZenohClient, carol: ZenohClient) -> None:
    carol.pretend("rigd/lugre-2/alive")
    assert carol.get("rigd/lugre-1/status") != []  # what went before has arrived
    assert alice.alive("rigd/*/alive") == ["rigd/lugre-1/alive"]


@pytest.mark.parametrize("pattern", ["**", "rigd/**", f"rigd/{RIG}/**", "rigd/*/*", "@/**"])
def test_client_cannot_subscribe_to_everything(
    alice: ZenohClient, carol: ZenohClient, served: Served, pattern: str
) -> None:
    carol.subscribe(pattern)
    alice.ask(key("ask", "alice", "latest"), request("latest"))
    alice.subscribe(f"rigd/{RIG}/status")
    alice.received(least=2, within_s=20)
    assert carol.received() == {}


@pytest.mark.parametrize("pattern", ["rigd/{rig}/cmd/*/lease_take", "rigd/{rig}/**", "**"])
def test_no_request_is_made_for_several_at_once(
    carol: ZenohClient, served: Served, pattern: str
) -> None:
    before = list(served.rig.done)
    replies = carol.get(pattern.format(rig=RIG), request("lease_take"))
    assert all(not reply["ok"] for reply in replies)
    assert served.rig.done == before


def test_identity_is_the_certificate_name(over_tls: Served) -> None:
    before = list(over_tls.rig.done)
    with over_tls.client("bob") as bob:
        for kind, verb in (("cmd", "lease_take"), ("ask", "latest"), ("stop", "stop")):
            assert bob.get(key(kind, "alice", verb), request(verb)) == []
    with over_tls.client("alice") as alice:
        assert alice.get(key("cmd", "carol", "lease_seize"), request("lease_seize")) == []
    assert over_tls.rig.done == before


def test_without_certificates_the_name_is_the_one_given(on_loopback: Served) -> None:
    with on_loopback.client() as client:
        client.ask(key("ask", "whoever", "latest"), request("latest"))
    by = on_loopback.rig.requests[-1].requester
    assert (by.identity, by.role) == ("whoever", Role.OPERATOR)


def test_client_cannot_reach_another_client(
    served: Served, alice: ZenohClient, carol: ZenohClient
) -> None:
    carol.answer_queries("chat/carol")
    alice.subscribe("chat/alice")
    carol.put("chat/alice", b"hello")
    assert alice.get("chat/carol") == []
    alice.subscribe(f"rigd/{RIG}/status")
    came = alice.received(least=2, within_s=20)
    assert set(came) == {f"rigd/{RIG}/status"}


def test_published_data_reach_every_client(served: Served) -> None:
    with served.client("bob") as bob:
        for what in PUBLIC:
            bob.subscribe(f"rigd/{RIG}/{what}")
        assert bob.received(least=2, within_s=20)[f"rigd/{RIG}/status"] >= 2
        assert bob.alive("rigd/*/alive") == [f"rigd/{RIG}/alive"]
        assert json.loads(bob.get(f"rigd/{RIG}/status")[0]["payload"])["rig"] == RIG
