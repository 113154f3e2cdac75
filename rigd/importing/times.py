"""Turns the times of a table into ns since 1970, and refuses times that run backward or jump."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from rigd.importing.map import TimeMap
from rigd.importing.table import Batch, SourceTable
from rigd.model.errors import ConfigError, Place
from rigd.model.units import Unit

#: A time between samples that is so many times the usual one is a jump.
JUMP_PERIODS: Final = 10
#: Where times begin again, they go on after this.
PAUSE_NS: Final = 1_000_000_000
#: So many jumps are remembered; the first that lies in a trial is reported.
_MOST_JUMPS: Final = 100_000
_LAST_S: Final = 9.2e9
#: Of a unit of time in ns: it is a whole number but for rounding.
_ROUNDING: Final = 1e-12


@dataclass(frozen=True)
class TimeJump:
    """Two samples that lie far apart: their times, and the row of the second one."""

    before_ns: int
    after_ns: int
    row: int


@dataclass
class Times:
    """The times of one table, batch by batch; ``base_ns`` is when its time 0 was.

    ``jumps`` are those that were found, ``first_ns`` and ``last_ns`` the times so far.
    """

    table: SourceTable
    time: TimeMap
    column: int | None
    unit: Unit | None
    base_ns: int
    jumps: list[TimeJump] = field(default_factory=list)
    first_ns: int = 0
    last_ns: int = 0
    _last_ns: int | None = None
    _moved_ns: int = 0  #: by times that began again
    _usual_ns: float = 0.0

    def of(self, batch: Batch, kept: NDArray[np.intp] | None = None) -> NDArray[np.int64]:
        """Return the times of a batch in ns since 1970 (n,); ``kept`` are the rows that count.

        Raises:
            ConfigError: a time is missing, runs backward, or is before 1970.
        """
        rows = np.arange(batch.first, batch.first + batch.rows)
        since = self._since(batch, rows)
        if kept is not None:
            since, rows = since[kept], rows[kept]
        times = since + (self.base_ns + self.time.shift_ns + self._moved_ns)
        if not len(times):
            return times
        joined = times if self._last_ns is None else np.concatenate([[self._last_ns], times])
        steps = np.diff(joined)
        skipped = len(times) - len(steps)  # 1 of the first batch, else 0
        for index in np.flatnonzero(steps <= 0) + skipped:
            before = int(times[index - 1]) if index else int(self._last_ns or 0)
            if not self.time.restarts:
                self._refuse(before, int(times[index]), int(rows[index]))
            moved = before + PAUSE_NS - int(times[index])
            if moved > 0:  # else a move before has put it right
                times[index:] += moved
                self._moved_ns += moved
        if times[0] < 0:
            raise ConfigError(
                f"{_shown(int(times[0]))} is before 1970, the first time that can be recorded",
                place=self._place(int(rows[0])),
                hint="give `since:` below `time:`: the moment that a time of 0 means",
            )
        self._note_jumps(times, rows)
        if self._last_ns is None:
            self.first_ns = int(times[0])
        self._last_ns = self.last_ns = int(times[-1])
        return times

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
            raise ConfigError("a time is missing", place=self._place(row))
        if np.any(np.abs(values) * (factor * 1e-9) > _LAST_S):
            row = batch.first + int(np.argmax(np.abs(values)))
            raise ConfigError(
                f"the time {values[row - batch.first]:.6g} {self.unit} lies after the year 2260",
                place=self._place(row),
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
        found = np.empty(len(texts), np.int64)
        for index, text in enumerate(texts.to_pylist()):
            try:
                if self.time.format == "iso":
                    moment = datetime.fromisoformat(text.strip())
                else:
                    moment = datetime.strptime(text.strip(), self.time.format or "")
            except ValueError as error:
                raise ConfigError(
                    f"{text!r} is no time in the form {self.time.format!r}",
                    place=self._place(first + index),
                ) from error
            aware = moment if moment.tzinfo else moment.replace(tzinfo=UTC)
            since = aware - datetime(1970, 1, 1, tzinfo=UTC)
            seconds = since.days * 86_400 + since.seconds
            found[index] = (seconds * 1_000_000 + since.microseconds) * 1000
        return found

    def _refuse(self, before: int, after: int, row: int) -> None:
        back = (before - after) * 1e-9
        what = f"runs backward by {back:.6g} s" if back > 0 else "is the same as in the row before"
        raise ConfigError(
            f"the time {what}",
            place=self._place(row),
            hint="if a new test begins there, add `restarts: true` below `time:`",
        )

    def _note_jumps(self, times: NDArray[np.int64], rows: NDArray[np.int64]) -> None:
        joined = times if self._last_ns is None else np.concatenate([[self._last_ns], times])
        steps = np.diff(joined)
        if not len(steps):
            return
        self._usual_ns = self._usual_ns or float(np.median(steps))
        limit = self.time.longest_gap_ns or JUMP_PERIODS * self._usual_ns
        skipped = len(times) - len(steps)
        for index in np.flatnonzero(steps > limit)[: _MOST_JUMPS - len(self.jumps)]:
            jump = TimeJump(int(joined[index]), int(joined[index + 1]), int(rows[index + skipped]))
            self.jumps.append(jump)

    def check_jumps(self, spans: Sequence[tuple[int, int]]) -> None:
        """Check that no jump lies within one of the trials, ``spans`` of first and last time.

        Raises:
            ConfigError: one does.
        """
        for jump in self.jumps:
            if any(first <= jump.before_ns and jump.after_ns <= last for first, last in spans):
                length = (jump.after_ns - jump.before_ns) * 1e-9
                raise ConfigError(
                    f"the time jumps by {length:.6g} s within a trial; usual are "
                    f"{self._usual_ns * 1e-9:.3g} s",
                    place=self._place(jump.row),
                    hint="if a trial ends there, add `gaps:` below `trials:`; if samples are "
                    "missing, state how long a gap may be: `longest_gap:` below `time:`",
                )

    def _place(self, row: int) -> Place:
        return self.time.place if self.column is None else self.table.place(self.column, row)


def _shown(t_ns: int) -> str:
    return f"a time of {t_ns * 1e-9:.6g} s"
