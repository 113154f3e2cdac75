"""Messages between the daemon and the helper process of a block device."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rigd.config.rig import DeviceConfig
from rigd.model.channels import Stream

#: Longest message; a device's options are far shorter.
MAX_PACKET: Final = 1 << 17
#: How long the device may take to be closed once the helper is to end; then it ends all the same.
GRACE_S: Final = 2.0


@dataclass(frozen=True)
class BlockJob:
    """To the helper, once: which device, where its rows go, and what time it is there.

    Rows are stamped with Unix time: ``start_ns`` at the monotonic time ``origin_ns``. The table
    has a slot for each of ``table_streams``. Every ``every``-th row is recorded in ``ring``, none
    where that is None; where ``windowed``, of those taken while the table says so.
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
    """From the helper: the device is open; ``unfit`` says what keeps it from being armed."""

    identity: str
    rate_hz: float
    unfit: tuple[str, ...]


@dataclass(frozen=True)
class Failed:
    """From the helper, last: why it ends. ``kind`` is a class of :mod:`rigd.model.errors`."""

    kind: str
    message: str
    hint: str | None
