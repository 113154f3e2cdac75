"""Defines the driver that the cycle uses in place of a device that it does not read itself.

Such a device is a slow device or a block device (its library returns blocks of rows).
"""

from __future__ import annotations

from dataclasses import replace

from rigd.config.rig import DeviceConfig
from rigd.sdk import Declaration, Driver, DriverConfig


class StandIn(Driver[DriverConfig, None]):
    """Replaces a slow or block device in the cycle, for interlocks and end conditions.

    It returns the newest row once, and none until there is a newer row. The time of the row is
    ``taken_ns``, not its arrival: a block arrives after its samples. A device that accepts no
    setpoints has nothing to make safe.
    """

    taken_ns: int

    def __init__(self, device: DeviceConfig) -> None:
        super().__init__(device.config, None)
        self.declaration = replace(device.declaration, every_cycle=False)
        self.stream = device.stream
        self.taken_ns = 0

    @classmethod
    def declare(cls, config: DriverConfig) -> Declaration:
        """Return nothing: a stand-in has the declaration of its device."""
        return Declaration()

    def open(self) -> None:
        """Do nothing: the process that runs the device opens it."""

    def arm(self) -> None:
        """Do nothing if it only measures."""

    def make_safe(self) -> None:
        """Do nothing if it only measures."""
