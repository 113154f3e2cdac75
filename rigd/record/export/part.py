"""Provides the tables of a recording in batches, which every format writes one after the other."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Container, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rigd import __version__
from rigd.model import Stream
from rigd.record.mcap.prefix import Attachment
from rigd.record.mcap.schema import EVENTS_STREAM
from rigd.record.read.joined_table import JOINED_TABLE, TimeBase, joined_batches, joined_head
from rigd.record.read.reader import Recording
from rigd.record.read.tables import (
    STEP,
    STEPS_TABLE,
    TRIALS_TABLE,
    Column,
    Table,
    concatenated,
    events_table,
    rows_table,
    steps_table,
    with_measures,
)

#: Unit and values by number of trial, of each measure.
Measures = Mapping[str, tuple[str, Mapping[int, float]]]


@dataclass(frozen=True, eq=False)
class Part:
    """One table to export: ``head`` is the table without rows, ``batches`` gives the rows.

    ``time`` names its column of s since the recording began, ``trial`` that of the trial's number.
    """

    name: str
    head: Table
    batches: Callable[[], Iterator[Table]]
    time: str
    doc: str = ""
    source: str = ""  #: driver of the samples
    trial: str = "trial"

    def whole(self) -> Table:
        """Return all rows, in memory."""
        return concatenated([self.head, *self.batches()])


@dataclass(frozen=True)
class Origin:
    """What every exported file states of its recording; ``time_base`` in words, "" for none."""

    recording: str
    start_ns: int
    metadata: Mapping[str, Mapping[str, str]]
    attachments: Sequence[Attachment]
    step_names: tuple[str, ...]
    streams: tuple[Stream, ...]
    time_base: str

    def as_json(self) -> dict[str, str]:
        """Return the metadata by name, each as JSON."""
        return {name: json.dumps(values) for name, values in self.metadata.items()}


def origin(
    recording: Recording, base: TimeBase | None, trials: Collection[int] | None = None
) -> Origin:
    """Return what the exported files state; ``trials``: those that alone were exported."""
    own = {"recording": recording.path.name, "rigd": __version__, "values": "SI units"}
    if trials is not None:
        own["trials"] = ", ".join(map(str, sorted(trials)))
    if recording.problem:
        own["damage"] = recording.problem
    return Origin(
        recording.path.name,
        recording.start_ns,
        {**recording.metadata, "export": own},
        tuple(recording.attachments.values()),
        tuple(sorted({step.name for step in recording.steps} - {""})),
        tuple(recording.streams.values()),
        "" if base is None else str(base),
    )


def parts(
    recording: Recording,
    chosen: Sequence[str],
    base: TimeBase | None,
    measures: Measures,
    of_trials: Collection[int] | None = None,
) -> list[Part]:
    """Return the tables: of each stream, or one of all on a time base, of events, trials, steps.

    ``of_trials``: only the rows of these; None: all rows, those outside of trials too.

    Raises:
        RecordingError: no such stream, or a rate that fits nothing.

    """
    streams = [name for name in chosen if name != EVENTS_STREAM]
    for name in streams:
        recording.count(name)  # raises if there is no such stream
    found: list[Part] = []
    if base is None:
        found += [_stream(recording, name) for name in streams]
    elif streams:
        joined_batches(recording, streams, base)  # raises before anything is written
        found.append(
            Part(
                free_name(JOINED_TABLE, recording),
                joined_head(recording, streams),
                lambda: joined_batches(recording, streams, base),
                "time",
                doc=str(base),
            )
        )
    if EVENTS_STREAM in chosen:
        found.append(_held(events_table(recording.all_events, recording.start_ns), "time"))
    trials = with_measures(recording.trials.table, measures)
    steps = steps_table(recording.steps, recording.start_ns)
    for name, table in ((TRIALS_TABLE, trials), (STEPS_TABLE, steps)):
        found.append(_held(table, "start", free_name(name, recording)))
    if of_trials is not None:
        found = [_chosen(part, of_trials) for part in found]
    return found


def free_name(name: str, recording: Recording) -> str:
    """Return the name of a table, with ``rigd_`` in front if a stream has that name."""
    return unused(name, recording.streams)


def unused(name: str, taken: Container[str]) -> str:
    """Return a name of rigd's own, with ``rigd_`` in front as long as it is taken."""
    while name in taken:
        name = f"rigd_{name}"
    return name


def _stream(recording: Recording, name: str) -> Part:
    stream = recording.streams[name]
    attempts = [trial.info for trial in recording.trials]

    def batches() -> Iterator[Table]:
        for rows in recording.batches(name):
            yield rows_table(stream, rows, recording.start_ns, attempts, recording.steps)

    empty = recording.read(name, 0, 0)
    head = rows_table(stream, empty, recording.start_ns, (), ())
    time = "time" if head.units.get("rigd_time") is None else "rigd_time"
    trial = "rigd_trial" if "rigd_trial" in head.columns else "trial"
    return Part(name, head, batches, time, stream.doc, stream.source, trial)


def _chosen(part: Part, trials: Collection[int]) -> Part:
    """Return the part with the rows of ``trials`` alone."""

    def batches() -> Iterator[Table]:
        for table in part.batches():
            rows = np.isin(table[part.trial], list(trials))
            columns = {name: values[rows] for name, values in table.columns.items()}
            yield replace(table, columns=columns)

    return replace(part, batches=batches)


def _held(table: Table, time: str, name: str = "") -> Part:
    """Return a table that is in memory."""
    none = {column: values[:0] for column, values in table.columns.items()}
    head = Table(table.name, none, table.units, table.docs)
    trial = "number" if table.name == TRIALS_TABLE else "trial"
    return Part(name or table.name, head, lambda: iter((table,)), time, trial=trial)


def step_column(table: Table) -> str:
    """Return the column of the step's name; "" if the table has none."""
    for name in (f"rigd_{STEP}", STEP):
        if name in table.columns and table.columns[name].dtype == object:
            return name
    return ""


def step_numbers(names: Column, origin: Origin) -> NDArray[np.int32]:
    """Return the place of each name in the list of steps, from 1; 0 for none."""
    places = {name: place for place, name in enumerate(origin.step_names, 1)}
    texts, at = np.unique(names.astype(str), return_inverse=True)
    found = np.array([places.get(text, 0) for text in texts.tolist()], np.int32)
    return found[at] if len(found) else np.zeros(0, np.int32)
