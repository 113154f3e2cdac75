"""What a rig does, shown while it does it: live data and events for whoever looks on."""

from rigd.daemon.live.feed import Feed, Outlet
from rigd.daemon.live.monitor import Monitor

__all__ = ["Feed", "Monitor", "Outlet"]
