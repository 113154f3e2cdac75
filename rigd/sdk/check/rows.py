"""Checks a row against the channels of its stream, and the readings that its device has sent."""

from __future__ import annotations

import math
import random
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Final

from rigd.model.channels import STATUS_FIELD, Channel
from rigd.model.units import OFFSETS, parse_unit
from rigd.sdk.check.peer import Peer, SentReading
from rigd.sdk.check.watching import HeldTime
from rigd.sdk.declaration import Declaration

#: Bit 31 of the status word is rigd's own.
STATUS_LIMIT = 1 << 31
#: A channel without a range is given values up to this, in its unit.
LARGEST: Final = 100.0
#: Half of them are close to the zero of a unit: the smallest, as powers of ten of the range.
SMALLEST: Final = 5.0
#: Parts of a range close to its ends.
CLOSE: Final = (0.002, 0.02, 0.98, 0.998)
#: What a value may differ from that of its reading by: the part that single precision takes, and
#: some more.
ROUNDED: Final = 3e-7
LEAST: Final = 1e-12
#: The time of a row may be so far from that of its reading, in s: it is estimated from arrivals.
STAMP_S: Final = 0.05


def row_problems(declared: Declaration, row: object, *, in_range: bool = True) -> Iterator[str]:
    """Yield the problems of a row of a driver that declares ``declared``.

    ``in_range`` also requires that every value is finite and within the range of its channel, like
    those of a healthy device.
    """
    expected = len(declared.channels) + declared.has_status
    if declared.row is not None and type(row) is not declared.row:
        fields = ", ".join(declared.row.fields)
        yield f"a row is {row!r}, expected {declared.row.__name__}({fields})"
        return
    if not isinstance(row, Sequence) or len(row) != expected:
        yield f"a row is {row!r}, expected {expected} numbers"
        return
    for channel, value in zip(declared.channels, row, strict=False):
        if isinstance(value, bool) or not isinstance(value, float | int):
            yield f"{channel.name} is {value!r}, expected a float"
        elif in_range and not math.isfinite(value):
            yield f"{channel.name} is {value}, from a healthy device"
        elif in_range and not channel.low <= value <= channel.high:
            yield beyond_range(channel, value)
    if declared.has_status:
        status = row[-1]
        if type(status) is not int:
            yield f"the status word is {status!r}, expected an int"
        elif not 0 <= status < STATUS_LIMIT:
            yield f"the status word is {status:#x}; its bits are 0 to 30"


def beyond_range(channel: Channel, value: float) -> str:
    """Return the problem of a value that ``channel`` cannot have."""
    return (
        f"{channel.name} is {value:g} {channel.unit}, beyond its range of "
        f"{channel.low:g} to {channel.high:g}"
    )


def drawn_values(declared: Declaration, rng: random.Random) -> dict[str, float]:
    """Return a value for each channel, within its range, and each status bit: 0 or 1."""
    values: dict[str, float] = {}
    for channel in declared.channels:
        low = channel.low if math.isfinite(channel.low) else min(channel.high, LARGEST) - LARGEST
        high = channel.high if math.isfinite(channel.high) else max(channel.low, 0.0) + LARGEST
        if not (math.isfinite(channel.low) or math.isfinite(channel.high)):
            low, high = -LARGEST, LARGEST
        value = low + (high - low) * rng.choice((*CLOSE, rng.random(), rng.random()))
        unit = parse_unit(channel.unit)
        offsets = (at for name, (at, _) in OFFSETS.items() if parse_unit(name).same_kind(unit))
        zeros = [zero for zero in (0.0, *offsets) if low <= zero <= high]
        for zero in zeros[: rng.randrange(2)]:  # where a number has another sign, and fewer digits
            value = zero + (rng.choice((low, high)) - zero) * 10.0 ** -rng.uniform(0.0, SMALLEST)
        values[channel.name] = value
    return values | {name: float(rng.random() < 0.5) for name in declared.status_bits}


