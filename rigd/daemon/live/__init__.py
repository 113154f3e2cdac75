"""Passes live data and events of a rig to clients."""

from rigd.daemon.live.feed import Feed, Outlet
from rigd.daemon.live.monitor import Monitor

__all__ = ["Feed", "Monitor", "Outlet"]
