"""Controls a rig over the network: a protocol on zenoh (message library), server and clients."""

from rigd.model.errors import LinkError
from rigd.remote.client import AsyncClient, Client
from rigd.remote.protocol import Refusal

__all__ = ["AsyncClient", "Client", "LinkError", "Refusal"]
