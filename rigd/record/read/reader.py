"""Reads recordings into numpy: the rows of a stream chunk by chunk, by the index of the file."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from datetime import datetime
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal

import numpy as np
from numpy.typing import NDArray

from rigd.config.problems import suggest
from rigd.model import RecordingError, Stream
from rigd.model.rows import TIME_FIELD
from rigd.record.events.event import Event
from rigd.record.events.gaps import Gap, with_losses
from rigd.record.events.trials import Step, steps, trials
from rigd.record.mcap.contents import Contents
from rigd.record.mcap.prefix import (
    FORMAT_METADATA,
    START_KEY,
    Attachment,
)
from rigd.record.mcap.schema import EVENTS_STREAM
from rigd.record.mcap.wire import Malformed
from rigd.record.read.attachments import Attachments
from rigd.record.read.condition import LAST_NS, FileCondition, Foreign
from rigd.record.read.index import (
    by_rigd,
    damaged,
    gaps_in,
    indexed,
    metadata_in,
    mixes_channels,
    opened,
    walked,
)
from rigd.record.read.info import NO_RUN, RunInfo, StreamInfo, info_of, run_state
from rigd.record.read.messages.chunk_rows import Channels
from rigd.record.read.messages.topics import Topics, topics_in
from rigd.record.read.rows import Chunks
from rigd.record.read.tables import Table, stream_table
from rigd.record.read.trial import Trial, Trials
from rigd.record.scan.scan import Scan

if TYPE_CHECKING:
    from rigd.config.document import Document
    from rigd.config.source import DerivedSource
    from rigd.record.read.derived import DerivedStreams, Values

#: Under this name a run attaches its procedure.
PROCEDURE_FILE: Final = "procedure.yaml"
#: Rows that :meth:`Recording.batches` gives at a time: 13 MB with 12 channels.
BATCH_ROWS: Final = 131_072


@dataclass(frozen=True, repr=False)
class Recording:
    """The index of one recording. Keeps no open file; each read opens the file again.

    ``recording.trials`` are its trials, ``recording.trial(3)["carriage"]`` is a table of samples.

    Of a file that another program wrote, every byte is read when it is opened; its rows are given
    in order of time, each once, and ``foreign`` states what rigd would have written.
    """

    path: Path
    contents: Contents
    topics: Topics
    metadata: Mapping[str, Mapping[str, str]]
    size: int  #: bytes
    problem: str = ""  #: the first damage of the file, if it was opened as partial
    data_end: int = 0  #: bytes from its start that are sound
    gaps: tuple[Gap, ...] = ()  #: rows that are known to be lost
    foreign: Foreign | None = None  #: of a file of another program
    checked: bool = False  #: whether every byte was read
    added: DerivedStreams | None = None  #: what was computed of it after the fact

    @classmethod
    def open(cls, path: str | PathLike[str], *, partial: bool = False) -> Recording:
        """Read the index of a recording.

        ``partial``: check every byte and skip damaged parts, which :attr:`problem` and :attr:`gaps`
        describe. A file that is being written is not checked.

        Raises:
            RecordingError: missing, empty, cut short (unless partial), or not an MCAP file.
        """
        path = Path(path)
        with opened(path) as fd:
            try:
                found = walked(fd) if partial or not by_rigd(fd) else None
                if found is None:
                    contents, end = indexed(fd)
                    if not mixes_channels(contents) or (found := walked(fd)) is None:
                        return cls._indexed(fd, path, contents, end)
                if found.others and not partial and found.damages:
                    raise Malformed(found.problem)
                return cls.of(fd, path, found)
            except Malformed as error:
                raise damaged(path, error) from error

    @classmethod
    def _indexed(cls, fd: int, path: Path, contents: Contents, end: int) -> Recording:
        metadata = metadata_in(fd, contents)
        gaps, topics = gaps_in(metadata), topics_in(contents, {}, others=False)
        return cls(path, contents, topics, metadata, os.fstat(fd).st_size, "", end, gaps)

    @classmethod
    def of(cls, fd: int, path: Path, found: Scan) -> Recording:
        """Return the recording that a scan of an open file has found.

        Raises:
            Malformed: a channel of rigd states a stream that is none.
        """
        contents, metadata = found.contents, metadata_in(fd, found.contents)
        return cls(
            path,
            contents,
            topics_in(contents, found.firsts, others=found.others),
            metadata,
            os.fstat(fd).st_size,
            found.problem,
            found.data_end,
            found.gaps(),
            Foreign.of(found, metadata) if found.others else None,
            checked=True,
        )

    @property
    def streams(self) -> Mapping[str, Stream]:
        """The streams that rigd reads as columns, by name."""
        if self.added is not None:
            return {**self.added.recording.streams, **self.added.streams}
        return self.topics.streams

    @property
    def other_topics(self) -> tuple[str, ...]:
        """The topics that are none: also channels that differ from the first of their topic."""
        return tuple(topic.topic for topic in self.topics.others)

    @property
    def condition(self) -> FileCondition:
        """What the file is: whole, valid or damaged.

        A file of rigd is checked only if it is opened as partial.
        """
        if self.problem:
            return FileCondition.DAMAGED
        if self.foreign is not None:
            return FileCondition.VALID
        return FileCondition.WHOLE if self.checked else FileCondition.UNCHECKED

    def __repr__(self) -> str:
        """Return a description in one line."""
        span_s = (self.end_ns - self.start_ns) * 1e-9
        return f"<Recording {self.path}: {span_s:.1f} s of {', '.join(self.streams) or 'nothing'}>"

    @cached_property
    def info(self) -> RunInfo:
        """The summary of the run, as ``rigd info`` prints it.

        Raises:
            RecordingError: the events are damaged.
        """
        state, _ = run_state(self.all_events)
        return replace(
            info_of(
                self.path,
                self.metadata,
                self.all_events,
                [trial.info for trial in self.trials],
                self.start_ns,
                self.end_ns,
                self.size,
            ),
            problem=self.problem,
            streams=tuple(self._stream_info(name) for name in self.streams),
            attachments=tuple(index.name for index in self.contents.attachments),
            gaps=self.gaps,
            topics=tuple(self.topics.others),
            condition=self.condition,
            foreign=self.foreign,
            state=NO_RUN if self.foreign is not None and not self.all_events else state,
        )

    def _stream_info(self, name: str) -> StreamInfo:
        rows, span = self.count(name), self.span_ns(name)
        spread = span[1] - span[0] if span is not None else 0
        return StreamInfo(
            self.streams[name], rows, (rows - 1) / (spread * 1e-9) if spread > 0 else 0.0
        )

    @property
    def rig(self) -> str:
        """Name of the rig that was recorded; "" if the file does not state it."""
        return self.info.rig

    @property
    def procedure(self) -> str:
        """Name of the procedure that was run; "" if the file does not state it."""
        return self.info.procedure

    @property
    def started(self) -> datetime | None:
        """When the run began, by the clock of the run; None if the file does not state it.

        The clock of a run in virtual time begins at a date that its seed gives.
        """
        try:
            return datetime.fromisoformat(self.info.started)
        except ValueError:
            return None

    @property
    def parameters(self) -> Mapping[str, str]:
        """Values of the procedure's parameters that all trials share, as a person writes them."""
        return self.info.parameters

    @property
    def state(self) -> str:
        """How the run ended, such as "complete"; "interrupted" if the file has no end of it."""
        return self.info.state

    @property
    def reason(self) -> str:
        """Why the run ended so."""
        return self.info.reason

    @property
    def losses(self) -> tuple[str, ...]:
        """What is damaged or lost in the file, as sentences; empty if nothing is known to be."""
        return self.info.losses

    @property
    def complete(self) -> bool:
        """Whether the run ended as its procedure plans, and nothing is damaged or lost."""
        return self.state == "complete" and not self.losses

    @property
    def written_by_rigd(self) -> bool:
        """Whether rigd made the file, so that it may add to it."""
        return self.foreign is None and START_KEY in self.metadata.get(FORMAT_METADATA, {})

    @property
    def start_ns(self) -> int:
        """When the recording began; for a file of another program, its first message."""
        text = self.metadata.get(FORMAT_METADATA, {}).get(START_KEY, "")
        if not text.isdecimal() and self.foreign is not None:
            return min((first for first, _ in self.foreign.spans.values()), default=0)
        return int(text) if text.isdecimal() else self.contents.start_ns

    @property
    def end_ns(self) -> int:
        """Time of the last message, or the start if there is none."""
        if self.foreign is not None:
            ends = (last for _, last in self.foreign.spans.values())
            return max(ends, default=self.start_ns)
        return self.contents.end_ns if self.contents.messages else self.start_ns

    def count(self, stream: str) -> int:
        """Return the number of rows of a stream.

        Raises:
            RecordingError: no such stream.

        """
        if self.added is not None:
            return self.added.recording.count(self._timed_by(stream))
        channels = self._channels(stream)
        found = sum(self.contents.counts.get(channel, 0) for channel in channels)
        if self.foreign is None:
            return found
        topics = {self.contents.channels[channel].topic for channel in channels}
        found -= sum(self.foreign.late.get(channel, 0) for channel in channels)
        return found - sum(self.foreign.doubled.get(topic, 0) for topic in topics)

    def recorded(self, stream: str) -> int:
        """Return the number of rows that a stream was given, those that are lost included.

        Raises:
            RecordingError: no such stream.

        """
        of = self._timed_by(stream)
        lost = (gap.rows or 0 for gap in self.gaps if gap.stream == of)
        return self.count(stream) + sum(lost)

    def span_ns(self, stream: str) -> tuple[int, int] | None:
        """Return the times of a stream's first and last row; None if it has no rows.

        Raises:
            RecordingError: no such stream.

        """
        if self.added is not None:
            return self.added.recording.span_ns(self._timed_by(stream))
        channels = self._channels(stream)
        if self.foreign is not None:
            spans = [
                self.foreign.spans[number] for number in channels if number in self.foreign.spans
            ]
            return (min(spans)[0], max(last for _, last in spans)) if spans else None
        chunks = self._chunks.within(channels)
        if not chunks:
            return None
        first = min(chunk.message_start_time for chunk in chunks)
        return first, max(chunk.message_end_time for chunk in chunks)

    def read(
        self,
        stream: str,
        start_ns: int | None = None,
        end_ns: int | None = None,
        *,
        check_crc: bool = True,
    ) -> NDArray[np.void]:
        """Return the rows with ``start_ns <= t_ns < end_ns``, in the order of the file.

        Those of a file of another program are given in order of time, each once.

        The dtype is that of :func:`~rigd.model.rows.row_dtype`; cost about 0.1 µs per row of 12
        channels.

        Raises:
            RecordingError: no such stream, or a damaged chunk.

        """
        low, high = _between(start_ns, end_ns)
        if (rows := self._computed_rows(stream)) is not None:
            return rows[_within(rows, low, high)]
        self._channels(stream)  # raises if there is no such stream
        return self._chunks.read(stream, low, high, check_crc=check_crc)

    def batches(
        self,
        stream: str,
        start_ns: int | None = None,
        end_ns: int | None = None,
        *,
        rows: int = BATCH_ROWS,
    ) -> Iterator[NDArray[np.void]]:
        """Return what :meth:`read` does in parts of at least ``rows``, so in bounded memory.

        Raises:
            RecordingError: no such stream, or a damaged chunk.

        """
        low, high = _between(start_ns, end_ns)
        if (found := self._computed_rows(stream)) is not None:
            inside = found[_within(found, low, high)]
            return (inside[at : at + rows] for at in range(0, len(inside), rows))
        self._channels(stream)  # raises if there is no such stream
        return self._chunks.batches(stream, low, high, rows)

    def events(self) -> list[Event]:
        """Return all events in the order of the file; none if the file has no ``/events``.

        Those of a file of another program are given in order of time, each once.

        Raises:
            RecordingError: a damaged chunk or event.

        """
        return self._chunks.events()

    @cached_property
    def all_events(self) -> tuple[Event, ...]:
        """All events in the order of the file, read once.

        Raises:
            RecordingError: a damaged chunk or event.

        """
        return tuple(self.events())

    @cached_property
    def trials(self) -> Trials:
        """All attempts at trials, in the order they began.

        Raises:
            RecordingError: a damaged chunk or event.

        """
        return self.trials_for(None)

    def trials_for(self, streams: Collection[str] | None) -> Trials:
        """Return all attempts at trials, judged by the losses in ``streams`` and the events.

        None: in all streams.

        Raises:
            RecordingError: a damaged chunk or event.
        """
        if streams is not None and self.added is not None:
            return self.added.recording.trials_for(self.added.needed(streams)).of(self)
        judged = None if streams is None else {*streams, EVENTS_STREAM}
        gaps = [gap for gap in self.gaps if judged is None or gap.stream in judged]
        attempts = trials(self.all_events)
        return Trials(
            self, with_losses(attempts, gaps, self.all_events, asks=bool(gaps) and self._asks)
        )

    @cached_property
    def steps(self) -> tuple[Step, ...]:
        """All steps that were played, in order.

        Raises:
            RecordingError: a damaged chunk or event.

        """
        return steps(self.all_events)

    def trial(self, number: int) -> Trial:
        """Return the trial of that number: the last attempt that is complete, else the last.

        Raises:
            RecordingError: the recording has no trial of that number.

        """
        return self.trials.number(number)

    def __getitem__(self, stream: str) -> Table:
        """Return all samples of a stream, with the trial and step of each.

        Raises:
            RecordingError: no such stream, or a damaged chunk.

        """
        return stream_table(self, stream, [trial.info for trial in self.trials], self.steps)

    def with_derived(self, derived: Mapping[str, str | Mapping[str, str]]) -> Recording:
        """Return the recording with further channels, which are computed from its own.

        Args:
            derived: what stands below `derived` in a rig file, by the name of the channel: a
                formula, or a mapping of the keys `is`, `unit`, `where`, `lowpass` and so on.

        Raises:
            ConfigError: a channel is wrong, or exists already.
        """
        from rigd.record.read.derived import written  # it loads the language

        return self.with_channels(*written(derived))

    def with_channels(
        self,
        document: Document,
        sources: Mapping[str, DerivedSource],
        defaults: Values | None = None,
    ) -> Recording:
        """Return the recording with the derived channels ``sources`` of ``document``.

        ``defaults`` are the values of names that the recording lacks.

        Raises:
            ConfigError: a channel is wrong, or exists already; names every problem with its place.
        """
        from rigd.record.read.derived import derived_streams  # it loads the language

        added = derived_streams(self, document, sources, defaults)
        return self if added is None else replace(self, added=added)

    def compute(
        self,
        formula: str,
        *,
        unit: str | None = None,
        where: str | None = None,
        lowpass: str | None = None,
        reset: Literal["run", "trial"] = "run",
    ) -> Table:
        """Return a table with the column ``value``: ``formula`` at the times of its channels.

        Formula and arguments are those of derived channels. Values are in SI;
        ``table.units["value"]`` is their unit.

        Raises:
            ConfigError: the formula is wrong; with the place in it.
            RecordingError: a damaged chunk.
        """
        keys = {"is": formula, "unit": unit, "where": where, "lowpass": lowpass, "reset": reset}
        group = "computed"
        while group in self.streams:
            group += "_"
        given = {key: text for key, text in keys.items() if text is not None}
        return self.with_derived({f"{group}.value": given})[group]

    def _timed_by(self, stream: str) -> str:
        """Return the recorded stream with the times of a derived one, or the stream itself."""
        if self.added is None or stream not in self.added.streams:
            return stream
        return self.added.bases[stream]

    def _computed_rows(self, stream: str) -> NDArray[np.void] | None:
        """Return all rows of a derived stream that was added; None of another one."""
        if self.added is None:
            return None
        if stream in self.added.streams:
            return self.added.rows(stream)
        return self.added.recording._computed_rows(stream)  # noqa: SLF001 - of the same class

    @cached_property
    def attachments(self) -> Mapping[str, Attachment]:
        """The attached files by name; the last of a name counts.

        Each is read when it is asked for, and a RecordingError raised if it is damaged.
        """
        return Attachments(self.path, self.contents.attachments, self._chunks.damaged)

    @property
    def _asks(self) -> bool:
        """Whether the procedure asks for settings that change its quantities, if known."""
        if any(event.data.get("changes") for event in self.all_events if event.kind == "answer"):
            return True
        try:
            procedure = self.attachments.get(PROCEDURE_FILE)
        except RecordingError:
            return True
        return procedure is None or b"changes:" in procedure.data

    def _channels(self, stream: str) -> Channels:
        if stream not in self.topics.streams:
            raise RecordingError(
                f"{self.path} has no stream {stream!r}", hint=suggest(stream, self.streams)
            )
        return self.topics.channels[stream]

    @cached_property
    def _chunks(self) -> Chunks:
        others = self.foreign is not None
        return Chunks(self.path, self.size, self.contents, self.topics, others, self.checked)


def open_recording(path: str | PathLike[str], *, partial: bool = False) -> Recording:
    """Open a recording to read it: ``rigd.open``.

    Args:
        path: an MCAP file, of rigd or of another program.
        partial: open a damaged file too, as far as it is intact; ``recording.losses`` states what
            is missing. Every byte of the file is then checked.

    Raises:
        RecordingError: missing, empty, cut short (unless partial), or not an MCAP file.
    """
    return Recording.open(path, partial=partial)


def _within(rows: NDArray[np.void], low: int, high: int) -> slice:
    """Return which rows have ``low <= t_ns < high``."""
    times = rows[TIME_FIELD]
    return slice(int(np.searchsorted(times, low)), int(np.searchsorted(times, high)))


def _between(start_ns: int | None, end_ns: int | None) -> tuple[int, int]:
    return 0 if start_ns is None else start_ns, LAST_NS if end_ns is None else end_ns
