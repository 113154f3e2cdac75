"""Defines channels (quantities with unit and range) and streams (channels sampled together)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Self

from rigd.model.units import parse_unit, si_symbol

#: Name of the integer field of a stream whose device reports a status word.
STATUS_FIELD: Final = "status"
#: Suffix of the channel that records a setpoint as it was written in the cycle.
ECHO: Final = "_setpoint"
#: Share of an end of a range within which a value is at it: it was converted from the raw one.
_NEAR: Final = 1e-9
#: Bit of the status word that belongs to rigd: the row repeats the values of an earlier cycle,
#: because the device returned no row for this cycle.
STALE: Final = 1 << 31


@dataclass(frozen=True)
class Channel:
    """A named quantity of a device, with the SI unit of its samples and setpoints.

    ``low`` and ``high`` are the range that the device can measure or accept. ``raw_of`` names the
    channel of which this channel is the unconverted reading (counts, volts). ``display`` is the
    unit in which people read it, such as ``degC``; by default that of its samples.
    """

    name: str
    unit: str = "1"
    doc: str = ""
    low: float = -math.inf
    high: float = math.inf
    raw_of: str | None = None
    display: str = ""

    def __post_init__(self) -> None:
        unit = parse_unit(self.unit)
        if not unit.is_si:
            raise ValueError(f"channel {self.name!r}: {self.unit} is not an SI unit")
        if self.display and not parse_unit(self.display).same_kind(unit):
            raise ValueError(f"channel {self.name!r} is in {self.unit}, not in {self.display}")

    @classmethod
    def read_in(
        cls, unit: str, name: str, doc: str = "", low: float = -math.inf, high: float = math.inf
    ) -> Self:
        """Return a channel that people read in any ``unit``; ``low`` and ``high`` are in SI."""
        parsed = parse_unit(unit)
        if parsed.is_si:
            return cls(name, unit, doc, low, high)
        return cls(name, si_symbol(parsed.dimension), doc, low, high, display=unit)

    @property
    def shown_in(self) -> str:
        """The unit in which people read and write its values."""
        return self.display or self.unit

    @property
    def is_share(self) -> bool:
        """Whether its range is that of a switch or a share, 0 to 1."""
        return (self.low, self.high) == (0.0, 1.0)

    @property
    def ends(self) -> tuple[float, float]:
        """The values from which on, down and up, a reading stands for all that lies beyond.

        Infinite where the range has no end. An end at 0, where many sensors rest, is none, nor are
        those of a range from 0 to 1, of a switch or a share.
        """
        if self.is_share:
            return -math.inf, math.inf
        low = self.low if self.low else -math.inf
        high = self.high if self.high else math.inf
        return low + _NEAR * abs(low), high - _NEAR * abs(high)


@dataclass(frozen=True)
class Stream:
    """The channels of a device that are sampled together: one row per sample, one topic per stream.

    A row is ``(t_ns, *values)`` with one float64 per channel, followed by an unsigned 32-bit status
    word if ``has_status``.
    """

    name: str
    channels: tuple[Channel, ...]
    doc: str = ""
    has_status: bool = False
    source: str = ""  #: driver of the samples, for the recording's metadata

    def index(self, channel: str) -> int:
        """Return the position of ``channel`` in a row's values.

        Raises:
            KeyError: the stream has no such channel.

        """
        for position, known in enumerate(self.channels):
            if known.name == channel:
                return position
        raise KeyError(channel)
