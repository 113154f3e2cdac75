"""Interface of the panel to its rig: requests, status, events, frames of live data.

:class:`rigd.remote.client.Connection` is one.
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Mapping
from typing import Any, Protocol

#: An object of JSON: the arguments and the result of every verb.
Object = dict[str, Any]


class Rig(Protocol):
    """A rig somewhere on the network.

    Every verb raises a :class:`rigd.model.errors.RigdError`: with a ``code`` where the daemon
    refused, :class:`~rigd.model.errors.LinkError` where nobody answered.
    """

    @property
    def identity(self) -> str:
        """The name under which the daemon knows this client."""
        ...

    async def ask(self, what: str, args: Mapping[str, Any]) -> Object:
        """Read something; changes nothing."""
        ...

    async def command(self, verb: str, args: Mapping[str, Any], user: str = "") -> Object:
        """Give a command; ``user`` is for whom."""
        ...

    async def stop(self, verb: str, user: str = "") -> Object:
        """``stop``, ``abort`` or ``estop``; ``user`` is for whom."""
        ...

    def statuses(self) -> AsyncIterator[Object]:
        """Yield the status at every change and twice a second; goes on after a silence."""
        ...

    def events(self) -> AsyncIterator[Object]:
        """Yield every event from now on."""
        ...

    def frames(self) -> AsyncIterator[bytes]:
        """Yield live frames; one that comes too late is left out."""
        ...
