"""Turns what the clock of a logger showed into ns since 1970: counters that wrap, dates, zones."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from rigd.importing.map.map import TimeMap
from rigd.importing.map.zones import Zone
from rigd.importing.tables.table import Batch, SourceTable
from rigd.model.errors import ConfigError, Place
from rigd.model.units import Unit

_LAST_S: Final = 9.2e9
#: Of a unit of time in ns: it is a whole number but for rounding.
_ROUNDING: Final = 1e-12
_TIME_OF_DAY: Final = re.compile(r"\d{1,2}:\d{2}")
_EPOCH: Final = datetime(1970, 1, 1)


@dataclass
class FileClock:
    """The clock of one table, read batch by batch; ``base_ns`` is when its time 0 was."""

    table: SourceTable
    time: TimeMap
    column: int | None
    unit: Unit | None
    base_ns: int
    wraps: int = 0  #: how often it has begun again at 0
    _local: _Local | None = None
    _last_ns: int | None = None  #: that was read, before anything is added
    _least_ns: int = 0
    _most_ns: int = 0

    def read(
        self, batch: Batch, kept: NDArray[np.intp] | None
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the times of a batch in ns since 1970 (n,), and their rows (n,).

        ``kept`` are the rows that count. Times may still run backward.

        Raises:
            ConfigError: a time is missing or is none.
        """
        rows = np.arange(batch.first, batch.first + batch.rows)
        since = self._since(batch, rows)
        if kept is not None:
            since, rows = since[kept], rows[kept]
        if not len(rows):
            return since, rows
        if self.time.zone is not None and self._local is None:
            self._local = _Local(self.time.zone, self)
        local = self.base_ns + self._unwrapped(since, rows)
        times = local if self._local is None else self._local.utc(local, rows)
        return times + self.time.shift_ns, rows

    def place(self, row: int) -> Place:
        """Return where the time of a row stands."""
        return self.time.place if self.column is None else self.table.place(self.column, row)

    def _unwrapped(self, since: NDArray[np.int64], rows: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the times of a counter that goes on where it begins again at 0."""
        span = self.time.wraps_ns
        if span is None:
            return since
        low, high = int(since.min()), int(since.max())
        if self._last_ns is not None:
            low, high = min(low, self._least_ns), max(high, self._most_ns)
        if high - low >= span:
            raise ConfigError(
                f"the times go from {low * 1e-9:.9g} s to {high * 1e-9:.9g} s, which is farther "
                f"than {span * 1e-9:.9g} s, the range of the counter",
                place=self.place(int(rows[int(np.argmax(since))])),
                hint="correct `wraps:` below `time:`, or remove it",
            )
        self._least_ns, self._most_ns = low, high
        before = since[0] if self._last_ns is None else self._last_ns
        self._last_ns = int(since[-1])
        added = np.full(len(since), self.wraps * span)
        for at in np.flatnonzero(np.diff(since, prepend=before) < 0):
            if self._local is not None and self._local.is_second_time(
                int(added[at] + self.base_ns)
                + np.array([since[at - 1] if at else before, since[at]])
            ):
                continue
            added[at:] += span
            self.wraps += 1
        unwrapped: NDArray[np.int64] = since + added
        return unwrapped

    def _since(self, batch: Batch, rows: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the times in ns since their zero."""
        if self.column is None:
            even: NDArray[np.float64] = np.rint(rows * (1e9 / (self.time.rate_hz or 1.0)))
            return even.astype(np.int64)
        if self.time.format is not None:
            return self._dates(batch.texts[self.column], batch.first)
        values = batch.numbers[self.column]
        factor = 1e9 * (1.0 if self.unit is None else self.unit.factor)
        if values.dtype == np.int64:
            exact: NDArray[np.int64] = values * round(factor)
            return exact
        if not np.all(np.isfinite(values)):
            row = batch.first + int(np.flatnonzero(~np.isfinite(values))[0])
            raise ConfigError("a time is missing", place=self.place(row))
        if self.time.origin_s:
            values = values - self.time.origin_s * 1e9 / factor
        if np.any(np.abs(values) * (factor * 1e-9) > _LAST_S):
            row = batch.first + int(np.argmax(np.abs(values)))
            raise ConfigError(
                f"the time {values[row - batch.first]:.6g} {self.unit} lies after the year 2260",
                place=self.place(row),
                hint="correct `unit:` below `time:`; days of MATLAB are `unit: d, since: "
                "0000-01-00`",
            )
        ns = round(factor)
        if abs(factor - ns) > _ROUNDING * factor:
            rounded: NDArray[np.float64] = np.rint(values * factor)
            return rounded.astype(np.int64)
        whole = np.floor(values)  # apart: a double has no ns of a time since 1970
        parts: NDArray[np.float64] = np.rint((values - whole) * factor)
        joined: NDArray[np.int64] = whole.astype(np.int64) * ns + parts.astype(np.int64)
        return joined

    def _dates(self, texts: Any, first: int) -> NDArray[np.int64]:
        """Return times that are written as dates, or as times of a day, since its beginning."""
        found = np.empty(len(texts), np.int64)
        form = self.time.format or ""
        for index, text in enumerate(texts.to_pylist()):
            try:
                plain = text.strip()
                moment = (datetime.fromisoformat(plain) if form == "iso"
                          else datetime.strptime(plain, form))  # fmt: skip
            except ValueError as error:
                hint = None
                if form == "iso" and _TIME_OF_DAY.match(plain):
                    hint = 'times of day are `format: "%H:%M:%S.%f"`, with the day in `since:`'
                raise ConfigError(
                    f"{text!r} is no time in the form {form!r}",
                    place=self.place(first + index), hint=hint,
                ) from error  # fmt: skip
            if moment.tzinfo is not None:
                if self.time.zone is not None:
                    raise ConfigError(
                        f"{text!r} states its zone, and the map gives {self.time.zone.name}",
                        place=self.place(first + index),
                        hint="remove `zone:` below `time:`",
                    )
                moment = moment.astimezone(UTC).replace(tzinfo=None)
            zero = moment.replace(hour=0, minute=0, second=0, microsecond=0)
            since = moment - (zero if self.time.is_time_of_day else _EPOCH)
            seconds = since.days * 86_400 + since.seconds
            found[index] = (seconds * 1_000_000 + since.microseconds) * 1000
        return found


@dataclass
class _Local:
    """Turns times of a clock on the wall into UTC, row after row.

    A time of the hour that occurs twice belongs to its first time until the clock goes back.
    """

    zone: Zone
    clock: FileClock
    _last_local: int | None = None
    _last_utc: int = 0
    _second: bool = False  #: whether the clock has gone back in the hour of the last row
    _usual_ns: float = field(default=0.0)

    def is_second_time(self, local: NDArray[np.int64]) -> bool:
        """Return whether a clock that goes back from one time to the other is put back an hour."""
        first, second = self.zone.offsets(local)
        return bool(np.all(first > second))

    def utc(self, local: NDArray[np.int64], rows: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the times in UTC.

        Raises:
            ConfigError: a time does not exist in the zone, or occurs twice and nothing shows which
                of them is meant.
        """
        first, second = self.zone.offsets(local)
        for at in np.flatnonzero(first < second)[:1]:
            raise ConfigError(
                f"{_wall(local[at])} does not exist in {self.zone.name}: clocks are put forward "
                "then",
                place=self.clock.place(int(rows[at])),
                hint="if the clock of the logger stays at one time all the year, give its offset, "
                f"such as `zone: '{_offset(first[at])}'`",
            )
        utc = local - first
        twice = first > second
        steps = np.diff(local)
        if not self._usual_ns and np.any(steps > 0):
            self._usual_ns = float(np.median(steps[steps > 0]))
        edges = np.flatnonzero(np.diff(twice.astype(np.int8), prepend=0, append=0))
        for begin, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
            self._place_hour(local, utc, first - second, begin, end, rows)
        if not twice[-1]:
            self._second = False
        self._last_local, self._last_utc = int(local[-1]), int(utc[-1])
        return utc

    def _place_hour(
        self, local: NDArray[np.int64], utc: NDArray[np.int64], hour: NDArray[np.int64],
        begin: int, end: int, rows: NDArray[np.int64],
    ) -> None:  # fmt: skip
        """Move rows of the second time, from ``begin`` to ``end`` of an hour that occurs twice."""
        last = int(local[begin - 1]) if begin else self._last_local
        joined = local[begin:end] if last is None else np.concatenate([[last], local[begin:end]])
        steps = np.diff(joined)
        usual = np.abs(steps + hour[begin] - self._usual_ns) < self._usual_ns / 2
        back = np.flatnonzero((steps < 0) & (usual | (steps < -hour[begin] / 2)))
        from_row = end if not len(back) else begin + int(back[0]) + (last is None)
        if begin == 0 and self._second:
            from_row = begin
        elif not len(back) and last is not None:
            # Rows that lie far apart step over the moment at which the clock goes back.
            step = int(utc[begin]) - (int(utc[begin - 1]) if begin else self._last_utc)
            if self._usual_ns and abs(step + hour[begin] - self._usual_ns) < abs(
                step - self._usual_ns
            ):
                from_row = begin
        elif not len(back):
            within = end == len(local)
            if within or utc[end] - utc[end - 1] - hour[begin] > 10 * self._usual_ns:
                early = int(local[begin] - utc[begin])
                raise ConfigError(
                    f"{_wall(local[begin])} occurs twice in {self.zone.name}, and nothing before "
                    "it shows which is meant",
                    place=self.clock.place(int(rows[begin])),
                    hint=f"`zone: '{_offset(early)}'` below `time:` if the clock had not been put "
                    f"back yet, `zone: '{_offset(early - int(hour[begin]))}'` if it had"
                    if within
                    else "delete the rows of this hour",
                )
            from_row = begin
        utc[from_row:end] += hour[from_row:end]
        self._second = from_row < end


def _wall(local_ns: int) -> str:
    return f"{np.datetime64(int(local_ns) // 1_000_000_000, 's')}".replace("T", " ")


def _offset(ahead_ns: int) -> str:
    minutes = abs(int(ahead_ns)) // 60_000_000_000
    return f"{'-' if ahead_ns < 0 else '+'}{minutes // 60:02d}:{minutes % 60:02d}"
