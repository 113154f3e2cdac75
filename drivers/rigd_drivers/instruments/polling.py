"""Asks an instrument for one row each period, and gives it up once no row comes any more."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Awaitable, Callable
from enum import IntFlag
from typing import Final, NoReturn

from rigd.sdk import EmitRow
from rigd_drivers.instruments.lines.config import LineChannel

#: Time without a row after which the instrument is given up, in s, if it is not given: it has so
#: many chances to answer.
_LEAST_SILENCE_S: Final = 3.0
_CHANCES: Final = 3


class PolledStatus(IntFlag):
    """The status word of a row."""

    BEYOND = 1  #: a value is beyond the instrument's range, and NaN
    INCOMPLETE = 2  #: since the row before, an answer did not come or could not be read


def silence_of(period_s: float, timeout_s: float, questions: int) -> float:
    """Return after which time without a row an instrument is given up, in s, if it is not given."""
    return max(_LEAST_SILENCE_S, _CHANCES * (period_s + questions * timeout_s))


def in_range(value: float, item: LineChannel, name: str) -> bool:
    """Return whether ``value`` in SI is one that the channel can have; NaN is."""
    channel = item.channel(name)
    return math.isnan(value) or channel.low <= value <= channel.high


async def poll(
    take: Callable[[], Awaitable[tuple[float, ...] | None]],
    emit: EmitRow,
    *,
    period_s: float,
    silence_s: float,
    failure: Callable[[], Exception],
) -> NoReturn:
    """Emit a row each period, until cancelled.

    Args:
        take: returns values in SI and the status word; None if one is missing.
        emit: gets each row, with :attr:`PolledStatus.INCOMPLETE` if one before it was missing.
        period_s: from one row to the next.
        silence_s: without a row for so long it raises what ``failure`` returns.
        failure: returns why no row comes.
    """
    loop = asyncio.get_running_loop()
    heard_s = due = loop.time()
    skipped = False
    while True:
        row = await take()
        if row is None:
            skipped = True
            if loop.time() - heard_s >= silence_s:
                raise failure()
        else:
            *values, status = row
            emit((*values, int(status) | (PolledStatus.INCOMPLETE if skipped else 0)))
            heard_s, skipped = loop.time(), False
        due = max(due + period_s, loop.time())
        await asyncio.sleep(due - loop.time())
