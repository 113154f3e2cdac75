"""The server of a rig: access control, dispatch of requests, publication of live data."""

from rigd.remote.server.admission import Admission
from rigd.remote.server.asking import still_connected, working_for
from rigd.remote.server.desk import role_of
from rigd.remote.server.lease import Lease
from rigd.remote.server.publisher import Publisher
from rigd.remote.server.server import Server
from rigd.remote.server.service import Result, Service

__all__ = [
    "Admission",
    "Lease",
    "Publisher",
    "Result",
    "Server",
    "Service",
    "role_of",
    "still_connected",
    "working_for",
]
