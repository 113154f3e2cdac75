"""Checks a row against the channels of its stream."""

from __future__ import annotations

import math
import random
from collections.abc import Iterator, Mapping, Sequence
from typing import Final

from rigd.model.channels import STATUS_FIELD, Channel
from rigd.sdk.check.peer import Peer
from rigd.sdk.declaration import Declaration

#: Bit 31 of the status word is rigd's own.
STATUS_LIMIT = 1 << 31
#: A channel without a range is given values up to this, in its unit.
LARGEST: Final = 100.0
#: A small change of what a device measures, as part of its range.
SMALL_STEP: Final = 0.04
#: A value may differ from what the device measures by this part of it: its noise, its resolution.
TRUE_PART = 0.02
#: And by this part of its range: frames and cards carry whole numbers.
RANGE_PART: Final = 1e-4
#: After so many values it is known whether their errors lie on a straight line: they are not less
#: than this part of the largest value, and what the line does not explain is this part of them.
LINE_OF: Final = 10
LINE_PART: Final = 3e-4
LINE_LEFT: Final = 0.02
#: After so many values the resolution of a device is known.
LEARNED: Final = 3
#: The part of a value that is lost in single precision.
ROUNDED: Final = 1e-6


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


def untrue(
    declared: Declaration,
    row: Sequence[float],
    looks: Sequence[Mapping[str, float]],
    rooms: Mapping[str, float] | None = None,
) -> Iterator[str]:
    """Yield the problems of a row whose device measured ``looks`` in turn, by channel in its unit.

    A value lies between the least and the greatest of them, or beyond by at most its room of
    ``rooms``, in its unit; by default that is a part of the value.
    """
    names = [channel.name for channel in declared.channels]
    units = [channel.unit for channel in declared.channels]
    if declared.has_status:
        names, units = [*names, STATUS_FIELD], [*units, ""]
    for name in looks[-1]:
        if name not in names:
            yield f"the peer measures {name!r}, which is no channel"
            continue
        index = names.index(name)
        values = [look[name] for look in looks if name in look]
        low, high = min(values), max(values)
        room = 0.0
        if units[index]:
            span = declared.channels[index].high - declared.channels[index].low
            steps = RANGE_PART * span if math.isfinite(span) else 0.0
            room = max(TRUE_PART * max(abs(low), abs(high)), steps)
        room = min(room, (rooms or {}).get(name, room))
        if not low - room <= row[index] <= high + room:
            measured = f"{low:g}" if low == high else f"{low:g} to {high:g}"
            yield f"{name} is {row[index]:g} {units[index]}, and the device measures {measured}"


def drawn_values(declared: Declaration, rng: random.Random) -> tuple[float, ...]:
    """Return a value for each channel, within its range."""
    values = []
    for channel in declared.channels:
        low, high = _ends(channel)
        values.append(low + (high - low) * rng.choice((0.02, 0.98, rng.random(), rng.random())))
    return tuple(values)


def _ends(channel: Channel) -> tuple[float, float]:
    """Return the range in which values of a channel are drawn."""
    low = channel.low if math.isfinite(channel.low) else min(channel.high, LARGEST) - LARGEST
    high = channel.high if math.isfinite(channel.high) else max(channel.low, 0.0) + LARGEST
    return low, high


def nearby(declared: Declaration, values: Sequence[float]) -> tuple[float, ...]:
    """Return values that differ from ``values`` by a small step towards the middle."""
    near = []
    for channel, value in zip(declared.channels, values, strict=True):
        low, high = _ends(channel)
        near.append(value + math.copysign(SMALL_STEP * (high - low), low + high - 2 * value))
    return tuple(near)


def measure(peer: Peer, declared: Declaration, values: Sequence[float]) -> None:
    """Have the device measure ``values``, as far as it can, by its channels."""
    names = [channel.name for channel in declared.channels]
    measured = peer.look().measured
    if peer.measure is not None:
        peer.measure({n: v for n, v in zip(names, values, strict=True) if n in measured})


class Truth:
    """Compares rows with what the device measured, the closer the more it knows of the device.

    A simulated device that is told what to measure shows it rounded to its digits: that is its
    resolution. And a value that is off by the same part and the same offset each time is off by a
    mistake of the driver, however little that is.
    """

    def __init__(self) -> None:
        #: What a value may differ by, by channel in its unit, of those of which that is known.
        self.rooms: dict[str, float] = {}
        self._off: dict[str, list[float]] = {}
        self._errors: dict[str, dict[float, float]] = {}  # by channel and measured value

    def measure(self, peer: Peer, declared: Declaration, values: Sequence[float]) -> None:
        """Have the device measure ``values``; see :func:`measure`."""
        measure(peer, declared, values)
        shown = peer.look().measured
        for channel, value in zip(declared.channels, values, strict=True):
            if channel.name in shown:
                off = self._off.setdefault(channel.name, [])
                off.append(abs(shown[channel.name] - value))
                if len(off) >= LEARNED and max(off) > 0.0:
                    self.rooms[channel.name] = 2 * max(off) + ROUNDED * abs(value)

    def problems(
        self, declared: Declaration, row: Sequence[float], looks: Sequence[Mapping[str, float]]
    ) -> Iterator[str]:
        """Yield the problems of a row whose device measured ``looks``; see :func:`untrue`."""
        yield from untrue(declared, row, looks, self.rooms)
        for channel, value in zip(declared.channels, row, strict=False):
            measured = {look.get(channel.name, math.nan) for look in looks}
            if len(measured) == 1 and not any(map(math.isnan, measured)):
                errors = self._errors.setdefault(channel.name, {})
                before = len(errors)
                errors[measured.pop()] = value - min(look[channel.name] for look in looks)
                if len(errors) > before and (problem := _same_error(errors)):
                    yield f"{channel.name} is off {problem}, in {channel.unit}"


def _same_error(errors: Mapping[float, float]) -> str:
    """Return the straight line on which the errors of a channel lie; "" if they lie on none."""
    count = len(errors)
    largest = max(map(abs, errors))
    size = math.sqrt(sum(error**2 for error in errors.values()) / count)
    if count < LINE_OF or size < LINE_PART * largest:
        return ""
    middle, offset = sum(errors) / count, sum(errors.values()) / count
    spread = sum((value - middle) ** 2 for value in errors)
    slope = sum((value - middle) * error for value, error in errors.items()) / spread
    left = sum((error - offset - slope * (value - middle)) ** 2 for value, error in errors.items())
    if math.sqrt(left / count) > LINE_LEFT * size:
        return ""
    return f"by {offset - slope * middle:.3g} and {100 * slope:.3g} % each time"
