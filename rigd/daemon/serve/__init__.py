"""The daemon that serves one rig to clients."""

from rigd.daemon.serve.daemon import Options, serve
from rigd.daemon.serve.logs import logging_to

__all__ = ["Options", "logging_to", "serve"]
