"""Puts the times of a table in order, and refuses times that run backward, stand still or jump."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rigd.importing.map.map import TimeMap, TrialsMap
from rigd.importing.tables.table import Batch
from rigd.importing.times.clock import FileClock
from rigd.model.errors import ConfigError

#: A time between samples that is so many times the usual one is a jump.
JUMP_PERIODS: Final = 10
#: Where times begin again, they go on after this.
PAUSE_NS: Final = 1_000_000_000
#: So many jumps are remembered; the first that lies in a trial is reported.
_MOST_JUMPS: Final = 100_000
#: A stamp that is farther from the one before than so many usual ones comes after a gap.
_NEXT_TICKS: Final = 1.5
#: Ranges of counters that a hint proposes, in bits.
_COUNTERS: Final = (16, 24, 31, 32)
_HOUR_NS: Final = 3_600_000_000_000
Rows = NDArray[np.intp] | None


@dataclass(frozen=True)
class TimeJump:
    """Two samples that lie far apart: their times, and the row of the second one.

    ``moved``: the time of the second one was moved, because the times began again.
    """

    before_ns: int
    after_ns: int
    row: int
    moved: bool


@dataclass(frozen=True, eq=False)
class Timed:
    """A batch, the rows that count (None: all), and their times in ns since 1970."""

    batch: Batch
    kept: Rows
    times: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class _Stamps:
    """Times of a batch in order, of which some may be the same; ``moved`` are rows (n,) of bool."""

    batch: Batch
    kept: Rows
    times: NDArray[np.int64]
    rows: NDArray[np.int64]
    moved: NDArray[np.bool_]


@dataclass
class Times:
    """The times of one table, batch by batch.

    ``jumps`` are those that were found, ``first_ns`` and ``last_ns`` the times so far.
    """

    clock: FileClock
    jumps: list[TimeJump] = field(default_factory=list)
    first_ns: int = 0
    last_ns: int = 0
    _last_stamp: int | None = None
    _last_ns: int | None = None
    _moved_ns: int = 0  #: by times that began again
    _usual_ns: float = 0.0  #: between two times of the file, as it has them
    _restarts: int = 0
    _begun: tuple[int, int] | None = None  #: the time before the last restart, the row after it
    _last_read: int | None = None
    _stamps: int = 0

    @property
    def time(self) -> TimeMap:
        """What the map states of them."""
        return self.clock.time

    def over(self, batches: Iterable[tuple[Batch, Rows]]) -> Iterator[Timed]:
        """Yield each batch with its times; beside it are the rows that count.

        Raises:
            ConfigError: a time is missing, runs backward, stands still, or is before 1970.
        """
        ordered = (self._ordered(batch, kept) for batch, kept in batches)
        for item in self._spread(ordered) if self.time.coarse else ordered:
            self._note_jumps(item)
            if len(item.times):
                if self._last_ns is None:
                    self.first_ns = int(item.times[0])
                self._last_ns = self.last_ns = int(item.times[-1])
            yield Timed(item.batch, item.kept, item.times)

    def statement(self, rows: int) -> str:
        """Return what was done to the times that the file has, "" if nothing."""
        time = self.time
        found = []
        if time.coarse:
            found.append(
                f"{rows} rows at {self._stamps} different times, spread evenly between them"
            )
        if self.clock.wraps:
            what = "midnights" if time.is_time_of_day else "wraps of the counter"
            found.append(f"{what}: {self.clock.wraps}")
        if time.zone is not None:
            found.append(f"local times of {time.zone.name}")
        if self._restarts:
            pause = _seconds(self._pause_ns)
            found.append(f"times began again {self._restarts} times, and go on after {pause} each")
        return "; ".join(found)

    def _ordered(self, batch: Batch, kept: Rows) -> _Stamps:
        """Return the times of a batch in order; what runs backward is moved or refused."""
        times, rows = self.clock.read(batch, kept)
        moved = np.zeros(len(times), np.bool_)
        if not len(times):
            return _Stamps(batch, kept, times, rows, moved)
        times += self._moved_ns
        joined = times if self._last_stamp is None else np.concatenate([[self._last_stamp], times])
        steps = np.diff(joined)
        if not self._usual_ns and np.any(steps > 0):
            self._usual_ns = float(np.median(steps[steps > 0]))
        if self.time.restarts:
            self._check_restarts(times - self._moved_ns, rows)
        skipped = len(times) - len(steps)  # 1 of the first batch, else 0
        for index in np.flatnonzero(steps < 0 if self.time.coarse else steps <= 0) + skipped:
            before = int(times[index - 1]) if index else int(self._last_stamp or 0)
            back = before - int(times[index])
            if back == 0 or not self.time.restarts:
                self._refuse(back, int(rows[index]))
            if back > 0:  # else a move before has put it right
                times[index:] += back + self._pause_ns
                self._moved_ns += back + self._pause_ns
                self._restarts += 1
                moved[index] = True
        if times[0] < 0:
            self._refuse_early(int(times[0]), int(rows[0]))
        self._last_stamp = int(times[-1])
        return _Stamps(batch, kept, times, rows, moved)

    def _check_restarts(self, times: NDArray[np.int64], rows: NDArray[np.int64]) -> None:
        """Refuse times that begin again and then go on as if they had not: rows out of order."""
        joined = times if self._last_read is None else np.concatenate([[self._last_read], times])
        at = np.flatnonzero(np.diff(joined) < 0) + 1
        begun = [(0, *self._begun)] if self._begun else []
        late = len(times) - len(joined)
        begun += [(int(i), int(joined[i - 1]), int(rows[i + late])) for i in at]
        self._last_read = int(times[-1])
        if not begun:
            return
        self._begun = begun[-1][1:]
        ends = [item[0] for item in begun[1:]] + [len(joined)]
        for (first, before, row), end in zip(begun, ends, strict=True):
            test = joined[first:end]
            beyond = (test[:-1] < before) & (test[1:] > before)
            if np.any(np.diff(test)[beyond] > JUMP_PERIODS * self._usual_ns):
                raise ConfigError(
                    "the time runs backward there, and later goes on from where it was",
                    place=self.clock.place(row),
                    hint="this is no new test: delete the rows that are out of order",
                )

    def _spread(self, batches: Iterable[_Stamps]) -> Iterator[_Stamps]:
        """Yield the batches with the rows of each stamp spread evenly up to the next stamp.

        A batch waits until a later one has another stamp than its last.
        """
        spreading = _Spreading()
        waiting: list[_Stamps] = []
        for item in batches:
            if not len(item.times):
                waiting.append(item)
                continue
            last = next((held.times[-1] for held in reversed(waiting) if len(held.times)), None)
            if last is not None and item.times[-1] != last:
                yield from self._even(spreading, waiting, item)
                waiting = []
            waiting.append(item)
        yield from self._even(spreading, waiting, None)

    def _even(
        self, spreading: _Spreading, waiting: Sequence[_Stamps], after: _Stamps | None
    ) -> list[_Stamps]:
        found = spreading.spread(waiting, after)
        self._stamps, self._usual_ns = spreading.stamps, spreading.period_ns
        if not self._usual_ns and sum(len(item.times) for item in waiting) > 1:
            raise ConfigError(
                "all rows have the same time",
                place=self.clock.place(0),
                hint="give `rate:` in place of `column:` below `time:`: how many samples there are "
                "in a second, such as `rate: 1 kHz`",
            )
        return found

    def _refuse(self, back_ns: int, row: int) -> None:
        place = self.clock.place(row)
        if back_ns == 0:
            raise ConfigError(
                "the time is the same as in the row before",
                place=place,
                hint="if its clock is coarser than the rate of the logger, add `coarse: spread` "
                "below `time:`; if a row is there twice, delete it",
            )
        raise ConfigError(
            f"the time runs backward by {back_ns * 1e-9:.6g} s", place=place,
            hint=self._remedy(back_ns),
        )  # fmt: skip

    def _remedy(self, back_ns: int) -> str:
        """Return what fits times that go back by so much."""
        time, most = self.time, JUMP_PERIODS * self._usual_ns
        if time.format is not None and time.zone is None and 0 < _HOUR_NS - back_ns <= most:
            return (
                "if these are local times and summer time ends there, name their zone below "
                "`time:`, such as `zone: Europe/Berlin`"
            )
        unit_ns = 1e9 * (1.0 if self.clock.unit is None else self.clock.unit.factor)
        for bits in _COUNTERS if time.format is None and time.wraps_ns is None else ():
            if 0 < 2**bits * unit_ns - back_ns <= most:
                return (
                    f"if a counter of {bits} bits begins again at 0 there, add `wraps: {bits} bit` "
                    "below `time:`"
                )
        if time.format is None and time.wraps_ns is None and 0 < 24 * _HOUR_NS - back_ns <= most:
            return "if these are times of a day, add `wraps: 24 h` below `time:`"
        return (
            "if a new test begins there, add `restarts: true` below `time:`, and show below "
            f"`trials:` where trials end, such as by `gaps: {_seconds(self._pause_ns)}`"
        )

    def _refuse_early(self, t_ns: int, row: int) -> None:
        hint = "give `since:` below `time:`: the moment that a time of 0 means"
        if self.time.format is not None:
            hint = (
                "if the clock was wrong, `shift:` below `time:` corrects it, such as `shift: 1 d`"
            )
        raise ConfigError(
            f"a time of {t_ns * 1e-9:.6g} s is before 1970, the first time that can be recorded",
            place=self.clock.place(row),
            hint=hint,
        )

    @property
    def _pause_ns(self) -> int:
        """The time after which times that began again go on."""
        return max(PAUSE_NS, round(JUMP_PERIODS * self._usual_ns))

    @property
    def _limit_ns(self) -> float:
        """The longest time between two rows that is no jump."""
        if self.time.longest_gap_ns is not None:
            return self.time.longest_gap_ns
        most = JUMP_PERIODS * self._usual_ns
        # A counter that goes back a little seems to go on by nearly all of its range.
        return most if self.time.wraps_ns is None else min(most, self.time.wraps_ns / 2)

    def _note_jumps(self, item: _Stamps) -> None:
        times = item.times
        joined = times if self._last_ns is None else np.concatenate([[self._last_ns], times])
        steps = np.diff(joined)
        if not len(steps):
            return
        skipped = len(times) - len(steps)
        far = (steps > self._limit_ns) | item.moved[skipped:]
        for index in np.flatnonzero(far)[: _MOST_JUMPS - len(self.jumps)]:
            at = index + skipped
            self.jumps.append(
                TimeJump(
                    int(joined[index]), int(joined[index + 1]), int(item.rows[at]),
                    bool(item.moved[at]),
                )
            )  # fmt: skip

    def check_jumps(self, spans: Sequence[tuple[int, int]], trials: TrialsMap) -> None:
        """Check that no jump lies within one of the trials, ``spans`` of first and last time.

        Raises:
            ConfigError: one does.
        """
        for jump in self.jumps:
            if any(first <= jump.before_ns and jump.after_ns <= last for first, last in spans):
                length = (jump.after_ns - jump.before_ns) * 1e-9
                what = (
                    "begins again" if jump.moved
                    else f"jumps by {length:.6g} s"
                )  # fmt: skip
                raise ConfigError(
                    f"the time {what} within a trial; usual are {self._usual_ns * 1e-9:.3g} s",
                    place=self.clock.place(jump.row),
                    hint=self._gap_remedy(length, trials, moved=jump.moved),
                )

    def _gap_remedy(self, length_s: float, trials: TrialsMap, *, moved: bool) -> str:
        by_gaps = trials.is_whole_file or trials.gap_ns is not None
        shortest = _seconds(self._pause_ns if moved else self._limit_ns)
        hint = (
            f"if a trial ends there, add `gaps: {shortest}` below `trials:`"
            if by_gaps
            else "if a trial ends there, add a column that changes there to `columns:` below "
            "`trials:`"
        )
        if moved:
            return hint
        return (
            f"{hint}; if samples are missing, state how long a gap may be: `longest_gap: "
            f"{_seconds(length_s * 1.1e9)}` below `time:`"
        )


def _seconds(ns: float) -> str:
    """Return a time in s, with two digits, that is not longer."""
    rounded = float(f"{ns * 1e-9:.2g}")
    return f"{rounded if rounded <= ns * 1e-9 else float(f'{ns * 0.95e-9:.2g}'):.9g} s"


class _Spreading:
    """Spreads the rows that have the same stamp.

    Rows of a stamp lie evenly between it and the next one. Before a gap, those of the last stamp
    have the usual period, and so have those of the first and of the last stamp of a file, of which
    some may be missing.
    """

    def __init__(self) -> None:
        self.stamps = 0
        self.period_ns = 0.0
        self._tick_ns = 0.0
        self._before = (0, 0)  #: a stamp, and how many of its rows lie in earlier batches

    def spread(self, items: Sequence[_Stamps], after: _Stamps | None) -> list[_Stamps]:
        """Return ``items`` with their times; ``after`` comes next and has another last stamp."""
        count = sum(len(item.times) for item in items)
        parts = [item.times for item in items] + ([] if after is None else [after.times])
        if not count:
            return list(items)
        stamps = np.concatenate(parts)
        times = self._times(stamps)
        kept = stamps[:count]
        same = int(np.count_nonzero(kept == kept[-1]))
        earlier = self._before[1] if kept[0] == kept[-1] == self._before[0] else 0
        self.stamps += len(np.unique(kept)) - int(kept[0] == self._before[0] and self.stamps > 0)
        self._before = (int(kept[-1]), same + earlier)
        ends = np.cumsum([len(item.times) for item in items])
        return [
            _Stamps(
                item.batch, item.kept, times[end - len(item.times) : end], item.rows, item.moved
            )
            for item, end in zip(items, ends.tolist(), strict=True)
        ]

    def _times(self, stamps: NDArray[np.int64]) -> NDArray[np.int64]:
        starts = np.flatnonzero(np.diff(stamps, prepend=stamps[0] - 1))
        counts = np.diff(starts, append=len(stamps))
        ticks = stamps[starts]
        is_first = self.stamps == 0
        known = self._before[1] if not is_first and ticks[0] == self._before[0] else 0
        counts[0] += known
        steps = np.diff(ticks)
        if is_first and len(steps):
            self._tick_ns = float(np.median(steps))
            usual = steps <= _NEXT_TICKS * self._tick_ns
            usual[0] = not np.any(usual[1:])  # the first stamp may lack rows
            self.period_ns = float(np.sum(steps[usual]) / np.sum(counts[:-1][usual]))
        lengths = np.append(steps, 0).astype(np.float64)
        by_period = counts * self.period_ns
        gap = steps > _NEXT_TICKS * self._tick_ns
        lengths[:-1][gap] = np.minimum(steps, by_period[:-1])[gap]
        lengths[-1] = by_period[-1]
        begins = ticks.copy()
        if is_first and len(steps) and not gap[0]:
            lengths[0] = min(float(steps[0]), by_period[0])
            begins[0] += steps[0] - round(lengths[0])
        group = np.repeat(np.arange(len(ticks)), np.diff(starts, append=len(stamps)))
        position = np.arange(len(stamps)) - starts[group]
        position[group == 0] += known
        late: NDArray[np.float64] = np.rint(position * (lengths / counts)[group])
        return begins[group] + late.astype(np.int64)
