"""Live data and events of a rig for clients."""

from rigd.daemon.live.feed import Feed, Outlet
from rigd.daemon.live.monitor import Monitor

__all__ = ["Feed", "Monitor", "Outlet"]
