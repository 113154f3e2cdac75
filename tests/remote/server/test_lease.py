"""The control lease: one at a time, handed over in sight of all, gone with its holder."""

from __future__ import annotations

import pytest

from rigd.remote.protocol import ClientUser, Code, LeaseView, Refusal
from rigd.remote.protocol.limits import LEASE_S
from rigd.remote.server.lease import ASKING_S, MAX_ASKING, Lease

#: Wall clock at the monotonic clock's zero, ns.
WALL_NS = 1_700_000_000_000_000_000


def client(name: str) -> ClientUser:
    """Return a client, or after a slash one of its users: `panel/Ada`."""
    identity, _, user = name.partition("/")
    return ClientUser.of(identity, user)


class Desk:
    """A lease, and a clock that stands until it is moved."""

    def __init__(self) -> None:
        self.now_ns = 0
        self.lease = Lease(
            clock=lambda: self.now_ns,
            wall=lambda: WALL_NS + self.now_ns,
        )

    def does(self, identity: str, verb: str) -> LeaseView:
        view: LeaseView = getattr(self.lease, verb)(client(identity))
        return view

    def give(self, identity: str, to: str) -> LeaseView:
        return self.lease.give(client(identity), client(to))

    def passes(self, seconds: float) -> None:
        self.now_ns += round(seconds * 1e9)

    def refuses(self, identity: str, verb: str) -> Code:
        before = self.lease.view()
        with pytest.raises(Refusal) as caught:
            self.does(identity, verb)
        assert self.lease.view() == before, "a refused command has changed the lease"
        return caught.value.code


@pytest.fixture
def desk() -> Desk:
    return Desk()


def test_a_free_lease_is_taken(desk: Desk) -> None:
    view = desk.does("alice", "take")
    assert view == LeaseView(holder=client("alice"), until_ns=WALL_NS + round(LEASE_S * 1e9))
    desk.lease.check(client("alice"))


def test_second_client_is_refused_with_holders_name(desk: Desk) -> None:
    desk.does("alice", "take")
    with pytest.raises(Refusal, match=r"alice .*lease, .*6\.0 s"):
        desk.does("bob", "take")
    with pytest.raises(Refusal, match="which alice has") as caught:
        desk.lease.check(client("bob"))
    assert caught.value.code is Code.NO_LEASE


@pytest.mark.parametrize("verb", ["renew", "release"])
def test_only_the_holder_renews_and_releases(desk: Desk, verb: str) -> None:
    assert desk.refuses("bob", verb) is Code.NO_LEASE
    desk.does("alice", "take")
    assert desk.refuses("bob", verb) is Code.NO_LEASE


def test_a_renewed_lease_lasts(desk: Desk) -> None:
    desk.does("alice", "take")
    for _ in range(10):
        desk.passes(LEASE_S - 0.1)
        desk.does("alice", "renew")
    assert desk.lease.lost() == ()


def test_lease_not_renewed_ends_and_names_its_holder(desk: Desk) -> None:
    desk.does("alice", "take")
    desk.passes(LEASE_S)
    assert desk.lease.view() == LeaseView()
    assert desk.lease.lost() == (client("alice"),)
    assert desk.lease.lost() == ()
    assert desk.refuses("alice", "renew") is Code.NO_LEASE
    assert desk.does("bob", "take").holder == client("bob")


def test_loser_is_notified_although_another_took_lease(desk: Desk) -> None:
    desk.does("alice", "take")
    desk.passes(LEASE_S + 1)
    desk.does("bob", "take")
    assert desk.lease.lost() == (client("alice"),)


def test_a_released_or_seized_lease_is_not_lost(desk: Desk) -> None:
    desk.does("alice", "take")
    desk.does("carol", "seize")
    desk.does("carol", "release")
    desk.passes(LEASE_S)
    assert desk.lease.lost() == ()


def test_request_for_lease_is_shown_until_granted(desk: Desk) -> None:
    desk.does("alice", "take")
    desk.does("bob", "request")
    assert desk.does("carol", "request").asked_by == (client("bob"), client("carol"))
    view = desk.give("alice", "bob")
    assert (view.holder, view.asked_by) == (client("bob"), (client("carol"),))


def test_lease_request_expires(desk: Desk) -> None:
    desk.does("alice", "take")
    desk.does("bob", "request")
    for _ in range(round(ASKING_S)):
        desk.passes(1)
        desk.does("alice", "renew")
    assert desk.lease.view().asked_by == ()


def test_lease_request_needs_another_holder(desk: Desk) -> None:
    assert desk.refuses("alice", "request") is Code.CONFLICT
    desk.does("alice", "take")
    assert desk.refuses("alice", "request") is Code.CONFLICT


def test_list_of_lease_requests_is_bounded(desk: Desk) -> None:
    desk.does("alice", "take")
    for number in range(MAX_ASKING):
        desk.does(f"client-{number}", "request")
    assert desk.refuses("one-more", "request") is Code.BUSY


@pytest.mark.parametrize("to", ["bob", "panel", "panel/Ada"])
def test_holder_gives_only_to_who_asks(desk: Desk, to: str) -> None:
    desk.does("alice", "take")
    desk.does("carol", "request")
    with pytest.raises(Refusal) as caught:
        desk.give("carol", to)
    assert caught.value.code is Code.NO_LEASE
    with pytest.raises(Refusal, match=r"does not ask for the lease\n.*lease request") as caught:
        desk.give("alice", to)
    assert caught.value.code is Code.NOT_FOUND
    assert desk.lease.view().holder == client("alice")


def test_users_of_one_client_hold_separate_leases(desk: Desk) -> None:
    desk.does("panel/Ada", "take")
    for other in ("panel/Bob", "panel"):
        assert desk.refuses(other, "renew") is Code.NO_LEASE
        assert desk.refuses(other, "take") is Code.LEASE_HELD
    desk.passes(LEASE_S)
    assert desk.lease.lost() == (client("panel/Ada"),)


def test_user_gets_the_lease_only_after_asking(desk: Desk) -> None:
    desk.does("panel/Ada", "take")
    with pytest.raises(Refusal) as caught:
        desk.give("panel/Ada", "panel/Bob")
    assert caught.value.code is Code.NOT_FOUND
    desk.does("panel/Bob", "request")
    assert desk.give("panel/Ada", "panel/Bob").holder == client("panel/Bob")


def test_client_named_alone_passes_to_first_asking_user(desk: Desk) -> None:
    desk.does("alice", "take")
    desk.does("panel/Ada", "request")
    desk.does("panel/Bob", "request")
    assert desk.give("alice", "panel").holder == client("panel/Ada")
