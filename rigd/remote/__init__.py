"""Controls a rig over the network: a protocol on zenoh (message library), server and clients.

Each name is imported when it is used first: a stop needs none of them.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from rigd.model.errors import LinkError
    from rigd.remote.client.asynchronous import AsyncClient
    from rigd.remote.client.blocking import Client
    from rigd.remote.protocol.refusal import Refusal

__all__ = ["AsyncClient", "Client", "LinkError", "Refusal"]

_PLACES: Final = {
    "AsyncClient": "rigd.remote.client.asynchronous",
    "Client": "rigd.remote.client.blocking",
    "LinkError": "rigd.model.errors",
    "Refusal": "rigd.remote.protocol.refusal",
}

if not TYPE_CHECKING:  # else every name would be there for mypy

    def __getattr__(name: str) -> Any:
        """Import a name when it is used first."""
        if name not in _PLACES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        return getattr(import_module(_PLACES[name]), name)
