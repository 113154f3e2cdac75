"""A bounded queue that serves senders in turn: a sender that floods it delays only itself."""

from __future__ import annotations

import threading
from collections import OrderedDict, deque
from typing import Final, Generic, TypeVar

#: Requests of one identity that may wait; a client of ours has one at a time under way.
MAX_WAITING: Final = 8
#: Identities whose requests may wait at once.
MAX_SENDERS: Final = 64

T = TypeVar("T")


class Inbox(Generic[T]):
    """Items by sender; any thread may put, any thread may take."""

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
        """Return the oldest item of whoever was served longest ago, or None once closed.

        Waits until there is one.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._closed or self._waiting)
            if self._closed:
                return None
            sender, queue = self._waiting.popitem(last=False)
            item = queue.popleft()
            if queue:
                self._waiting[sender] = queue  # behind everybody else
            return item

    def close(self) -> list[T]:
        """Let nobody put or take any more, and return what was waiting."""
        with self._changed:
            self._closed = True
            left = [item for queue in self._waiting.values() for item in queue]
            self._waiting.clear()
            self._changed.notify_all()
            return left
