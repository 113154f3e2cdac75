"""Sends the heartbeats of a simulated CANopen node, and detects missing heartbeats of other nodes.

The module also has the timeout on which this detection is built. Source: CiA 301, 7.2.8.3.2.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from functools import partial
from typing import Final

from rigd_sim.wire.can.canopen.dictionary import Dictionary, Entry, Kind

#: A timer that comes later than this, in s, shows a stall of this process, not of the master:
#: what was sent meanwhile waits to be read, and is given this time to be.
STALL_S: Final = 0.005
GRACE_S: Final = 0.02
#: Nodes that one node can watch.
WATCHED: Final = 4


class Watch:
    """Calls ``expired`` if :meth:`feed` was not called in time, then waits for the next call.

    A device does not stall as this process may: see :data:`STALL_S`.
    """

    def __init__(self, expired: Callable[[], None]) -> None:
        self._expired = expired
        self._timer: asyncio.TimerHandle | None = None
        self._due = 0.0
        self._graced = False

    def feed(self, timeout_s: float) -> None:
        """Begin to count ``timeout_s`` again; cheap, since a timer under way is left to run."""
        loop = asyncio.get_running_loop()
        self._due = loop.time() + timeout_s
        self._graced = False
        if self._timer is not None and self._timer.when() > self._due:
            self.stop()
        if self._timer is None:
            self._timer = loop.call_at(self._due, self._check)

    @property
    def running(self) -> bool:
        """Whether it counts."""
        return self._timer is not None

    def stop(self) -> None:
        """Rest until fed again."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _check(self) -> None:
        self._timer = None
        loop = asyncio.get_running_loop()
        now = loop.time()
        if now < self._due:
            self._timer = loop.call_at(self._due, self._check)
        elif now > self._due + STALL_S and not self._graced:
            self._graced = True
            self._timer = loop.call_at(now + GRACE_S, self._check)
        else:
            self._expired()


class Producer:
    """Object 1017: calls ``beat`` with that period."""

    def __init__(self, dictionary: Dictionary, beat: Callable[[], None]) -> None:
        self._beat = beat
        self._period = dictionary.add(
            Entry(0x1017, 0, Kind.U16, 0, writable=True, changed=lambda _: self.start())
        )
        self._timer: asyncio.TimerHandle | None = None

    def start(self) -> None:
        """Begin with the period that the object holds; 0 ms: no heartbeat."""
        self.stop()
        if self._period.value:
            loop = asyncio.get_running_loop()
            self._timer = loop.call_later(self._period.value * 1e-3, self._again)

    def stop(self) -> None:
        """Stop sending."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _again(self) -> None:
        self._beat()
        self.start()


class Consumer:
    """Object 1016: calls ``lost(node)`` when a node it watches stops sending.

    A node is watched from its first heartbeat on, as in the standard: a node that never begins is
    never missed.
    """

    def __init__(
        self, dictionary: Dictionary, lost: Callable[[int], None], changed: Callable[[], None]
    ) -> None:
        self._lost = lost
        self._changed = changed
        self._entries = dictionary.array(
            0x1016,
            [
                Entry(0x1016, sub, Kind.U32, 0, writable=True, changed=self._reconfigure)
                for sub in range(1, WATCHED + 1)
            ],
        )
        self._watches: dict[int, tuple[float, Watch]] = {}
        self._missing: set[int] = set()

    @property
    def misses(self) -> bool:
        """Whether a node that it watches has fallen silent, and was not heard again since."""
        return bool(self._missing)

    def refresh(self) -> None:
        """Take over the value of the object, such as after a reset."""
        self.stop()
        self._watches = {
            node: (milliseconds * 1e-3, Watch(partial(self._miss, node)))
            for node, milliseconds in self._configured()
        }

    def stop(self) -> None:
        """Watch no node until the next heartbeat."""
        self._missing.clear()
        for _, watch in self._watches.values():
            watch.stop()

    @property
    def nodes(self) -> tuple[int, ...]:
        """The nodes that are watched."""
        return tuple(self._watches)

    def heard(self, node: int) -> None:
        """Take note of a heartbeat of ``node``."""
        timeout_s, watch = self._watches[node]
        watch.feed(timeout_s)
        self._missing.discard(node)

    def _miss(self, node: int) -> None:
        self._missing.add(node)
        self._lost(node)

    def _configured(self) -> Iterator[tuple[int, int]]:
        for entry in self._entries:
            node, milliseconds = entry.value >> 16 & 0x7F, entry.value & 0xFFFF
            if node and milliseconds:
                yield node, milliseconds

    def _reconfigure(self, _: int) -> None:
        self.refresh()
        self._changed()
