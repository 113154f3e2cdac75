"""Checks a row against the channels of its stream."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from rigd.sdk.driver import AnyDriver

#: Bit 31 of the status word is rigd's own.
STATUS_LIMIT = 1 << 31


def row_problems(driver: AnyDriver, row: object, *, in_range: bool = True) -> Iterator[str]:
    """Yield what is wrong with a row that ``driver`` gave.

    ``in_range`` also asks that every value be finite and within the range of its channel, as
    those of a healthy device are.
    """
    expected = len(driver.channels) + driver.has_status
    if not isinstance(row, Sequence) or len(row) != expected:
        yield f"a row is {row!r}, expected {expected} numbers"
        return
    for channel, value in zip(driver.channels, row, strict=False):
        if isinstance(value, bool) or not isinstance(value, float | int):
            yield f"{channel.name} is {value!r}, expected a float"
        elif in_range and not math.isfinite(value):
            yield f"{channel.name} is {value}, from a healthy device"
        elif in_range and not channel.low <= value <= channel.high:
            yield (
                f"{channel.name} is {value:g} {channel.unit}, beyond its range of "
                f"{channel.low:g} to {channel.high:g}"
            )
    if driver.has_status:
        status = row[-1]
        if type(status) is not int:
            yield f"the status word is {status!r}, expected an int"
        elif not 0 <= status < STATUS_LIMIT:
            yield f"the status word is {status:#x}; its bits are 0 to 30"
