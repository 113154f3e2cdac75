"""Turns the times of a clock on the wall into UTC, over both changes of a year."""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta, timezone, tzinfo
from typing import Final
from zoneinfo import ZoneInfo

import numpy as np
from numpy.typing import NDArray

#: Since 1972 clocks have been changed at a full quarter of an hour, with one exception: Monrovia,
#: on 1972-01-07 (tz database, file `africa`).
_QUARTER_NS: Final = 900_000_000_000
_FIXED: Final = re.compile(r"([+-])(\d\d):(\d\d)")


@dataclass(frozen=True)
class Zone:
    """A zone of the tz database, or a fixed offset such as ``+02:00``.

    Raises:
        ValueError: there is no such zone.
    """

    name: str

    def __post_init__(self) -> None:
        _zone(self.name)

    def offsets(self, local_ns: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return what the clock on the wall is ahead of UTC, in ns: two arrays (n,).

        ``local_ns`` is what it shows, in ns since 1970. In an hour that occurs twice, the first
        array has the larger offset, that of the first time; in an hour that does not exist, the
        smaller one. Elsewhere both are the same.
        """
        zone = _zone(self.name)
        quarters, where = np.unique(local_ns // _QUARTER_NS, return_inverse=True)
        found = np.empty((2, len(quarters)), np.int64)
        for at, quarter in enumerate(quarters.tolist()):
            moment = datetime(1970, 1, 1) + timedelta(seconds=quarter * (_QUARTER_NS // 10**9))
            for fold in (0, 1):
                ahead = moment.replace(tzinfo=zone, fold=fold).utcoffset() or timedelta(0)
                found[fold, at] = round(ahead.total_seconds()) * 10**9
        return found[0][where], found[1][where]


def _zone(name: str) -> tzinfo:
    if name == "UTC":
        return UTC
    if (fixed := _FIXED.fullmatch(name)) is not None:
        ahead = timedelta(hours=int(fixed[2]), minutes=int(fixed[3]))
        return timezone(-ahead if fixed[1] == "-" else ahead)
    try:
        return ZoneInfo(name)
    except (OSError, ValueError, KeyError) as error:  # KeyError: not in the tz database
        raise ValueError(f"there is no zone {name!r} in the tz database of this machine") from error
