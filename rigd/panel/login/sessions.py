"""Logs users in to the panel with one-time codes, and keeps their sessions.

A link contains the code in its fragment, which browsers do not send. The code opens one session.
The browser keeps the key of the session in an HttpOnly cookie. Codes and keys have 256 bits. The
panel keeps only their hashes, so that the duration of a look-up reveals nothing about them.
"""

from __future__ import annotations

import asyncio
import hashlib
import itertools
import secrets
from collections.abc import Callable
from dataclasses import dataclass, field
from time import monotonic
from typing import Final

from rigd.panel.login.session_store import SessionStore, StoredSession
from rigd.panel.messages import Role
from rigd.remote.request_rates import Bucket

#: How long a code opens a session, in s.
CODE_S: Final = 15 * 60.0
#: How long an unused session lasts: a working day and the following night.
IDLE_S: Final = 24 * 3600.0
#: Most sessions; a laboratory has fewer screens.
MOST_SESSIONS: Final = 64
#: Most unused codes of each role.
MOST_CODES: Final = 16


@dataclass(eq=False)
class Session:
    """One browser that has logged in."""

    name: str  #: of its user; unique among the sessions
    role: Role
    used_s: float
    pages: int = 0  #: pages that are open now
    requests: Bucket = field(default_factory=lambda: Bucket(per_s=20.0, burst=60.0))
    stops: Bucket = field(default_factory=lambda: Bucket(per_s=5.0, burst=20.0))
    over: asyncio.Event = field(default_factory=asyncio.Event)  #: its pages must close


@dataclass(frozen=True)
class _Code:
    role: Role
    until_s: float


class Sessions:
    """Keeps all codes and sessions; with a ``store``, sessions are still valid after a restart."""

    def __init__(
        self, now: Callable[[], float] = monotonic, store: SessionStore | None = None
    ) -> None:
        self._now = now
        self._store = store
        self._codes: dict[bytes, _Code] = {}
        self._sessions: dict[bytes, Session] = {}
        self._recall()

    def invite(self, role: Role, valid_s: float = CODE_S) -> str:
        """Return a new code that opens one session."""
        self._forget_old()
        # Codes of the same role, so that observers take no code from operators; the first to
        # expire, so that the links printed at the start outlive later links.
        waiting = [key for key, item in self._codes.items() if item.role == role]
        if len(waiting) >= MOST_CODES:
            del self._codes[min(waiting, key=lambda key: self._codes[key].until_s)]
        code = secrets.token_urlsafe(32)
        self._codes[_hash(code)] = _Code(role, self._now() + valid_s)
        return code

    def redeem(self, code: str, name: str) -> tuple[str, Session] | None:
        """Return the key and the session that ``code`` opens; None if the code is not valid."""
        self._forget_old()
        found = self._codes.pop(_hash(code), None)
        if found is None:
            return None
        if len(self._sessions) >= MOST_SESSIONS:
            least = min(self._sessions, key=lambda key: _worth(self._sessions[key]))
            self._sessions.pop(least).over.set()
        key = secrets.token_urlsafe(32)
        session = Session(self._free_name(name), found.role, self._now())
        self._sessions[_hash(key)] = session
        self._keep()
        return key, session

    def find(self, key: str) -> Session | None:
        """Return the session with the key ``key``, and note that it is in use."""
        session = self._sessions.get(_hash(key))
        if session is None or self._is_over(session):
            return None
        session.used_s = self._now()
        return session

    def end(self, key: str) -> None:
        """End a session, and close its pages."""
        session = self._sessions.pop(_hash(key), None)
        if session is not None:
            session.over.set()
            self._keep()

    def may_hold_lease(self, name: str) -> bool:
        """Return whether the user ``name`` is an operator who has a page open."""
        return any(
            item.name == name and item.role == "operator" and item.pages > 0
            for item in self._sessions.values()
        )

    def open_page(self, session: Session) -> None:
        """Note that a page of the session has connected."""
        session.pages += 1
        self._keep()

    def close_page(self, session: Session) -> None:
        """Note that a page of the session has disconnected."""
        session.pages -= 1
        session.used_s = self._now()
        self._keep()

    def _free_name(self, name: str) -> str:
        """Return ``name``, with a number if another session already has that name."""
        taken = {item.name for item in self._sessions.values()}
        others = (f"{name} ({number})" for number in itertools.count(2))
        return next(item for item in itertools.chain([name], others) if item not in taken)

    def _is_over(self, session: Session) -> bool:
        return session.pages == 0 and self._now() - session.used_s > IDLE_S

    def _recall(self) -> None:
        """Restore the stored sessions."""
        if self._store is None:
            return
        since_s, kept = self._store.read()
        for item in kept:
            # If a page was open, the session was in use until that process ended.
            idle_s = 0.0 if item.idle_s is None else item.idle_s + since_s
            session = Session(self._free_name(item.name), item.role, self._now() - idle_s)
            if not self._is_over(session):
                self._sessions[bytes.fromhex(item.key_sha256)] = session

    def _keep(self) -> None:
        if self._store is None:
            return
        now = self._now()
        self._store.write(
            [
                StoredSession(
                    key.hex(),
                    session.name,
                    session.role,
                    None if session.pages else now - session.used_s,
                )
                for key, session in self._sessions.items()
            ]
        )

    def _forget_old(self) -> None:
        now = self._now()
        self._codes = {key: code for key, code in self._codes.items() if code.until_s > now}
        self._sessions = {
            key: session for key, session in self._sessions.items() if not self._is_over(session)
        }


def _worth(session: Session) -> tuple[bool, bool, float]:
    """Return the rank of a session; the session with the lowest rank is removed for another.

    An open page sends no requests while a person only looks at it: its last use is no measure.
    """
    return session.role == "operator", session.pages > 0, session.used_s


def _hash(secret: str) -> bytes:
    return hashlib.sha256(secret.encode(errors="replace")).digest()
