"""Passes setpoints and orders of the cycle to slow devices, and what they have done back.

A slow device that takes setpoints has two slots in a mapped file. The cycle writes the first in
each cycle: the order, and the setpoints behind the limiter. The process that runs the device reads
it at its own pace, and writes into the second what it has done.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from enum import IntEnum
from pathlib import Path
from typing import Final, Self

from rigd.config.rig import DeviceConfig, RigConfig
from rigd.engine.shared.mapping import SharedFile
from rigd.engine.slow.table import Slot, slot_bytes
from rigd.sdk import SlowDriver

#: The file in the folder of a run.
ORDERS: Final = "orders"
_MAGIC: Final = b"rigdord1"


class Order(IntEnum):
    """What the cycle asks of a slow device."""

    WAIT = 0  #: not enabled yet
    ARM = 1  #: take the setpoints, and be enabled
    SAFE = 2  #: be safe, and take no more setpoints


class Done(IntEnum):
    """What a slow device has done."""

    NOTHING = 0
    ARMED = 1
    SAFE = 2


def acting_devices(rig: RigConfig) -> list[DeviceConfig]:
    """Return the slow devices of ``rig`` that take setpoints."""
    return [
        device
        for device in rig.devices.values()
        if device.setpoints and issubclass(device.driver_class, SlowDriver)
    ]


class DeviceOrders:
    """The orders for one device: the cycle gives them, the process that runs it reports."""

    def __init__(self, given: Slot, reported: Slot) -> None:
        """Use :meth:`Orders.of`."""
        self._given = given
        self._reported = reported

    def give(self, t_ns: int, order: Order, setpoints: Sequence[float]) -> None:
        """Give an order at ``t_ns`` (monotonic), with the limited setpoints in SI."""
        self._given.write(t_ns, [float(order), *setpoints])

    def given(self) -> tuple[int, Order, list[float]] | None:
        """Return the newest order with its time, or None if there is none yet."""
        found = self._given.read()
        if found is None:
            return None
        t_ns, (order, *setpoints) = found
        return t_ns, Order(int(order)), setpoints

    def report(self, done: Done) -> None:
        """Report what is done."""
        self._reported.write(0, [float(done)])

    @property
    def reported(self) -> Done:
        """What was reported last."""
        found = self._reported.read()
        return Done.NOTHING if found is None or math.isnan(found[1][0]) else Done(int(found[1][0]))


class Orders:
    """The orders for each slow device of a rig that takes setpoints."""

    def __init__(self, devices: Sequence[DeviceConfig], file: SharedFile) -> None:
        """Use :meth:`create` or :meth:`attach`."""
        self._of: dict[str, DeviceOrders] = {}
        start = 0
        for device in devices:
            slots = []
            for width in (1 + len(device.setpoints), 1):
                size = slot_bytes(width)
                slots.append(Slot(file.payload[start : start + size], width))
                start += size
            self._of[device.name] = DeviceOrders(*slots)

    @classmethod
    def create(cls, path: Path, devices: Sequence[DeviceConfig]) -> Self:
        """Make the file, without orders.

        Raises:
            RecordingError: it exists already, or there is no room for it.
        """
        size = sum(slot_bytes(1 + len(device.setpoints)) + slot_bytes(1) for device in devices)
        return cls(devices, SharedFile.create(path, _MAGIC, _identity(devices), size))

    @classmethod
    def attach(cls, path: Path, devices: Sequence[DeviceConfig]) -> Self:
        """Open the file that another process made for the same devices.

        Raises:
            RecordingError: it is missing, or for other devices.
        """
        return cls(devices, SharedFile.attach(path, _MAGIC, _identity(devices)))

    def of(self, device: str) -> DeviceOrders | None:
        """Return the orders for ``device``; None if it takes no setpoints."""
        return self._of.get(device)


def _identity(devices: Sequence[DeviceConfig]) -> int:
    """Return 64 bits that differ if devices, setpoints or their order differ."""
    layout = [
        (device.name, [(item.name, item.unit) for item in device.setpoints]) for device in devices
    ]
    return int.from_bytes(hashlib.blake2b(repr(layout).encode(), digest_size=8).digest(), "little")
