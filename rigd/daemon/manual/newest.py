"""Keeps the newest value of every channel of a rig, with its age and whether it is valid."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from rigd.config.rig import RigConfig
from rigd.engine.sink import Rows
from rigd.model.channels import STALE, STATUS_FIELD, Channel
from rigd.model.rows import TIME_FIELD


@dataclass(frozen=True)
class Reading:
    """One channel: ``value`` in SI ``unit``, NaN if there is none; ``age_s`` of its row.

    ``display`` is the unit in which people read it. ``status`` is the status word of its device,
    None if the device has none. ``state`` is ``ok``, ``stale``, ``NaN`` or ``no row``.
    """

    channel: str
    value: float
    unit: str
    age_s: float
    status: int | None
    state: str
    display: str = ""


class Newest:
    """Keeps the newest rows of ``rig``; the order of channels is that of the rig file.

    ``channels`` (``device.channel``) leaves out all others, if given.
    """

    def __init__(self, rig: RigConfig, channels: Sequence[str] = ()) -> None:
        self._shown: list[tuple[str, Channel]] = [
            (device.name, channel)
            for device in rig.devices.values()
            for channel in device.channels
            if not channels or f"{device.name}.{channel.name}" in channels
        ]
        self._silent_s = {name: device.declaration.silent_s for name, device in rig.devices.items()}
        self._rows: dict[str, np.void] = {}
        self._fresh_ns: dict[str, int] = {}

    def take(self, stream: str, rows: Rows) -> None:
        """Take rows of a stream, the newest last."""
        names = rows.dtype.names or ()
        self._rows[stream] = rows[-1]
        if STATUS_FIELD in names:
            rows = rows[rows[STATUS_FIELD] & STALE == 0]
        if len(rows):
            self._fresh_ns[stream] = int(rows[TIME_FIELD][-1])

    def readings(self, now_ns: int) -> Iterator[Reading]:
        """Yield the reading of every channel at ``now_ns`` (Unix)."""
        for device, channel in self._shown:
            row = self._rows.get(device)
            value = math.nan if row is None else float(row[channel.name])
            fresh_ns = self._fresh_ns.get(device)
            age_s = math.inf if fresh_ns is None else max(now_ns - fresh_ns, 0) * 1e-9
            status = None
            if row is not None and STATUS_FIELD in (row.dtype.names or ()):
                status = int(row[STATUS_FIELD]) & ~STALE
            yield Reading(
                f"{device}.{channel.name}",
                value,
                channel.unit,
                age_s,
                status,
                self._state(device, row, value, age_s),
                channel.shown_in,
            )

    def _state(self, device: str, row: np.void | None, value: float, age_s: float) -> str:
        if row is None:
            return "no row"
        if age_s > self._silent_s[device]:
            return "stale"
        return "NaN" if math.isnan(value) else "ok"
