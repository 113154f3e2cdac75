"""Sends a stop and waits for its reply: no event loop, no models, nothing slow to import.

This is what ``rigd remote stop`` does first. Whatever is not plain (no rig found, no reply, a
refusal) is left to :class:`~rigd.remote.client.blocking.Client`, which sends the stop again: a
second one changes nothing.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Final, TypeVar

import zenoh

from rigd.remote.client.rigs.target import Target
from rigd.remote.client.session import begin_look, begin_query, close_session, open_session
from rigd.remote.protocol.keys import Keys, Kind
from rigd.remote.protocol.stop import PlainStop

T = TypeVar("T")

#: How long the reply to a stop may take, in s, as for every client.
_REPLY_S: Final = 2.0


def send_stop(target: Target, verb: str, reason: str) -> bool | None:
    """Send ``verb`` (stop, abort or estop) to the rig, and return whether it acted.

    None: it is not known, since there is no reply that says so.

    Raises:
        LinkError: no daemon admits this client there.
    """
    session = open_session(target)
    try:
        rig = target.rig or _only_rig(session)
        if rig is None:
            return None
        request = PlainStop(reason)
        key = Keys(rig).request(Kind.STOP, target.identity, verb)
        answers = _waited(
            lambda ended: begin_query(session, key, _REPLY_S, request.encode(), ended, urgent=True)
        )
        if len(answers) != 1 or not answers[0].ok:
            return None
        return request.read_reply(answers[0].payload)
    finally:
        close_session(session)


def _only_rig(session: zenoh.Session) -> str | None:
    rigs = _waited(lambda ended: begin_look(session, ended))
    return rigs.pop() if len(rigs) == 1 else None


def _waited(begin: Callable[[Callable[[], None]], T]) -> T:
    """Return what ``begin`` collects, once it says that this is complete; zenoh ends each query."""
    ended = threading.Event()
    collected = begin(ended.set)
    ended.wait()
    return collected
