"""Implements the daemon: the process that serves one rig to clients."""

from rigd.daemon.serve.daemon import DaemonOptions, serve
from rigd.daemon.serve.upkeep.logs import logging_to

__all__ = ["DaemonOptions", "logging_to", "serve"]
