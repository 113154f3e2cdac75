"""Reads recordings into numpy: first the index, then the rows of a stream chunk by chunk."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from functools import cached_property
from os import PathLike
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Final

import numpy as np
from mcap import records as mcap
from mcap.opcode import Opcode
from mcap.records import ChunkIndex
from numpy.typing import NDArray

from rigd.model import RecordingError, Stream
from rigd.model.rows import row_dtype
from rigd.model.system import read_at
from rigd.record.access import how_to_recover, require_regular, share
from rigd.record.chunks import ChunkHead, blob_dtype, parse_chunk, unpack_chunk
from rigd.record.contents import Contents, parse_footer, parse_summary, rows_of
from rigd.record.crc import crc32
from rigd.record.decode import Channels, KeptMessages, Messages
from rigd.record.events import Event, parse_event
from rigd.record.file import RecordingInUse
from rigd.record.gaps import Gap, gaps_from_json, with_losses
from rigd.record.prefix import (
    FORMAT_METADATA,
    GAPS_KEY,
    RECOVERY_METADATA,
    START_KEY,
    Attachment,
)
from rigd.record.scan import Scan, scan
from rigd.record.schema import (
    EVENTS_STREAM,
    EVENTS_TOPIC,
    STREAM_KEY,
    TRIAL_TOPIC,
    stream_from_json,
    stream_from_schema,
)
from rigd.record.tables import Table, stream_table
from rigd.record.trial import Trial, Trials
from rigd.record.trials import Step, steps, trials
from rigd.record.wire import FOOTER, MAGIC, Malformed, Record, decode, map_file, record_at

if TYPE_CHECKING:
    from rigd.record.info import RunInfo

#: Under this name a run attaches its procedure.
PROCEDURE_FILE: Final = "procedure.yaml"
_LAST_NS: Final = 2**63 - 1
#: Rows that :meth:`Recording.batches` gives at a time: 13 MB with 12 channels.
BATCH_ROWS: Final = 131_072


@dataclass(frozen=True, repr=False)
class Recording:
    """The index of one recording. Keeps no open file; each read opens the file again.

    ``recording.trials`` are its trials, ``recording.trial(3)["carriage"]`` is a table of samples.

    ``streams`` are those that rigd can read as columns, by name; :attr:`other_topics` has the rest
    of a file of another program: also channels that differ from the first of their topic.
    """

    path: Path
    contents: Contents
    streams: Mapping[str, Stream]
    other_topics: tuple[str, ...]
    metadata: Mapping[str, Mapping[str, str]]
    size: int  #: bytes
    problem: str = ""  #: the first damage of the file, if it was opened as partial
    data_end: int = 0  #: bytes from its start that are sound
    gaps: tuple[Gap, ...] = ()  #: rows that are known to be lost

    @classmethod
    def open(cls, path: str | PathLike[str], *, partial: bool = False) -> Recording:
        """Read the index of a recording.

        ``partial``: check every byte and skip damaged parts, which :attr:`problem` and :attr:`gaps`
        describe. A file that is being written is not checked.

        Raises:
            RecordingError: missing, empty, cut short (unless partial), or not an MCAP file.
        """
        path = Path(path)
        with _opened(path) as fd:
            try:
                found = _walked(fd) if partial else None
                if found is not None:
                    contents, problem, end = found.contents, found.problem, found.data_end
                else:
                    (contents, end), problem = _indexed(fd), ""
                metadata = _metadata(fd, contents)
                streams, others = _streams(contents)
                gaps = found.gaps() if found is not None else _gaps(metadata)
            except Malformed as error:
                raise damaged(path, error) from error
            size = os.fstat(fd).st_size
        return cls(path, contents, streams, others, metadata, size, problem, end, gaps)

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
        from rigd.record.info import run_info  # it reads recordings

        return run_info(self)

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
        return START_KEY in self.metadata.get(FORMAT_METADATA, {})

    @property
    def start_ns(self) -> int:
        """When the recording began; for a file of another program, its first message."""
        text = self.metadata.get(FORMAT_METADATA, {}).get(START_KEY, "")
        return int(text) if text.isdecimal() else self.contents.start_ns

    @property
    def end_ns(self) -> int:
        """Time of the last message, or the start if there is none."""
        return self.contents.end_ns if self.contents.messages else self.start_ns

    def count(self, stream: str) -> int:
        """Return the number of rows of a stream.

        Raises:
            RecordingError: no such stream.

        """
        return sum(self.contents.counts.get(channel, 0) for channel in self._channels(stream))

    def recorded(self, stream: str) -> int:
        """Return the number of rows that a stream was given, those that are lost included.

        Raises:
            RecordingError: no such stream.

        """
        lost = (gap.rows or 0 for gap in self.gaps if gap.stream == stream)
        return self.count(stream) + sum(lost)

    def span_ns(self, stream: str) -> tuple[int, int] | None:
        """Return the times of a stream's first and last row; None if it has no rows.

        Raises:
            RecordingError: no such stream.

        """
        chunks = self._chunks(self._channels(stream), 0, _LAST_NS)
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

        The dtype is that of :func:`~rigd.model.rows.row_dtype`; cost about 0.1 µs per row of 12
        channels.

        Raises:
            RecordingError: no such stream, or a damaged chunk.

        """
        blob = self._blob(stream)
        low, high = _between(start_ns, end_ns)
        # Filled piece by piece: joining them at the end would need twice the memory. Every row
        # has 16 bytes of index in the file, which bounds the rows that a damaged index can state.
        chunks = self._chunks(self._channels(stream), low, high)
        most = min(sum(map(rows_of, chunks)), self.size // 16)
        joined, end = np.empty(most, blob), 0
        for rows in self._pieces(stream, low, high, check_crc=check_crc):
            if end + len(rows) > most:
                raise self._damaged("a chunk has more messages than its index")
            joined[end : end + len(rows)] = rows
            end += len(rows)
        return joined[:end].view(row_dtype(self.streams[stream]))

    def batches(
        self,
        stream: str,
        start_ns: int | None = None,
        end_ns: int | None = None,
        *,
        rows: int = BATCH_ROWS,
    ) -> Iterator[NDArray[np.void]]:
        """Yield what :meth:`read` returns in parts of at least ``rows``, so in bounded memory.

        Raises:
            RecordingError: no such stream, or a damaged chunk.

        """
        waiting: list[NDArray[np.void]] = []
        blob = self._blob(stream)
        dtype = row_dtype(self.streams[stream])
        for piece in self._pieces(stream, *_between(start_ns, end_ns), check_crc=True):
            waiting.append(piece)
            if sum(map(len, waiting)) >= rows:
                yield np.concatenate(waiting, dtype=blob).view(dtype)
                waiting = []
        if waiting:
            yield np.concatenate(waiting, dtype=blob).view(dtype)

    def _pieces(
        self, stream: str, low: int, high: int, *, check_crc: bool
    ) -> Iterator[NDArray[np.void]]:
        """Yield the rows of each chunk with ``low <= t_ns < high``, as times and blobs."""
        channels, blob = self._channels(stream), self._blob(stream)
        with _opened(self.path) as fd:
            for index in self._chunks(channels, low, high):
                messages = self._unpack(fd, index, check_crc=check_crc)
                try:
                    rows = messages.rows(channels, blob)
                except Malformed as error:
                    raise self._damaged(error) from error
                if index.message_start_time < low or index.message_end_time >= high:
                    times = rows["t_ns"].astype(np.int64)
                    rows = rows[(times >= low) & (times < high)]
                yield rows

    def _blob(self, stream: str) -> np.dtype[np.void]:
        self._channels(stream)  # raises if there is no such stream
        return blob_dtype(self.streams[stream])

    def events(self) -> list[Event]:
        """Return all events in the order of the file; none if the file has no ``/events``.

        Raises:
            RecordingError: a damaged chunk or event.

        """
        channels = self._numbers.get(EVENTS_TOPIC)
        events: list[Event] = []
        if channels is None:
            return events
        with _opened(self.path) as fd:
            for index in self._chunks(channels, 0, _LAST_NS):
                messages = self._unpack(fd, index, check_crc=True)
                try:
                    found = messages.payloads(channels)
                    events += [parse_event(t_ns, payload) for t_ns, payload in found]
                except Malformed as error:
                    raise self._damaged(error) from error
        return events

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

    @cached_property
    def attachments(self) -> Mapping[str, Attachment]:
        """The attached files by name; the last of a name counts.

        Raises:
            RecordingError: an attachment is damaged.

        """
        found: dict[str, Attachment] = {}
        with _opened(self.path) as fd:
            for index in self.contents.attachments:
                try:
                    record = _record(fd, index.offset, index.length, Opcode.ATTACHMENT)
                    content = decode(mcap.Attachment, record.content)
                except Malformed as error:
                    raise self._damaged(error) from error
                crc = int.from_bytes(record.content[-4:], "little")
                if crc and crc32(record.content[:-4]) != crc:
                    raise self._damaged(f"the CRC of attachment {index.name!r} differs")
                found[index.name] = Attachment(content.name, content.media_type, content.data)
        return found

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

    @cached_property
    def _numbers(self) -> Mapping[str, Channels]:
        return _numbers(self.contents)

    def _channels(self, stream: str) -> Channels:
        if stream not in self.streams:
            raise RecordingError(
                f"{self.path} has no stream {stream!r}", hint=f"It has {sorted(self.streams)}."
            )
        return self._numbers[f"/{stream}"]

    def _chunks(self, channels: Channels, low: int, high: int) -> list[ChunkIndex]:
        return [
            chunk
            for chunk in self.contents.chunks
            if not chunk.message_index_offsets.keys().isdisjoint(channels)
            and chunk.message_end_time >= low
            and chunk.message_start_time < high
        ]

    @cached_property
    def _kept(self) -> KeptMessages:
        return KeptMessages()

    def _unpack(self, fd: int, index: ChunkIndex, *, check_crc: bool) -> Messages:
        try:
            record = _record(fd, index.chunk_start_offset, index.chunk_length, Opcode.CHUNK)
            head = parse_chunk(record.content)
            _require_same(head, index)
            key = index.chunk_start_offset, head.size, head.crc or crc32(head.packed)
            if (kept := self._kept.get(key)) is not None:
                return kept
            messages = Messages.of(unpack_chunk(head, check_crc=check_crc))
        except Malformed as error:
            raise self._damaged(error) from error
        if check_crc and messages.places is not None:
            self._kept.keep(key, messages)
        return messages

    def _damaged(self, problem: object) -> RecordingError:
        """Return the error for what cannot be read; this index is void if the file has changed."""
        error = damaged(self.path, problem)
        if isinstance(error, RecordingInUse) or self.path.stat().st_size == self.size:
            return error
        return RecordingError(
            f"{self.path} has been written to since it was opened", hint="Open it again."
        )


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


def _between(start_ns: int | None, end_ns: int | None) -> tuple[int, int]:
    return 0 if start_ns is None else start_ns, _LAST_NS if end_ns is None else end_ns


def damaged(path: Path, problem: object) -> RecordingError:
    """Return the error for a file that cannot be read; a writer may be changing it."""
    if is_written(path):
        return RecordingInUse(f"{path} is being written", hint="Wait until its run has ended.")
    message = f"{path} cannot be read: {problem}"
    if not _may_be_mcap(path):
        hint = "It is no MCAP recording; `rigd run` makes those, with names that end in .mcap."
        return RecordingError(message, hint=hint)
    return RecordingError(
        message,
        hint=f"`rigd verify {quote(str(path))}` lists the damage. {how_to_recover(path)}",
    )


def is_written(path: Path) -> bool:
    """Return whether a writer has the file open."""
    with path.open("rb", buffering=0) as file:
        return not share(file.fileno())


def _may_be_mcap(path: Path) -> bool:
    """Return whether a file that cannot be read is named, begins or ends like a recording."""
    with path.open("rb") as file:
        begin = file.read(len(MAGIC))
        file.seek(-min(len(MAGIC), os.fstat(file.fileno()).st_size), os.SEEK_END)
        return path.suffix == ".mcap" or MAGIC in (begin, file.read())


@contextmanager
def _opened(path: Path) -> Iterator[int]:
    """Open a file that is not empty, for positioned reads.

    It is not mapped: if its writer cut a mapped file shorter, the system would kill the reader.

    Raises:
        RecordingError: missing, not readable, or empty.

    """
    try:
        require_regular(path)
        with path.open("rb", buffering=0) as file:
            if os.fstat(file.fileno()).st_size == 0:
                raise RecordingError(
                    f"{path} is empty", hint="Nothing was recorded; the file can be deleted."
                )
            yield file.fileno()
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror}") from error


