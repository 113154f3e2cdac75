"""Login by one-time codes, and the sessions that follow.

A code travels in the fragment of a link, which browsers do not send, and opens one session; the
session's key lives in an HttpOnly cookie. Both have 256 bits and are kept as hashes only, so that
looking one up says nothing about it by the time it takes.
"""

from __future__ import annotations

import asyncio
import hashlib
import secrets
from collections.abc import Callable
from dataclasses import dataclass, field
from time import monotonic
from typing import Final, Literal

from rigd.panel.rates import Bucket
from rigd.panel.session_store import SessionStore, StoredSession

Role = Literal["operator", "observer"]

#: How long a code that was given to somebody opens a session.
CODE_S: Final = 15 * 60.0
#: How long a session lasts that no page uses: a working day, and the night after it.
IDLE_S: Final = 24 * 3600.0
#: Sessions at once; a laboratory has fewer screens.
MOST_SESSIONS: Final = 64
#: Codes of each role that wait at once.
MOST_CODES: Final = 16


@dataclass(eq=False)
class Session:
    """One browser that was let in."""

    name: str  #: what its user is called
    role: Role
    number: int
    used_s: float
    pages: int = 0  #: pages that are open now
    left_s: float = 0.0  #: when the last page was closed
    has_control: bool = False
    requests: Bucket = field(default_factory=lambda: Bucket(per_s=20.0, burst=60.0))
    stops: Bucket = field(default_factory=lambda: Bucket(per_s=5.0, burst=20.0))
    over: asyncio.Event = field(default_factory=asyncio.Event)  #: its pages are to close


@dataclass(frozen=True)
class _Code:
    role: Role
    until_s: float


class Sessions:
    """All codes and sessions; sessions outlive the process where there is a ``book``."""

    def __init__(
        self, now: Callable[[], float] = monotonic, book: SessionStore | None = None
    ) -> None:
        self._now = now
        self._book = book
        self._codes: dict[bytes, _Code] = {}
        self._sessions: dict[bytes, Session] = {}
        self._count = 0
        self._recall()

    def invite(self, role: Role, valid_s: float = CODE_S) -> str:
        """Return a new code that opens one session."""
        self._forget_old()
        # Of their role, so that who watches takes no code from who commands; the oldest of those
        # that last as long, so that the links told at the start outlive those given since.
        waiting = [key for key, item in self._codes.items() if item.role == role]
        if len(waiting) >= MOST_CODES:
            del self._codes[min(waiting, key=lambda key: self._codes[key].until_s)]
        code = secrets.token_urlsafe(32)
        self._codes[_hash(code)] = _Code(role, self._now() + valid_s)
        return code

    def redeem(self, code: str, name: str) -> tuple[str, Session] | None:
        """Return a session's key and the session that ``code`` opens; None if it opens none."""
        self._forget_old()
        found = self._codes.pop(_hash(code), None)
        if found is None:
            return None
        if len(self._sessions) >= MOST_SESSIONS:
            least = min(self._sessions, key=lambda key: _worth(self._sessions[key]))
            self._sessions.pop(least).over.set()
        self._count += 1
        key = secrets.token_urlsafe(32)
        session = Session(name, found.role, self._count, self._now())
        self._sessions[_hash(key)] = session
        self._keep()
        return key, session

    def find(self, key: str) -> Session | None:
        """Return the session that ``key`` belongs to, and note that it is in use."""
        session = self._sessions.get(_hash(key))
        if session is None or self._is_over(session):
            return None
        session.used_s = self._now()
        return session

    def end(self, key: str) -> None:
        """Close a session, and with it its pages."""
        session = self._sessions.pop(_hash(key), None)
        if session is not None:
            session.over.set()
            self._keep()

    @property
    def in_control(self) -> Session | None:
        """The session that has control, which outlives the panel."""
        return next((session for session in self._sessions.values() if session.has_control), None)

    def give_control(self, session: Session | None) -> None:
        """From now on it is this session that has control, or none."""
        for item in self._sessions.values():
            item.has_control = item is session
        self._keep()

    def open_page(self, session: Session) -> None:
        """A page of the session has connected."""
        session.pages += 1
        self._keep()

    def close_page(self, session: Session) -> None:
        """A page of the session is gone."""
        session.pages -= 1
        session.used_s = session.left_s = self._now()
        self._keep()

    def is_gone(self, session: Session, grace_s: float) -> bool:
        """Whether no page of the session has been open for ``grace_s``, or it was closed."""
        if session not in self._sessions.values():
            return True
        return session.pages == 0 and self._now() - session.left_s > grace_s

    def _is_over(self, session: Session) -> bool:
        return session.pages == 0 and self._now() - session.used_s > IDLE_S

    def _recall(self) -> None:
        """Take up the sessions that stand in the book."""
        if self._book is None:
            return
        since_s, kept = self._book.read()
        for item in kept:
            # While a page was open, the session was in use up to the end of that process.
            idle_s = 0.0 if item.idle_s is None else item.idle_s + since_s
            session = Session(
                item.name, item.role, item.number, self._now() - idle_s,
                left_s=self._now(), has_control=item.has_control,
            )  # fmt: skip
            if not self._is_over(session):
                self._sessions[bytes.fromhex(item.key_sha256)] = session
            self._count = max(self._count, item.number)

    def _keep(self) -> None:
        if self._book is None:
            return
        now = self._now()
        self._book.write(
            [
                StoredSession(key.hex(), session.name, session.role, session.number,
                     None if session.pages else now - session.used_s, session.has_control)
                for key, session in self._sessions.items()
            ]
        )  # fmt: skip

    def _forget_old(self) -> None:
        now = self._now()
        self._codes = {key: code for key, code in self._codes.items() if code.until_s > now}
        self._sessions = {
            key: session for key, session in self._sessions.items() if not self._is_over(session)
        }


def _worth(session: Session) -> tuple[bool, bool, float]:
    """Return what speaks for keeping a session; the least makes room for another.

    An open page asks for nothing while it is looked at, so that its last use says little.
    """
    return session.role == "operator", session.pages > 0, session.used_s


def _hash(secret: str) -> bytes:
    return hashlib.sha256(secret.encode(errors="replace")).digest()
