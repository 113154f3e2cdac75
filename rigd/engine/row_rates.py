"""Computes the highest row rate of a stream and the number of rows in its ring (buffer).

No device is opened.
"""

from __future__ import annotations

from typing import Final

from rigd.config.rig import RigConfig
from rigd.engine.cycle.wiring import in_cycle
from rigd.model.channels import Stream
from rigd.sdk import BlockDriver, Driver

#: Most rows per second of a slow device.
SLOW_HZ: Final = 100.0
#: Additional rows of a ring, so that the ring of a slow stream also has room for a burst.
SPARE_ROWS: Final = 1000


def most_rows_hz(rig: RigConfig, stream: Stream) -> float:
    """Return the highest row rate of ``stream`` in Hz: one row per cycle, or its own rate."""
    device = rig.devices.get(stream.name)
    if device is None or issubclass(device.driver_class, Driver):
        return 1e9 / rig.period_ns
    is_block = issubclass(device.driver_class, BlockDriver)
    return device.declaration.rate_hz if is_block else SLOW_HZ


def ring_rows(rig: RigConfig, stream: Stream, ring_s: float, every: int = 1) -> int:
    """Return the number of rows of a ring for every ``every``-th row of ``stream``."""
    in_this_cycle = stream.name not in rig.devices or in_cycle(rig.devices[stream.name])
    rate_hz = most_rows_hz(rig, stream) / (every if in_this_cycle else 1)
    return round(ring_s * rate_hz) + SPARE_ROWS
