"""The inbox: bounded, and fair to whoever asks little."""

from __future__ import annotations

import threading

from rigd.remote.server.inbox import MAX_SENDERS, MAX_WAITING, Inbox


def test_in_the_order_of_one_sender() -> None:
    inbox = Inbox[int]()
    for number in range(5):
        assert inbox.put("alice", number)
    assert [inbox.take() for _ in range(5)] == list(range(5))


def test_who_sends_much_is_served_in_turn_with_who_sends_little() -> None:
    inbox = Inbox[str]()
    for number in range(4):
        inbox.put("flood", f"flood {number}")
    inbox.put("alice", "alice")
    inbox.put("bob", "bob")
    assert [inbox.take() for _ in range(4)] == ["flood 0", "alice", "bob", "flood 1"]


def test_it_has_items_until_the_last_is_taken() -> None:
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


def test_who_waits_is_woken_by_an_item_and_by_the_end() -> None:
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


def test_closing_gives_back_what_waits_and_takes_no_more() -> None:
    inbox = Inbox[int]()
    inbox.put("alice", 1)
    inbox.put("bob", 2)
    assert inbox.close() == [1, 2]
    assert not inbox.put("alice", 3)
    assert inbox.take() is None
