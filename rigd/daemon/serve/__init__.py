"""The daemon: serves one rig to whoever may steer it or look on."""

from rigd.daemon.serve.daemon import Options, serve
from rigd.daemon.serve.logs import logging_to

__all__ = ["Options", "logging_to", "serve"]
