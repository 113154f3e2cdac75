"""Provides the clients of a daemon, for programs, the command line and the panel."""

from rigd.remote.client.asynchronous import AsyncClient
from rigd.remote.client.blocking import Client
from rigd.remote.client.connection import Connection
from rigd.remote.client.remotes import find_target
from rigd.remote.client.target import Target, make_target

__all__ = ["AsyncClient", "Client", "Connection", "Target", "find_target", "make_target"]
