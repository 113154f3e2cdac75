"""A device beside the cycle as the cycle sees it."""

from __future__ import annotations

from collections.abc import Sequence

from rigd.config.rig import DeviceConfig
from rigd.engine.clock import monotonic_ns
from rigd.engine.slow.table import Slot
from rigd.sdk import Driver


class Latest(Driver):
    """Stands in the cycle for a slow or block device, so that interlocks and end conditions see it.

    It gives the newest row of the table once, and none until there is a newer one: the values
    then age as those of any device do. It records nothing; whoever runs the device does. There is
    nothing to make safe: such devices take no setpoints.
    """

    every_cycle = False

    def __init__(self, device: DeviceConfig, slot: Slot) -> None:
        super().__init__(device.config, None)
        self.channels = device.channels
        self.has_status = device.has_status
        self.silent_s = device.driver_class(device.config, None).silent_s
        self._slot = slot
        self._seen = slot.sequence  # what an earlier run of the device left is not news
        self._taken_ns = 0

    def open(self) -> None:
        """Do nothing: whoever runs the device has opened it."""

    def arm(self) -> None:
        """Do nothing: it only measures."""

    def read(self, t_ns: int) -> Sequence[float] | None:
        """Return the newest row, unless it was returned before or is older than ``silent_s``."""
        sequence = self._slot.sequence
        if sequence == self._seen:
            return None
        found = self._slot.read()
        if found is None:  # being written: it is there in the next cycle
            return None
        self._seen = sequence
        taken_ns, row = found
        if taken_ns == self._taken_ns or monotonic_ns() - taken_ns > self.silent_s * 1e9:
            return None
        self._taken_ns = taken_ns
        return row

    def make_safe(self) -> None:
        """Do nothing: it only measures."""
