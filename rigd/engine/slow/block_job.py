"""Defines the messages between the daemon and the helper process of a block device.

A block device is a device whose library returns blocks of rows.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rigd.config.rig import DeviceConfig
from rigd.model.channels import Stream

#: Longest message; a device's options are far shorter.
MAX_PACKET: Final = 1 << 17
#: Longest time to close the device when the helper must end; then the helper ends anyway.
GRACE_S: Final = 2.0


@dataclass(frozen=True)
class BlockJob:
    """The first message to the helper: the device, the place for its rows, the origin of its time.

    Rows have Unix times: ``start_ns`` at the monotonic time ``origin_ns``. The table has a slot for
    each of ``table_streams``. Every ``every``-th row is recorded in ``ring``, none if that is None;
    if ``windowed``, only rows taken during the windows in the table.
    """

    device: DeviceConfig
    ring: Path | None
    every: int
    table: Path
    table_streams: tuple[Stream, ...]
    start_ns: int
    origin_ns: int
    windowed: bool


@dataclass(frozen=True)
class Opened:
    """From the helper: the device samples; ``arming_blockers`` are the reasons not to arm it."""

    identity: str
    rate_hz: float
    arming_blockers: tuple[str, ...]


@dataclass(frozen=True)
class Failed:
    """From the helper, last: why it ends. ``kind`` is a class of :mod:`rigd.model.errors`."""

    kind: str
    message: str
    hint: str | None
