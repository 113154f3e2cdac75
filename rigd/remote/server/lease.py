"""Manages the control lease: the right of one client and user at a time to command the rig.

The holder must renew the lease, or the lease expires.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from rigd.remote.protocol import ClientUser, Code, LeaseView, Refusal
from rigd.remote.protocol.limits import LEASE_S

#: How long a request for the lease is shown to its holder, in s.
ASKING_S: Final = 60.0
#: How many are shown at once.
MAX_ASKING: Final = 16


@dataclass(frozen=True)
class _Held:
    holder: ClientUser
    until_ns: int  # on the monotonic clock


class Lease:
    """The right to command a rig; every method may be called from any thread.

    ``clock`` is monotonic, ns; ``wall`` is ns since the Unix epoch.
    """

    def __init__(
        self,
        *,
        clock: Callable[[], int] = time.monotonic_ns,
        wall: Callable[[], int] = time.time_ns,
        duration_s: float = LEASE_S,
    ) -> None:
        self._clock = clock
        self._wall = wall
        self._duration_ns = round(duration_s * 1e9)
        self._lock = threading.Lock()
        self._held: _Held | None = None
        self._asking: dict[ClientUser, int] = {}  # until when each is shown
        self._lost: deque[ClientUser] = deque(maxlen=MAX_ASKING)

    def view(self) -> LeaseView:
        """Return the holder, until when it holds the lease, and those that ask for it."""
        with self._lock:
            return self._view()

    def check(self, client: ClientUser) -> None:
        """Check that ``client`` holds the lease.

        Raises:
            Refusal: it does not.
        """
        with self._lock:
            self._check(client)

    def lost(self) -> tuple[ClientUser, ...]:
        """Return the holders whose lease has expired since the last call."""
        with self._lock:
            self._expire()
            lost = tuple(self._lost)
            self._lost.clear()
            return lost

    def take(self, client: ClientUser) -> LeaseView:
        """Take the lease if it is free, and return its new state, like all commands here.

        Raises:
            Refusal: another client or user holds it.
        """
        with self._lock:
            self._expire()
            held = self._held
            if held is not None and held.holder != client:
                raise Refusal(
                    Code.LEASE_HELD,
                    f"{held.holder} has the control lease, for another {self._left_s(held):.1f} s "
                    "unless it is renewed",
                    hint="ask for control (at a terminal: `rigd remote lease request`); "
                    "a maintainer may seize it",
                )
            return self._grant(client)

    def renew(self, client: ClientUser) -> LeaseView:
        """Hold the lease for its whole duration again.

        Raises:
            Refusal: ``client`` does not hold it.
        """
        with self._lock:
            self._check(client)
            return self._grant(client)

    def release(self, client: ClientUser) -> LeaseView:
        """Give the lease back.

        Raises:
            Refusal: ``client`` does not hold it.
        """
        with self._lock:
            self._check(client)
            self._held = None
            return self._view()

    def request(self, client: ClientUser) -> LeaseView:
        """Show the holder that ``client`` requests the lease, for :data:`ASKING_S`.

        Raises:
            Refusal: no client holds it, ``client`` holds it, or there are too many requests.
        """
        with self._lock:
            self._expire()
            if self._held is None:
                raise Refusal(Code.CONFLICT, "no client has the control lease", hint="take it")
            if self._held.holder == client:
                raise Refusal(Code.CONFLICT, "the control lease is already yours")
            if client not in self._asking and len(self._asking) >= MAX_ASKING:
                raise Refusal(Code.BUSY, f"{MAX_ASKING} others have asked for the lease already")
            self._asking[client] = self._clock() + round(ASKING_S * 1e9)
            return self._view()

    def give(self, client: ClientUser, to: ClientUser) -> LeaseView:
        """Hand the lease of ``client`` over.

        ``to`` must have asked: another would not renew the lease, and its end may stop the run. If
        ``to`` names a client alone, the first user of the client that has asked gets the lease.

        Raises:
            Refusal: ``client`` does not hold the lease, or ``to`` has not asked.
        """
        with self._lock:
            self._check(client)
            asking = (item for item in self._asking if item.identity == to.identity)
            found = next((item for item in asking if to.user in ("", item.user)), None)
            if found is None:
                raise Refusal(
                    Code.NOT_FOUND,
                    f"{to} does not ask for the lease",
                    hint="`rigd remote lease` lists those that ask for it; others ask by "
                    "`rigd remote lease request`",
                )
            return self._grant(found)

    def seize(self, client: ClientUser) -> LeaseView:
        """Take the lease, even from another holder."""
        with self._lock:
            self._expire()
            return self._grant(client)

    def _grant(self, client: ClientUser) -> LeaseView:
        self._held = _Held(client, self._clock() + self._duration_ns)
        self._asking.pop(client, None)
        return self._view()

    def _check(self, client: ClientUser) -> None:
        self._expire()
        if self._held is None:
            raise Refusal(
                Code.NO_LEASE,
                "this needs the control lease, which no client has",
                hint="take control first (at a terminal: `rigd remote lease take`)",
            )
        if self._held.holder != client:
            raise Refusal(
                Code.NO_LEASE,
                f"this needs the control lease, which {self._held.holder} has",
                hint="ask for control (at a terminal: `rigd remote lease request`)",
            )

    def _expire(self) -> None:
        now_ns = self._clock()
        if self._held is not None and now_ns >= self._held.until_ns:
            self._lost.append(self._held.holder)
            self._held = None
        for item in [item for item, until_ns in self._asking.items() if now_ns >= until_ns]:
            del self._asking[item]

    def _view(self) -> LeaseView:
        self._expire()
        held = self._held
        if held is None:
            return LeaseView()  # the lease is free: no client need ask for it
        until_ns = self._wall() + held.until_ns - self._clock()
        return LeaseView(holder=held.holder, until_ns=until_ns, asked_by=tuple(self._asking))

    def _left_s(self, held: _Held) -> float:
        return (held.until_ns - self._clock()) * 1e-9
