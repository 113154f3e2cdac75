"""Gives the control cycle a stand-in driver for each device that runs outside the cycle.

This module imports nothing that starts such a device.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from rigd.config.rig import DeviceConfig, RigConfig
from rigd.engine.clock import monotonic_ns
from rigd.engine.cycle.stand_in import StandIn
from rigd.engine.cycle.wiring import in_cycle
from rigd.engine.play.windows import Windows
from rigd.engine.slow.orders import ORDERS, DeviceOrders, Done, Order, Orders, acting_devices
from rigd.engine.slow.table import LatestTable, Slot
from rigd.model.channels import Stream
from rigd.sdk import Driver

#: The table of latest values in the folder of a run.
TABLE: Final = "latest"


def off_cycle_streams(rig: RigConfig) -> list[Stream]:
    """Return the streams of the devices of ``rig`` that run beside the cycle."""
    return [device.stream for device in rig.devices.values() if not in_cycle(device)]


class LatestRowProxy(StandIn):
    """Returns each newest row of the table once.

    The process that runs the device records the rows.
    """

    def __init__(self, device: DeviceConfig, slot: Slot) -> None:
        super().__init__(device)
        self._silent_ns = round(self.declaration.silent_s * 1e9)
        self._slot = slot
        self._seen = slot.sequence  # a row from an earlier run of the device is not new
        self._row_ns = 0  # time of the newest row, monotonic

    def read(self, t_ns: int) -> Sequence[float] | None:
        """Return the newest row, unless it was returned before or is older than ``silent_s``."""
        sequence = self._slot.sequence
        if sequence == self._seen:
            return None
        found = self._slot.read()
        if found is None:  # the row is being written: it is there in the next cycle
            return None
        self._seen = sequence
        row_ns, row = found
        age_ns = max(monotonic_ns() - row_ns, 0)
        if row_ns == self._row_ns or age_ns > self._silent_ns:
            return None
        self._row_ns = row_ns
        self.taken_ns = t_ns - age_ns
        return row


class OrderingProxy(LatestRowProxy):
    """Passes the setpoints of a slow device on, too: see :mod:`rigd.engine.slow.orders`.

    The process that runs the device checks that it is safe: that takes longer than a cycle may.
    """

    def __init__(self, device: DeviceConfig, slot: Slot, orders: DeviceOrders) -> None:
        super().__init__(device, slot)
        self._orders = orders
        self._order = Order.WAIT
        self._setpoints = [device.limits[item.name].rest for item in device.setpoints]

    def arm(self) -> None:
        """Order the device to take setpoints and to be enabled."""
        self._order = Order.ARM
        self._give()

    def ready(self) -> bool:
        """Return whether the device has reported that it is enabled."""
        return self._order is Order.WAIT or self._orders.reported is Done.ARMED

    def write(self, setpoints: Sequence[float]) -> None:
        """Pass on the setpoints of this cycle; the device takes the newest at its own pace."""
        self._setpoints[:] = setpoints
        self._give()

    def make_safe(self) -> None:
        """Order the device to be safe; what the cycle writes after that is not taken."""
        self._order = Order.SAFE
        self._give()

    def _give(self) -> None:
        self._orders.give(monotonic_ns(), self._order, self._setpoints)


class StandIns:
    """Provides the stand-ins and recording windows of the devices that run outside the cycle."""

    def __init__(self, rig: RigConfig, folder: Path) -> None:
        streams = off_cycle_streams(rig)
        self._table = LatestTable.attach(folder / TABLE, streams) if streams else None
        acting = acting_devices(rig)
        self._orders = Orders.attach(folder / ORDERS, acting) if acting else None
        self.windows: Mapping[str, Windows] = {}  #: when their rows are recorded, by stream
        if self._table is not None:
            self.windows = {stream.name: self._table.windows(stream.name) for stream in streams}

    def of(self, device: DeviceConfig) -> Driver:
        """Return the driver that replaces ``device`` in the cycle."""
        if self._table is None:
            raise TypeError(f"{device.name} is not an off-cycle device")
        slot = self._table.slot(device.name)
        orders = None if self._orders is None else self._orders.of(device.name)
        if orders is None:
            return LatestRowProxy(device, slot)
        return OrderingProxy(device, slot, orders)
