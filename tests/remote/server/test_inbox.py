"""The inbox: bounded, and fair to a client that asks little."""

from __future__ import annotations

import threading

from rigd.remote.server.inbox import MAX_SENDERS, MAX_WAITING, Inbox


def test_requests_of_a_sender_keep_their_order() -> None:
    inbox = Inbox[int]()
    for number in range(5):
        assert inbox.put("alice", number)
    assert [inbox.take() for _ in range(5)] == list(range(5))


def test_busy_client_is_served_in_turn_with_others() -> None:
    inbox = Inbox[str]()
    for number in range(4):
        inbox.put("flood", f"flood {number}")
    inbox.put("alice", "alice")
    inbox.put("bob", "bob")
    assert [inbox.take() for _ in range(4)] == ["flood 0", "alice", "bob", "flood 1"]


def test_inbox_has_items_until_last_is_taken() -> None:
    inbox = Inbox[int]()
    assert not inbox.has_items
    inbox.put("alice", 1)
    inbox.put("bob", 2)
    inbox.take()
    assert inbox.has_items
    inbox.take()
    assert not inbox.has_items


def test_each_sender_and_all_of_them_are_bounded() -> None:
    inbox = Inbox[int]()
    assert all(inbox.put("flood", 0) for _ in range(MAX_WAITING))
    assert not inbox.put("flood", 0)
    assert all(inbox.put(f"client-{number}", 0) for number in range(MAX_SENDERS - 1))
    assert not inbox.put("one-more", 0)
    inbox.take()
    assert inbox.put("flood", 0)


def test_waiting_thread_wakes_by_item_and_end() -> None:
    inbox = Inbox[int]()
    taken: list[int | None] = []

    def work() -> None:
        while (item := inbox.take()) is not None:
            taken.append(item)
        taken.append(None)

    worker = threading.Thread(target=work)
    worker.start()
    inbox.put("alice", 1)
    inbox.put("alice", 2)
    while len(taken) < 2:
        worker.join(0.01)
    inbox.close()
    worker.join(10)
    assert taken == [1, 2, None]


def test_closing_returns_waiting_items_and_accepts_none() -> None:
    inbox = Inbox[int]()
    inbox.put("alice", 1)
    inbox.put("bob", 2)
    assert inbox.close() == [1, 2]
    assert not inbox.put("alice", 3)
    assert inbox.take() is None
