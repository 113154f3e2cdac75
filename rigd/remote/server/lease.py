"""The control lease: one identity at a time commands the rig, as long as it renews the lease."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from rigd.remote.protocol import Code, LeaseView, Message, Refusal
from rigd.remote.protocol.arguments import Receiver
from rigd.remote.protocol.limits import LEASE_S

#: How long somebody who asked for the lease is shown to its holder.
ASKING_S: Final = 60.0
#: How many are shown at once.
MAX_ASKING: Final = 16


@dataclass(frozen=True)
class _Held:
    holder: str
    until_ns: int  # on the monotonic clock


class Lease:
    """Who may command; every method may be called from any thread.

    ``may_hold`` says whether the lease can be given to an identity. ``clock`` is monotonic, ns;
    ``wall`` is ns since the Unix epoch.
    """

    def __init__(
        self,
        may_hold: Callable[[str], bool],
        *,
        clock: Callable[[], int] = time.monotonic_ns,
        wall: Callable[[], int] = time.time_ns,
        duration_s: float = LEASE_S,
    ) -> None:
        self._may_hold = may_hold
        self._clock = clock
        self._wall = wall
        self._duration_ns = round(duration_s * 1e9)
        self._lock = threading.Lock()
        self._held: _Held | None = None
        self._asking: dict[str, int] = {}  # who asked, and until when that is shown
        self._lost: deque[str] = deque(maxlen=MAX_ASKING)

    def view(self) -> LeaseView:
        """Return who has the lease, until when, and who asks for it."""
        with self._lock:
            return self._view()

    def check(self, identity: str) -> None:
        """Check that ``identity`` has the lease.

        Raises:
            Refusal: it has not.
        """
        with self._lock:
            self._check(identity)

    def lost(self) -> tuple[str, ...]:
        """Return whose lease ran out since the last call: they vanished without a word."""
        with self._lock:
            self._expire()
            lost = tuple(self._lost)
            self._lost.clear()
            return lost

    def obey(self, identity: str, verb: str, args: Message) -> LeaseView:
        """Carry out one of the commands about the lease, and return how it then stands.

        Raises:
            Refusal: it cannot be.
            KeyError: ``verb`` is not about the lease.
        """
        do: dict[str, Callable[[str], None]] = {
            "lease_take": self._take,
            "lease_renew": self._renew,
            "lease_release": self._release,
            "lease_request": self._request,
            "lease_seize": self._grant,
        }
        with self._lock:
            self._expire()
            if isinstance(args, Receiver):
                self._give(identity, args.to)
            else:
                do[verb](identity)
            return self._view()

    def _take(self, identity: str) -> None:
        held = self._held
        if held is not None and held.holder != identity:
            raise Refusal(
                Code.LEASE_HELD,
                f"{held.holder} has the control lease, for another {self._left_s(held):.1f} s "
                "unless it is renewed",
                hint="ask for it (`rigd remote lease request`); a maintainer may seize it",
            )
        self._grant(identity)

    def _renew(self, identity: str) -> None:
        self._check(identity)
        self._grant(identity)

    def _release(self, identity: str) -> None:
        self._check(identity)
        self._held = None

    def _request(self, identity: str) -> None:
        if self._held is None:
            raise Refusal(Code.CONFLICT, "nobody has the control lease", hint="take it")
        if self._held.holder == identity:
            raise Refusal(Code.CONFLICT, "the control lease is already yours")
        if identity not in self._asking and len(self._asking) >= MAX_ASKING:
            raise Refusal(Code.BUSY, f"{MAX_ASKING} others have asked for the lease already")
        self._asking[identity] = self._clock() + round(ASKING_S * 1e9)

    def _give(self, identity: str, to: str) -> None:
        self._check(identity)
        if not self._may_hold(to):
            raise Refusal(
                Code.REFUSED,
                f"{to} may not hold the lease: it is no operator's name, or no client of that "
                "name has asked this rig for anything",
                hint="`rigd remote lease` says who asks for it",
            )
        self._grant(to)

    def _grant(self, identity: str) -> None:
        self._held = _Held(identity, self._clock() + self._duration_ns)
        self._asking.pop(identity, None)

    def _check(self, identity: str) -> None:
        self._expire()
        if self._held is None:
            raise Refusal(
                Code.NO_LEASE,
                "this needs the control lease, which nobody has",
                hint="take it first (`rigd remote lease take`)",
            )
        if self._held.holder != identity:
            raise Refusal(
                Code.NO_LEASE,
                f"this needs the control lease, which {self._held.holder} has",
                hint="ask for it (`rigd remote lease request`)",
            )

    def _expire(self) -> None:
        now_ns = self._clock()
        if self._held is not None and now_ns >= self._held.until_ns:
            self._lost.append(self._held.holder)
            self._held = None
        for name in [name for name, until_ns in self._asking.items() if now_ns >= until_ns]:
            del self._asking[name]

    def _view(self) -> LeaseView:
        self._expire()
        held = self._held
        if held is None:
            return LeaseView()  # who has asked may take it
        until_ns = self._wall() + held.until_ns - self._clock()
        return LeaseView(holder=held.holder, until_ns=until_ns, asked_by=tuple(self._asking))

    def _left_s(self, held: _Held) -> float:
        return (held.until_ns - self._clock()) * 1e-9
