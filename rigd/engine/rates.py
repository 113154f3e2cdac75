"""The highest row rate of a stream, from its declaration; no device is opened."""

from __future__ import annotations

from typing import Final

from rigd.config.rig import RigConfig
from rigd.model.channels import Stream
from rigd.sdk import BlockDriver, Driver

#: Rows per second of a slow device, at most.
SLOW_HZ: Final = 100.0


def most_rows_hz(rig: RigConfig, stream: Stream) -> float:
    """Return how many rows per second ``stream`` gives, at most: one per cycle, or its own rate."""
    device = rig.devices.get(stream.name)
    if device is None or issubclass(device.driver_class, Driver):
        return 1e9 / rig.period_ns
    driver = device.driver_class(device.config, None)
    return driver.rate_hz if isinstance(driver, BlockDriver) else SLOW_HZ
