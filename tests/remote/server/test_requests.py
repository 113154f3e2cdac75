"""The memory of requests: once is once, and old is old."""

from __future__ import annotations

import pytest

from rigd.remote.protocol import Code, Refusal
from rigd.remote.protocol.limits import FRESH_S
from rigd.remote.server.requests import MAX_REQUESTS, MAX_SENDERS, MEMORY_S, Requests, StoredReply

DONE = StoredReply(True, b"done")


class Memory:
    """Requests, and clocks that stand until they are moved."""

    def __init__(self) -> None:
        self.now_ns = self.up_ns = 0
        self.requests = Requests(
            clock=lambda: self.up_ns + self.now_ns,
            wall=lambda: 1_700_000_000_000_000_000 + self.now_ns,
        )
        self.up_ns = round(FRESH_S * 1e9)

    def admit(self, identity: str = "alice", age_s: float = 0.0) -> None:
        sent_ns = 1_700_000_000_000_000_000 + self.now_ns - round(age_s * 1e9)
        self.requests.admit(identity, sent_ns)

    def refuses(self, identity: str = "alice", age_s: float = 0.0) -> Code:
        with pytest.raises(Refusal) as caught:
            self.admit(identity, age_s)
        return caught.value.code

    def carries_out(self, name: str, identity: str = "alice") -> None:
        self.admit(identity)
        self.requests.remember(identity, name, b"digest", DONE)


@pytest.fixture
def memory() -> Memory:
    return Memory()


def test_repeated_request_is_answered_from_memory(memory: Memory) -> None:
    assert memory.requests.recall("alice", "1", b"digest") is None
    memory.carries_out("1")
    assert memory.requests.recall("alice", "1", b"digest") is DONE


def test_id_belongs_to_one_request_of_one_identity(memory: Memory) -> None:
    memory.carries_out("1")
    with pytest.raises(Refusal) as caught:
        memory.requests.recall("alice", "1", b"other")
    assert caught.value.code is Code.REPLAYED
    assert memory.requests.recall("bob", "1", b"digest") is None


@pytest.mark.parametrize("age_s", [FRESH_S + 1, -FRESH_S - 1, 1e9])
def test_old_request_is_refused(memory: Memory, age_s: float) -> None:
    assert memory.refuses(age_s=age_s) is Code.REPLAYED


@pytest.mark.parametrize("age_s", [0, FRESH_S - 1, 1 - FRESH_S])
def test_recent_request_is_admitted(memory: Memory, age_s: float) -> None:
    memory.admit(age_s=age_s)


def test_request_possibly_done_by_earlier_daemon_is_refused(memory: Memory) -> None:
    memory.up_ns = round(2e9)
    assert memory.refuses(age_s=3.0) is Code.REPLAYED
    memory.admit(age_s=1.0)


def test_request_that_waited_too_long_is_told(memory: Memory) -> None:
    sent_ns = 1_700_000_000_000_000_000
    memory.now_ns = round((FRESH_S + 1) * 1e9)
    with pytest.raises(Refusal, match=r"waited 31\.0 s for others before it, at most 30 s"):
        memory.requests.admit("alice", sent_ns, memory.now_ns)


def test_reply_is_remembered_until_request_is_too_old(memory: Memory) -> None:
    """Sent as far ahead as is allowed, it stays fresh for twice as long."""
    memory.admit(age_s=-FRESH_S)
    memory.requests.remember("alice", "1", b"digest", DONE)
    sent_ns = 1_700_000_000_000_000_000 + round(FRESH_S * 1e9)
    memory.now_ns = round(2 * FRESH_S * 1e9)
    memory.requests.admit("alice", sent_ns)  # as if it were new
    assert memory.requests.recall("alice", "1", b"digest") is DONE
    memory.now_ns = round(MEMORY_S * 1e9)
    with pytest.raises(Refusal):
        memory.requests.admit("alice", sent_ns)


def test_memory_of_one_identity_is_bounded_and_empties(memory: Memory) -> None:
    for number in range(MAX_REQUESTS):
        memory.carries_out(str(number))
    assert memory.refuses() is Code.BUSY
    memory.admit("bob")
    memory.now_ns = round(MEMORY_S * 1e9)
    memory.admit()
    assert memory.requests.recall("alice", "0", b"digest") is None


def test_the_number_of_identities_is_bounded(memory: Memory) -> None:
    for number in range(MAX_SENDERS):
        memory.carries_out("1", f"client-{number}")
    assert memory.refuses("one-more") is Code.BUSY
    memory.admit("client-0")


def test_full_memory_forgets_the_oldest_request(memory: Memory) -> None:
    """Stops are never refused for the lack of room."""
    for number in range(MAX_REQUESTS + 1):
        memory.requests.remember("alice", str(number), b"digest", DONE)
    assert memory.requests.recall("alice", "0", b"digest") is None
    assert memory.requests.recall("alice", "1", b"digest") is DONE
    for number in range(MAX_SENDERS):
        memory.requests.remember(f"client-{number}", "1", b"digest", DONE)
    assert memory.requests.recall("alice", "1", b"digest") is None
