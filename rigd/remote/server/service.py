"""Defines the interface that the daemon implements to carry out requests for the server."""

from __future__ import annotations

from typing import Protocol

from rigd.remote.protocol import Message, Requester, Status, Verb


class Service(Protocol):
    """Carries out requests that the server has checked.

    The server's worker threads call it: one request of each :class:`rigd.remote.protocol.Lane` at a
    time, so up to seven at once.
    """

    @property
    def stops(self) -> int:
        """How many stops it has carried out; read as each request comes, so it must be quick."""
        ...

    def status(self) -> Status:
        """Return the state of everything; called every half second, so it must be quick."""
        ...

    def answer(self, verb: Verb, requester: Requester, args: Message) -> Message:
        """Carry out ``verb``, and return its result once it is done or under way.

        The role of the requester has been checked, and the lease if the verb needs it; ``args`` and
        the result have the types that the table of verbs names. A stop must not wait for anything.
        It may raise :class:`rigd.remote.protocol.Refusal`; another error of rigd's reaches the
        client as ``refused``, all else is logged and reaches it as ``internal``.
        """
        ...
