"""Control of a rig from elsewhere: a protocol on zenoh, its server, and clients."""

from rigd.remote.client import AsyncClient, Client

__all__ = ["AsyncClient", "Client"]