def _bytes_at(fd: int, offset: int, length: int) -> memoryview:
    size = os.fstat(fd).st_size
    if offset + length > size:
        raise Malformed(f"its index points to byte {offset + length}, behind its end at {size}")
    return memoryview(read_at(fd, length, offset))


def _record(fd: int, offset: int, length: int, opcode: int) -> Record:
    record = record_at(_bytes_at(fd, offset, length), 0)
    if record.opcode != opcode:
        raise Malformed(f"the record at byte {offset} does not agree with its index")
    return record


def _require_same(head: ChunkHead, index: ChunkIndex) -> None:
    """Raise unless a chunk is the one of the index.

    A writer replaces the open chunks at the end of its file, also by those of other channels.

    Raises:
        Malformed: it is another one.
    """
    found = head.start_ns, head.end_ns, head.size, head.compression, len(head.packed)
    if found != (
        index.message_start_time,
        index.message_end_time,
        index.uncompressed_size,
        index.compression,
        index.compressed_size,
    ):
        raise Malformed(f"the chunk at byte {index.chunk_start_offset} is not that of the index")


def _walked(fd: int) -> Scan | None:
    """Return a scan of the whole file, or None while a writer holds it."""
    return scan(map_file(fd)) if share(fd) else None


def _indexed(fd: int) -> tuple[Contents, int]:
    size, ending = os.fstat(fd).st_size, FOOTER.size + len(MAGIC)
    if read_at(fd, len(MAGIC), 0) != MAGIC:
        raise Malformed("it does not begin like an MCAP file")
    start, crc = parse_footer(memoryview(read_at(fd, ending, max(size - ending, 0))))
    if start == 0:
        raise Malformed("it has no summary")
    if not len(MAGIC) <= start <= size - ending:
        raise Malformed("its footer points outside of the file")
    summary = _bytes_at(fd, start, size - start)
    if crc and crc32(summary[: -len(MAGIC) - 4]) != crc:
        raise Malformed("the CRC of its summary does not match")
    contents = parse_summary(summary[:-ending])
    if contents.messages > sum(map(rows_of, contents.chunks)):
        raise Malformed("its messages are not in indexed chunks")
    return contents, start


