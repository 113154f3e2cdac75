"""The stand-in of an off-cycle device in the cycle: it returns the newest row."""

from __future__ import annotations

from collections.abc import Sequence

from rigd.config.rig import DeviceConfig
from rigd.engine.clock import monotonic_ns
from rigd.engine.slow.table import Slot
from rigd.engine.stand_in import StandIn


class Latest(StandIn):
    """Gives the newest row of the table, once.

    It records nothing; whoever runs the device does.
    """

    def __init__(self, device: DeviceConfig, slot: Slot) -> None:
        super().__init__(device)
        self.silent_s = device.driver_class(device.config, None).silent_s
        self._slot = slot
        self._seen = slot.sequence  # what an earlier run of the device left is not news
        self._row_ns = 0  # when the newest row was taken, monotonic

    def read(self, t_ns: int) -> Sequence[float] | None:
        """Return the newest row, unless it was returned before or is older than ``silent_s``."""
        sequence = self._slot.sequence
        if sequence == self._seen:
            return None
        found = self._slot.read()
        if found is None:  # being written: it is there in the next cycle
            return None
        self._seen = sequence
        row_ns, row = found
        age_ns = max(monotonic_ns() - row_ns, 0)
        if row_ns == self._row_ns or age_ns > self.silent_s * 1e9:
            return None
        self._row_ns = row_ns
        self.taken_ns = t_ns - age_ns
        return row
