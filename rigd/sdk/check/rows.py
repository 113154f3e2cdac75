"""Checks a row against the channels of its stream."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

from rigd.model.channels import Channel
from rigd.sdk.declaration import Declaration

#: Bit 31 of the status word is rigd's own.
STATUS_LIMIT = 1 << 31
#: A value may differ from what the device measures by this part of it: its noise, its resolution.
TRUE_PART = 0.02


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


def untrue(declared: Declaration, row: Sequence[float], measured: Mapping[str, float]) -> list[str]:
    """Return the problems of a row whose device measures ``measured``, by channel in its unit."""
    names = {channel.name for channel in declared.channels}
    unknown = [
        f"the peer measures {name!r}, which is no channel" for name in measured.keys() - names
    ]
    return unknown + [
        f"{channel.name} is {value:g} {channel.unit}, and the device measures "
        f"{measured[channel.name]:g} {channel.unit}"
        for channel, value in zip(declared.channels, row, strict=False)
        if channel.name in measured
        and not abs(value - measured[channel.name]) <= TRUE_PART * abs(measured[channel.name])
    ]
