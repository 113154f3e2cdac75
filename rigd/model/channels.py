"""Channels and streams with unit and range."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from rigd.model.units import parse_unit

#: Name of the integer field a stream carries when its device reports a status word.
STATUS_FIELD: Final = "status"
#: Bit of the status word that is rigd's own: the row repeats the values of an earlier cycle, as
#: the device gave none for this one.
STALE: Final = 1 << 31


@dataclass(frozen=True)
class Channel:
    """One named quantity of a device, with the SI unit its samples and setpoints are given in.

    ``low`` and ``high`` are the range the device can measure or take; ``raw_of`` names the
    channel that this one is the unconverted reading of (counts, volts).
    """

    name: str
    unit: str = "1"
    doc: str = ""
    low: float = -math.inf
    high: float = math.inf
    raw_of: str | None = None

    def __post_init__(self) -> None:
        if parse_unit(self.unit).factor != 1.0:
            raise ValueError(f"channel {self.name!r}: {self.unit} is not an SI unit")


@dataclass(frozen=True)
class Stream:
    """The channels of one device sampled together: one row per sample, one topic per stream.

    A row is ``(t_ns, *values)`` with one float64 per channel, and an unsigned 32-bit status word
    behind them where ``has_status``.
    """

    name: str
    channels: tuple[Channel, ...]
    doc: str = ""
    has_status: bool = False
    source: str = ""  #: driver that the samples come from, for the recording's metadata

    def index(self, channel: str) -> int:
        """Return the position of ``channel`` in a row's values.

        Raises:
            KeyError: the stream has no such channel.

        """
        for position, known in enumerate(self.channels):
            if known.name == channel:
                return position
        raise KeyError(channel)
