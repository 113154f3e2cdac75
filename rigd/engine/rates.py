"""The highest row rate of a stream and the rows of its ring; no device is opened."""

from __future__ import annotations

from typing import Final

from rigd.config.rig import RigConfig
from rigd.engine.wiring import in_cycle
from rigd.model.channels import Stream
from rigd.sdk import BlockDriver, Driver

#: Rows per second of a slow device, at most.
SLOW_HZ: Final = 100.0
#: Rows beyond what a ring is to hold, so that even that of a slow stream has room for a burst.
SPARE_ROWS: Final = 1000


def most_rows_hz(rig: RigConfig, stream: Stream) -> float:
    """Return how many rows per second ``stream`` gives, at most: one per cycle, or its own rate."""
    device = rig.devices.get(stream.name)
    if device is None or issubclass(device.driver_class, Driver):
        return 1e9 / rig.period_ns
    driver = device.driver_class(device.config, None)
    return driver.rate_hz if isinstance(driver, BlockDriver) else SLOW_HZ


def ring_rows(rig: RigConfig, stream: Stream, ring_s: float, every: int = 1) -> int:
    """Return how many rows a ring has that holds ``stream`` for so long, one of ``every`` rows."""
    in_this_cycle = stream.name not in rig.devices or in_cycle(rig.devices[stream.name])
    rate_hz = most_rows_hz(rig, stream) / (every if in_this_cycle else 1)
    return round(ring_s * rate_hz) + SPARE_ROWS
