"""Controls a rig over the network: a protocol on zenoh (message library), server and clients."""

from rigd.remote.client import AsyncClient, Client

__all__ = ["AsyncClient", "Client"]
