"""Reads one source of a test as rows of a stream, batch by batch, with what shows its trials."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, TypeVar

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from rigd.importing.map.map import RAW, ChannelMap, ImportMap, SourceMap, TimeMap
from rigd.importing.tables.formats import open_table
from rigd.importing.tables.table import (
    Batch,
    HasMoments,
    Kind,
    SourceTable,
    find_column,
    stated_unit,
    unit_of,
)
from rigd.importing.times.clock import FileClock
from rigd.importing.times.times import Times
from rigd.importing.trials import TrialFinder
from rigd.model.channels import Stream
from rigd.model.errors import ConfigError
from rigd.model.rows import TIME_FIELD, row_dtype
from rigd.model.units import Unit, parse_unit

T = TypeVar("T")
_NANO: Final = 1e-9


@dataclass(frozen=True, eq=False)
class UsedColumn:
    """A channel with the position of its column in the table, and its unit."""

    channel: ChannelMap
    index: int
    unit: Unit


@dataclass(eq=False)
class SourceReader:
    """One source of a test: its table, its stream, its times; ``finder`` if it shows trials."""

    source: SourceMap
    table: SourceTable
    stream: Stream
    columns: tuple[UsedColumn, ...]
    times: Times
    finder: TrialFinder | None = None
    rows: int = 0

    def batches(self) -> Iterator[NDArray[np.void]]:
        """Yield the rows of the stream in order; a batch may have none.

        Raises:
            ConfigError: the file has a mistake; names the place.
        """
        dtype = row_dtype(self.stream)
        read = self.table.batches(self._wanted())
        for timed in self.times.over(
            (batch, self._kept(batch) if self.source.sparse else None) for batch in read
        ):
            batch, kept, times = timed.batch, timed.kept, timed.times
            rows = np.empty(len(times), dtype)
            rows[TIME_FIELD] = times
            for column in self.columns:
                values = batch.numbers[column.index]
                _convert(rows, column, values if kept is None else values[kept])
            if self.finder is not None:
                self._show(self.finder, batch, rows, kept)
            self.rows += len(rows)
            yield rows

    def _wanted(self) -> dict[int, Kind]:
        wanted: dict[int, Kind] = {}
        if self.finder is not None:
            wanted |= dict.fromkeys(self.finder.wanted, "text")
        for index in (column.index for column in self.columns):
            self._want(wanted, index, "number")
        clock = self.times.clock
        if clock.column is not None:
            kind: Kind = "number"
            if clock.time.format is not None:
                kind = "text"
            elif clock.unit is not None and clock.unit.factor == _NANO:
                # A double does not hold a time in ns since 1970.
                kind = "whole" if self.table.is_whole(clock.column) else "number"
            self._want(wanted, clock.column, kind)
        return wanted

    def _want(self, wanted: dict[int, Kind], index: int, kind: Kind) -> None:
        if wanted.get(index, kind) != kind:
            raise ConfigError(
                f"the column {self.table.names[index]!r} is used as numbers and as text, or as a "
                "time and a channel",
                place=self.table.place(index),
                hint="a parameter or a key of trials cannot be a channel too",
            )
        wanted[index] = kind

    def _kept(self, batch: Batch) -> NDArray[np.intp]:
        """Return the rows in which a channel has a value."""
        missing = np.ones((len(self.columns), batch.rows), np.bool_)
        for at, column in enumerate(self.columns):
            missing[at] = np.isnan(batch.numbers[column.index])
        return np.flatnonzero(~missing.all(axis=0))

    def _show(
        self,
        finder: TrialFinder,
        batch: Batch,
        rows: NDArray[np.void],
        kept: NDArray[np.intp] | None,
    ) -> None:
        numbers = np.arange(batch.first, batch.first + batch.rows)
        texts = batch.texts
        if kept is not None:
            numbers = numbers[kept]
            texts = {at: array.take(pa.array(kept)) for at, array in texts.items()}
        signal = finder.trials.signal
        finder.feed(
            np.ascontiguousarray(rows[TIME_FIELD]),
            numbers,
            None if signal is None else np.ascontiguousarray(rows[signal.channel]),
            texts,
        )


def open_source(source: SourceMap, path: Path, base_ns: int, *, started: bool) -> SourceReader:
    """Return the reader of a source; ``base_ns`` is when the test began, if no time shows it.

    ``started``: the map states that, which counts more than what a file states.

    Raises:
        ConfigError: the file cannot be read, lacks a column, or states another unit.
    """
    text = source.text
    if source.sparse and "" not in text.missing:
        text = text.model_copy(update={"missing": [*text.missing, ""]})
    table = open_table(path, source.format, text, source.group)
    columns = []
    for channel in source.channels:
        index = find_column(table, channel.column, channel.place)
        unit = unit_of(table, index, channel.unit, channel.place)
        if problem := channel.contradiction(unit):
            raise ConfigError(f"the channel {channel.name}: {problem[1]}", place=channel.place)
        columns.append(UsedColumn(channel, index, unit))
    stream = Stream(
        source.name,
        tuple(item for column in columns for item in column.channel.channels(column.unit)),
        source="rigd import",
    )
    return SourceReader(
        source, table, stream, tuple(columns), _times(source.time, table, base_ns, started=started)
    )


def find_trials_in(what: ImportMap, reader: SourceReader) -> TrialFinder:
    """Return what finds the trials in the samples of ``reader``.

    Raises:
        ConfigError: a column that shows trials, steps or a parameter is not there.
    """
    trials, table = what.trials, reader.table
    if trials.signal is not None:
        units = {channel.name: channel.unit for channel in reader.stream.channels}
        trials.signal.check(units[trials.signal.channel])
    place = what.document.place(("trials", "columns"))
    columns = [find_column(table, name, place) for name in trials.columns]
    own = {} if trials.table is not None else what.parameters
    parameters = {
        name: find_column(table, item.column, what.document.place(("parameters", name, "column")))
        for name, item in own.items()
        if item.column is not None
    }
    steps = None
    if trials.steps is not None:
        steps = find_column(table, trials.steps, what.document.place(("trials", "steps")))
    return TrialFinder(table, trials, columns, parameters, steps)


def prefetched(items: Iterator[T]) -> Generator[T, None, None]:
    """Yield ``items``, of which the next one is made in another thread meanwhile."""
    with ThreadPoolExecutor(1) as pool:
        ahead = pool.submit(next, items, None)
        while (item := ahead.result()) is not None:
            ahead = pool.submit(next, items, None)
            yield item


def _times(time: TimeMap, table: SourceTable, base_ns: int, *, started: bool) -> Times:
    column, unit = None, time.unit
    if time.column is not None:
        column = find_column(table, time.column, time.place)
        if time.format is None:
            unit = unit_of(table, column, time.unit, time.place)
            if not unit.same_kind(parse_unit("s")):
                raise ConfigError(
                    f"the times are in {stated_unit(table, column)}, no unit of time",
                    place=table.place(column),
                )
    if table.start_ns is not None and not started:
        base_ns = table.start_ns
    if isinstance(table, HasMoments) and column is not None and table.is_moment(column):
        base_ns = 0
    if time.since_ns is not None:
        base_ns = time.since_ns
    if time.format is not None:
        base_ns = (time.since_ns or 0) if time.is_time_of_day else 0
    if time.wraps_bits is not None:
        range_ns = round(2**time.wraps_bits * 1e9 * (unit.factor if unit else 1.0))
        time = replace(time, wraps_ns=range_ns)
    return Times(FileClock(table, time, column, unit, base_ns))


def _convert(rows: NDArray[np.void], column: UsedColumn, values: NDArray[np.float64]) -> None:
    """Put a column in SI into ``rows``; a value that is in SI already keeps its bits."""
    unit, channel = column.unit, column.channel
    if not unit.is_si:
        values = values * unit.factor + unit.offset if unit.offset else values * unit.factor
    if channel.scale is None:
        rows[channel.name] = values
        return
    rows[f"{channel.name}{RAW}"] = values
    zero = 0.0 if channel.zero is None else channel.zero.value
    rows[channel.name] = (values - zero) * channel.scale.value


def text_cells(table: SourceTable, columns: Mapping[str, int]) -> Iterator[dict[str, str]]:
    """Yield the rows of a small table, the texts of ``columns`` by name.

    Raises:
        ConfigError: the file has a mistake.
    """
    wanted: dict[int, Kind] = dict.fromkeys(columns.values(), "text")
    for batch in table.batches(wanted):
        for row in range(batch.rows):
            yield {name: str(batch.texts[at][row]) for name, at in columns.items()}
