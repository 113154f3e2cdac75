"""Opens zenoh sessions and begins queries; :mod:`rigd.remote.client.queries` awaits their replies.

zenoh calls functions of this module on its network threads. These functions only pass data on.
"""

from __future__ import annotations

import atexit
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import zenoh

from rigd.model.errors import ConfigError, LinkError
from rigd.remote.client.rigs.target import Target
from rigd.remote.network import client_config
from rigd.remote.protocol.keys import EVERY_ALIVE

#: How long the rigs of a network may take to answer, in s.
QUESTION_S: Final = 2.0
#: Sessions to close, by their id.
_opened: Final[dict[int, zenoh.Session]] = {}


@dataclass(frozen=True)
class QueryReply:
    """The answer to a query: a reply or, if not ``ok``, an error reply."""

    ok: bool
    payload: bytes


class TimedOut(Exception):
    """No daemon answered in time; whether a daemon has received the request is not known."""


def open_session(target: Target) -> zenoh.Session:
    """Return a session with the daemon at an address; blocks while it connects.

    To be closed by :func:`close_session`; the end of Python closes it otherwise.

    Raises:
        LinkError: no daemon admits this client there.
    """
    try:
        session = zenoh.open(client_config([target.endpoint], target.tls))
    except zenoh.ZError as error:
        hint = f"{target.note}{doubt(target)}"
        raise LinkError(f"no daemon admits this client at {target.endpoint}", hint=hint) from error
    _opened[id(session)] = session
    return session


def close_session(session: zenoh.Session) -> None:
    """Close a session; closing twice is silent. Blocks."""
    session.close()
    _opened.pop(id(session), None)


@atexit.register
def _close_all() -> None:
    """Close what a script or notebook left open.

    A thread of zenoh that calls Python while Python ends aborts the process (SIGABRT).
    """
    for session in list(_opened.values()):
        close_session(session)


def doubt(target: Target) -> str:
    """Return the possible reasons why no daemon admits a client; TLS does not tell it. Blocks."""
    tls = target.tls
    if tls is None:
        return "is the daemon running there (rigd serve), and is the address right?"
    from rigd.remote.certificates import check_usable, distrusted, refused_daemon

    try:
        check_usable(tls)
    except ConfigError as error:
        return f"your certificate: {error.one_line}"
    return (
        distrusted(tls)
        or refused_daemon(target.endpoint, tls)
        or "is the daemon running there (rigd serve), and is the address right? Does it trust "
        f"{tls.ca}, which signed {tls.certificate.name}, and does its rig file give this name a "
        "role?"
    )


def is_connected(session: zenoh.Session) -> bool:
    """Return whether the daemon is connected now; zenoh connects again by itself."""
    return bool(session.info.peers_zid() or session.info.routers_zid())


def begin_query(
    session: zenoh.Session,
    key: str,
    timeout_s: float,
    payload: bytes,
    ended: Callable[[], None],
    *,
    urgent: bool = False,
) -> list[QueryReply]:
    """Begin a query; return the list of its answers, complete when ``ended`` is called.

    An ``urgent`` query is sent before all others on the connection, and so are its answers.
    """
    answers: list[QueryReply] = []

    def answered(reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            answers.append(QueryReply(True, reply.ok.payload.to_bytes()))
        elif reply.err is not None:
            answers.append(QueryReply(False, reply.err.payload.to_bytes()))

    session.get(
        key,
        zenoh.handlers.Callback(answered, ended, indirect=False),
        payload=payload,
        timeout=timeout_s,
        priority=zenoh.Priority.REAL_TIME if urgent else zenoh.Priority.DATA,
        express=urgent,
        # If this session ends, the daemon cancels the calculation for it.
        source_info=zenoh.SourceInfo(session.id, 0),
    )
    return answers


def begin_look(session: zenoh.Session, ended: Callable[[], None]) -> set[str]:
    """Begin to look for rigs; return the set of their names, complete when ``ended`` is called."""
    rigs: set[str] = set()

    def alive(reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            rigs.add(str(reply.ok.key_expr).split("/")[1])

    session.liveliness().get(
        EVERY_ALIVE, zenoh.handlers.Callback(alive, ended, indirect=False), timeout=QUESTION_S
    )
    return rigs


def listen(
    session: zenoh.Session, key: str, take: Callable[[bytes], None]
) -> zenoh.Subscriber[None]:
    """Subscribe: ``take`` gets payloads on a thread of zenoh's until undeclared."""

    def on_sample(sample: zenoh.Sample) -> None:
        take(sample.payload.to_bytes())

    return session.declare_subscriber(key, zenoh.handlers.Callback(on_sample, indirect=False))
