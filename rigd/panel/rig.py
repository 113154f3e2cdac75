"""Defines what the panel needs from its rig: requests, status, events, frames of live data."""

from __future__ import annotations

from collections.abc import AsyncIterator, Mapping
from typing import Any, Protocol, TypeVar

from rigd.remote.protocol import Kind, RigEvent, Status

R = TypeVar("R")


class Rig(Protocol):
    """A rig on the network; :class:`rigd.remote.client.connection.Connection` is one."""

    @property
    def rig(self) -> str:
        """Its name."""
        ...

    @property
    def identity(self) -> str:
        """The name under which the daemon knows this client."""
        ...

    async def request(
        self, kind: Kind, verb: str, args: Mapping[str, Any], result: type[R], user: str = ""
    ) -> R:
        """Make a request in the name of ``user``, and return its result.

        Raises:
            Refusal: the daemon does not carry it out.
            LinkError: no daemon replied.
        """
        ...

    async def request_apart(
        self, kind: Kind, verb: str, args: Mapping[str, Any], result: type[R], user: str = ""
    ) -> R:
        """Make a request that the daemon gives up when this is cancelled; see :meth:`request`."""
        ...

    def statuses(self) -> AsyncIterator[Status]:
        """Yield the status at every change and twice a second; continue after an interruption."""
        ...

    def events(self) -> AsyncIterator[RigEvent]:
        """Yield every event from now on."""
        ...

    def frames(self) -> AsyncIterator[bytes]:
        """Yield live frames; a frame that arrives too late is left out."""
        ...
