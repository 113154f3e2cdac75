"""The interface that the daemon implements for the server."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

from rigd.remote.protocol import Message, Role, Status

#: What a request is answered with: a message, or plain data that JSON has a form for.
Result = Message | Mapping[str, Any]


class Service(Protocol):
    """Carries out requests that the server found in order.

    Called on the server's worker threads: one request of each :class:`rigd.remote.protocol.Lane`
    at a time, so up to seven at once. The role has been checked, and the lease where the verb needs
    it; ``args`` and what is returned are of the types that the table of verbs names. ``user`` is
    for whom the client asks, as it says; "" where it speaks for itself. Any method may raise
    :class:`rigd.remote.protocol.Refusal`; another error of rigd's is told as ``refused``, whatever
    else it raises is logged and told as ``internal``.
    """

    def status(self) -> Status:
        """Return the state of everything; called every half second, so it must be quick."""
        ...

    def ask(self, identity: str, role: Role, what: str, args: Message) -> Result:
        """Return what was asked for; changes nothing."""
        ...

    def command(self, identity: str, role: Role, verb: str, args: Message, user: str) -> Result:
        """Do it, and return once it is done or under way."""
        ...

    def stop(self, identity: str, verb: str, reason: str, user: str) -> Result:
        """Stop, abort or estop whatever runs; nothing may keep this waiting."""
        ...
