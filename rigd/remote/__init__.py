"""Remote control of a rig: a protocol on zenoh, its server and its clients."""

from rigd.remote.client import AsyncClient, Client

__all__ = ["AsyncClient", "Client"]
