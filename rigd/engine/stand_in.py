"""The driver that the cycle mounts in place of an off-cycle device."""

from __future__ import annotations

from rigd.config.rig import DeviceConfig
from rigd.sdk import Driver


class StandIn(Driver):
    """Stands in the cycle for a slow or block device, for interlocks and end conditions to see it.

    It gives the newest row once, and none until there is a newer one. The row is as old as
    ``taken_ns`` says, not as its arrival: a block comes behind the samples in it. There is nothing
    to make safe: such devices take no setpoints.
    """

    every_cycle = False
    taken_ns: int  #: when the row that :meth:`read` gave last was taken, on the clock of the cycle

    def __init__(self, device: DeviceConfig) -> None:
        super().__init__(device.config, None)
        self.channels = device.channels
        self.has_status = device.has_status
        self.stream = device.stream
        self.taken_ns = 0

    def open(self) -> None:
        """Do nothing: whoever runs the device has opened it."""

    def arm(self) -> None:
        """Do nothing: it only measures."""

    def make_safe(self) -> None:
        """Do nothing: it only measures."""
