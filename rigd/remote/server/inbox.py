"""Queues the requests of clients and serves the clients in turn.

The queue is bounded. A client that sends too many requests delays only its own requests.
"""

from __future__ import annotations

import threading
from collections import OrderedDict, deque
from typing import Final, Generic, TypeVar

#: Requests of one identity that may wait; a client of rigd has one in progress at a time.
MAX_WAITING: Final = 8
#: Identities whose requests may wait at once.
MAX_SENDERS: Final = 64

T = TypeVar("T")


class Inbox(Generic[T]):
    """A bounded queue of items for each sender; any thread may put and take."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._waiting: OrderedDict[str, deque[T]] = OrderedDict()
        self._closed = False

    @property
    def has_items(self) -> bool:
        """Whether an item waits to be taken."""
        return bool(self._waiting)

    def put(self, sender: str, item: T) -> bool:
        """Add an item, and return whether there was room for it."""
        with self._changed:
            queue = self._waiting.get(sender)
            if queue is None:
                if self._closed or len(self._waiting) >= MAX_SENDERS:
                    return False
                queue = self._waiting[sender] = deque()
            elif len(queue) >= MAX_WAITING:
                return False
            queue.append(item)
            self._changed.notify()
            return True

    def take(self) -> T | None:
        """Return the oldest item of the sender that was served longest ago, or None when closed.

        Waits for an item.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._closed or self._waiting)
            if self._closed:
                return None
            sender, queue = self._waiting.popitem(last=False)
            item = queue.popleft()
            if queue:
                self._waiting[sender] = queue  # behind all other senders
            return item

    def close(self) -> list[T]:
        """Refuse every further item, and return those that were waiting."""
        with self._changed:
            self._closed = True
            left = [item for queue in self._waiting.values() for item in queue]
            self._waiting.clear()
            self._changed.notify_all()
            return left