def _metadata(fd: int, contents: Contents) -> dict[str, dict[str, str]]:
    """Return the metadata by name; for a repeated name, later values replace earlier values."""
    found: dict[str, dict[str, str]] = {}
    for index in contents.metadata:
        record = _record(fd, index.offset, index.length, Opcode.METADATA)
        content = decode(mcap.Metadata, record.content)
        found.setdefault(content.name, {}).update(content.metadata)
    return found


def _gaps(metadata: Mapping[str, Mapping[str, str]]) -> tuple[Gap, ...]:
    try:
        return gaps_from_json(metadata.get(RECOVERY_METADATA, {}).get(GAPS_KEY, "[]"))
    except ValueError as error:
        raise Malformed(str(error)) from error


def _streams(contents: Contents) -> tuple[dict[str, Stream], tuple[str, ...]]:
    streams: dict[str, Stream] = {}
    others: list[str] = []
    for channel in contents.channels.values():
        stream = _stream(channel, contents)
        if stream is not None and f"/{stream.name}" == channel.topic:
            if streams.setdefault(stream.name, stream) != stream:
                others.append(channel.topic)
        elif channel.topic not in (EVENTS_TOPIC, TRIAL_TOPIC):
            others.append(channel.topic)
    return streams, tuple(others)


def _numbers(contents: Contents) -> dict[str, Channels]:
    """Return the channels of each topic: the first, and those that give the same stream.

    A file that another program merged has several of one topic.
    """
    found: dict[str, Channels] = {}
    for number, channel in contents.channels.items():
        same = found.setdefault(channel.topic, ())
        if not same or _stream(channel, contents) == _stream(contents.channels[same[0]], contents):
            found[channel.topic] = (*same, number)
    return found


def _stream(channel: mcap.Channel, contents: Contents) -> Stream | None:
    schema = contents.schemas.get(channel.schema_id)
    if STREAM_KEY in channel.metadata:
        try:
            return stream_from_json(channel.metadata[STREAM_KEY])
        except ValueError as error:
            raise Malformed(f"channel {channel.topic}: {error}") from error
    if channel.message_encoding != "cdr" or schema is None or schema.encoding != "ros2msg":
        return None
    return stream_from_schema(channel.topic, schema.data.decode(errors="replace"))