class Matching:
    """Compares rows with the readings that a device has sent: none invented, twice or old.

    A row may be older by the time for which threads of this process have waited for a processor
    since its reading, as that of the device may have: ``held``. ``clock`` returns the time of the
    readings, CLOCK_MONOTONIC, in s.
    """

    def __init__(
        self,
        peer: Peer,
        declared: Declaration,
        held: HeldTime,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._held = held
        self._clock = clock
        self._readings = peer.readings
        self._columns = {channel.name: index for index, channel in enumerate(declared.channels)}
        self._bits = declared.status_bits
        if declared.has_status:
            self._columns[STATUS_FIELD] = len(declared.channels)
        self._names = [*self._columns, *self._bits]
        self.marked = 0  # how many had been sent when rows were read last
        self.begin()

    def begin(self) -> None:
        """Forget what the device has sent until now."""
        self._next = self.marked = self.sent
        self._marks = False
        self.begin_run()

    def begin_run(self) -> None:
        """Note that a driver begins to read: what is old by now gives no row."""
        self._began_s = self._clock()

    def mark(self) -> None:
        """Note that rows which are compared next had come by now."""
        self._marks, self.marked = True, self.sent

    @property
    def sent(self) -> int:
        """How many readings the device has sent."""
        return len(self._readings or ())

    def newest_first(
        self, row: Sequence[float], age_s: float, stamp_s: float | None = None
    ) -> Iterator[str]:
        """Yield the problem of a row that has come: it is a reading of the last ``age_s``.

        It is one of those that were sent when :meth:`mark` was called last, or now. ``stamp_s`` is
        the time of CLOCK_MONOTONIC that the driver gives for it, if it gives one.
        """
        readings = self._readings
        if readings is None:
            return
        now_s, count = self._clock(), self.marked if self._marks else self.sent
        alike = [n for n in range(self._next, count) if not any(self._wrong(row, readings[n]))]
        if alike:
            self._next = alike[0] + 1
            taken_s = readings[alike[-1]].taken_s
            old_s = now_s - taken_s
            was_old = taken_s < self._began_s - age_s  # whatever this machine did since
            if stamp_s is None and (was_old or self._held.exceeds(old_s, age_s, taken_s)):
                yield f"a row shows what the device measured {old_s:.2g} s before"
            apart_s = min(abs(readings[n].taken_s - (stamp_s or math.nan)) for n in alike)
            if stamp_s is not None and self._held.exceeds(apart_s, STAMP_S, min(taken_s, stamp_s)):
                yield f"the time of a row is {apart_s:.2g} s from that of its reading"
        elif self._next == count:
            yield f"a row comes, and the device has sent no reading since the {count} before"
        else:
            yield from list(self._wrong(row, readings[count - 1]))[:1]

    @property
    def waiting(self) -> int:
        """How many of them no row has shown."""
        return self.sent - self._next

    def compare_next(self, rows: Sequence[Sequence[float]]) -> Iterator[tuple[float, str]]:
        """Compare each row with the next reading that the device has sent.

        Yield the time of the reading (CLOCK_MONOTONIC, in s) and the first problem of the row, or
        "".
        """
        readings = () if self._readings is None else self._readings
        for row in rows:
            reading = readings[self._next]
            self._next += 1
            yield reading.taken_s, next(self._wrong(row, reading), "")

    def _wrong(self, row: Sequence[float], reading: SentReading) -> Iterator[str]:
        """Yield where a row differs from a reading."""
        if not any(name in self._names for name in reading.values):
            yield f"the peer sends {', '.join(reading.values)}, none of which is a channel"
        for name, value in reading.values.items():
            if name in self._columns:
                shown = row[self._columns[name]]
            elif name in self._bits:
                shown = float(bool(int(row[-1]) & self._bits[name]))
            else:
                continue
            if abs(shown - value) > ROUNDED * abs(value) + LEAST:
                yield f"{name} is {shown:.7g}, and the device has sent {value:.7g}"
