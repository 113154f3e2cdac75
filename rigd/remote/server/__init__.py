"""Provides the server of a rig: access control, dispatch of requests, publication of live data."""

from rigd.remote.server.lease import Lease
from rigd.remote.server.publisher import RigPublisher
from rigd.remote.server.server import Server, still_connected, working_for
from rigd.remote.server.service import Service

__all__ = [
    "Lease",
    "RigPublisher",
    "Server",
    "Service",
    "still_connected",
    "working_for",
]
