"""Writes recordings; after every flush the file is a complete MCAP file.

One copy into a numpy array of whole Message records turns rows into MCAP messages
(:mod:`~rigd.record.write.openchunk`). The bytes of a closed file depend on the sequence of calls
that gave data, not on flushes or wall time. The writer compresses a chunk when it seals the chunk,
in at most 2 ms. A separate thread for the compression was tried, and cost more than it saved.

If the process is killed, also in the middle of a flush (:mod:`~rigd.record.mcap.journal`), no
flushed data are lost. If the power fails, the data after the last ``fdatasync`` are lost, and at
most the open chunks (1 s) before it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from rigd.model import RecordingError, Stream
from rigd.record.events.event import NO_TRIAL, Event, event_payload
from rigd.record.events.trial_series import TrialSeries
from rigd.record.mcap.chunks import Chunk, build_chunk
from rigd.record.mcap.compression import Compression, compressor
from rigd.record.mcap.contents import SummaryWriter
from rigd.record.mcap.file import RecordingFile
from rigd.record.mcap.prefix import Attachment, build_extras, build_prefix
from rigd.record.mcap.schema import EVENTS_CHANNEL, TRIAL_CHANNEL
from rigd.record.write.openchunk import (
    EVENTS_SPAN_NS,
    OpenChunk,
    OpenMessages,
    OpenRows,
    before_1970,
)
from rigd.record.write.resume import open_for_append

#: Sealed chunks of this total size are written without a flush.
MAX_WAITING_BYTES: Final = 1024 * 1024
DEFAULT_SYNC_S: Final = 1.0
#: The summary grows by 0.7 kB per second of a rig of eight streams: 21 MB in a working day. Once
#: it is longer than this (after 90 s), it is written only so often; the recording of a run that is
#: killed in between needs `rigd recover`.
SPARED_SUMMARY_BYTES: Final = 64 * 1024
SUMMARY_INTERVAL_S: Final = 2.0


class RecordingWriter:
    """One recording being written. Use as a context manager, or call :meth:`close`.

    After an error every method raises the same error again and changes nothing; ``close`` is
    silent. The file then contains the data of the last flush.
    """

    def __init__(
        self,
        file: RecordingFile,
        streams: Mapping[str, tuple[int, Stream]],
        numbers: Mapping[int, int],
        *,
        trial: TrialSeries | None,
        start_ns: int,
        compression: Compression,
        sync_interval_s: float | None,
        clock: Callable[[], float],
    ) -> None:
        """Use :meth:`create` or :meth:`append`."""
        self._file = file
        self._rows = {
            name: OpenRows(stream, channel, numbers.get(channel, 0))
            for name, (channel, stream) in streams.items()
        }
        self._events = OpenMessages(EVENTS_CHANNEL, numbers.get(EVENTS_CHANNEL, 0), EVENTS_SPAN_NS)
        self._marks = OpenMessages(TRIAL_CHANNEL, numbers.get(TRIAL_CHANNEL, 0))
        self._trial = trial
        self._compression = compression
        self._compress = compressor(compression)
        self._start_ns = start_ns
        self._waiting: list[Chunk] = []  #: sealed and not yet written
        self._waiting_bytes = 0
        self._changed = False
        self._closed = False
        self._error: RecordingError | None = None
        self._sync_interval_s = sync_interval_s
        self._clock = clock
        self._synced_at = self._summarised_at = clock()

    @classmethod
    def create(
        cls,
        path: Path,
        *,
        streams: Sequence[Stream],
        metadata: Mapping[str, Mapping[str, str]],
        attachments: Sequence[Attachment],
        start_ns: int,
        compression: Compression = "zstd",
        sync_interval_s: float | None = DEFAULT_SYNC_S,
        clock: Callable[[], float] = time.monotonic,
    ) -> Self:
        """Make a new recording that begins at ``start_ns`` (ns since the Unix epoch).

        ``sync_interval_s`` is how often at most a flush waits for the disk, on ``clock``; None:
        only ``close`` does.

        Raises:
            RecordingError: the file exists or cannot be written, or a stream has no valid name.

        """
        prefix, contents = build_prefix(streams, metadata, attachments, start_ns)
        file = RecordingFile.create(path, prefix, SummaryWriter(contents))
        numbered = {
            stream.name: (number, stream)
            for number, stream in enumerate(streams, EVENTS_CHANNEL + 1)
        }
        return cls(
            file,
            numbered,
            {},
            trial=TrialSeries() if TRIAL_CHANNEL in contents.channels else None,
            start_ns=start_ns,
            compression=compression,
            sync_interval_s=sync_interval_s,
            clock=clock,
        )

    @classmethod
    def append(
        cls,
        path: Path,
        *,
        streams: Sequence[Stream],
        metadata: Mapping[str, Mapping[str, str]] | None = None,
        attachments: Sequence[Attachment] = (),
        compression: Compression = "zstd",
        sync_interval_s: float | None = DEFAULT_SYNC_S,
        clock: Callable[[], float] = time.monotonic,
        trusted: int = 0,
    ) -> Self:
        """Go on writing a complete recording of the same streams.

        Further ``metadata`` of a name that the file has is merged over it by the reader. All but
        the first ``trusted`` bytes are checked before anything is written.

        Raises:
            RecordingError: the file is missing, torn (recover it first), not written by rigd,
                being written by another process, or has other streams.

        """
        start = open_for_append(path, streams, trusted)
        extras = build_extras(
            metadata or {}, attachments, start.start_ns, start.file.sealed, start.contents
        )
        writer = cls(
            start.file,
            start.channels,
            start.numbers,
            trial=start.trial,
            start_ns=start.start_ns,
            compression=compression,
            sync_interval_s=sync_interval_s,
            clock=clock,
        )
        if extras:
            writer._commit(extras, ())
        return writer

    @property
    def sealed(self) -> int:
        """Bytes at the start of the file that do not change any more."""
        return self._file.sealed

    def write(self, stream: str, rows: NDArray[np.void]) -> None:
        """Take rows of a stream, as its :func:`~rigd.model.rows.row_dtype`, in order of time.

        Raises:
            RecordingError: no such stream, rows of another layout, a time before 1970, or an
                earlier error.

        """
        if self._error is not None or self._closed:
            self._check()
        held = self._rows.get(stream)
        if held is None:
            raise RecordingError(
                f"{self._file.path} has no stream {stream!r}", hint=f"It has {sorted(self._rows)}."
            )
        if not held.accepts(rows):
            raise RecordingError(
                f"rows for stream {stream!r} have the wrong layout: {rows.dtype}",
                hint="Build them with rigd.model.rows.row_dtype(stream).",
            )
        count, position = len(rows), 0
        while position < count:
            position += held.fill(rows[position:] if position else rows)
            self._changed = True
            if position < count or held.full:
                self._seal(held)

    def event(
        self, t_ns: int, kind: str, trial: int | None = None, data: Mapping[str, Any] | None = None
    ) -> None:
        """Take an event at ``t_ns``; ``trial`` None if it belongs to none.

        Raises:
            RecordingError: the data has no form in JSON, or an earlier error.

        """
        self._check()
        try:
            event = Event(t_ns, kind, NO_TRIAL if trial is None else trial, data or {})
            payload = event_payload(event, self._start_ns)
        except (TypeError, ValueError) as error:
            raise RecordingError(f"event {kind!r} cannot be recorded: {error}") from error
        if t_ns < 0:
            raise before_1970(t_ns, "events")
        self._events.add(t_ns, payload)
        mark = None if self._trial is None else self._trial.follow(event)
        if mark is not None:
            self._marks.add(t_ns, mark.payload())
        self._changed = True
        for held in (self._events, self._marks):
            if held.full:
                self._seal(held)

    def add_metadata(self, metadata: Mapping[str, Mapping[str, str]]) -> None:
        """Write metadata; of a name that the file has, the reader merges them over the first.

        Raises:
            RecordingError: the disk is full or fails; the file is as the last flush left it.
        """
        self.flush()
        extras = build_extras(metadata, (), self._start_ns, self._file.sealed, self._file.contents)
        self._commit(extras, [chunk for chunk in self._open() if chunk.count])

    def flush(self, *, complete: bool = False) -> None:
        """Write all given data to disk, as a complete MCAP file (a long file every 2 s).

        ``complete``: in any case as a complete file, which any reader opens.

        Raises:
            RecordingError: the disk is full or fails; the file is as the last flush left it.
        """
        self._check()
        if self._changed or complete:
            still_open = [chunk for chunk in self._open() if chunk.count]
            self._commit(b"", still_open, complete=self._summary_due(complete))
            self._changed = False
        if self._sync_interval_s is not None:
            now = self._clock()
            if now - self._synced_at >= self._sync_interval_s:
                self._synced_at = now
                self._guard(self._file.sync)

    def close(self) -> None:
        """Seal and write the remaining data, wait for the disk; silent the second time.

        Raises:
            RecordingError: the disk is full or fails; the file is as the last flush left it.
        """
        if self._closed:
            return
        self._closed = True
        try:
            if self._error is None:
                for chunk in self._open():
                    if chunk.count:
                        self._seal(chunk)
                self._commit(b"", ())
                self._guard(self._file.sync)
        finally:
            self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _open(self) -> list[OpenChunk]:
        """Return the open chunks, in the order in which ``close`` seals them."""
        return [self._events, self._marks, *self._rows.values()]

    def _seal(self, held: OpenChunk) -> None:
        block = held.block()
        chunk = build_chunk(block, self._compression, self._compress(block.records))
        held.clear()
        self._waiting.append(chunk)
        self._waiting_bytes += chunk.size
        if self._waiting_bytes >= MAX_WAITING_BYTES and not self._closed:
            self.flush()

    def _summary_due(self, complete: bool) -> bool:
        """Return whether this flush shall write the summary, as it does while that is short."""
        now = self._clock()
        long = not complete and self._file.summary_size > SPARED_SUMMARY_BYTES
        if long and now - self._summarised_at < SUMMARY_INTERVAL_S:
            return False
        self._summarised_at = now
        return True

    def _commit(
        self, extras: bytes, still_open: Sequence[OpenChunk], *, complete: bool = True
    ) -> None:
        blocks = [held.block() for held in still_open]
        # Not compressed: they are written again at each flush until they are sealed.
        behind = [build_chunk(block, "none", block.records) for block in blocks]
        self._guard(lambda: self._file.commit(extras, self._waiting, behind, complete=complete))
        self._waiting.clear()
        self._waiting_bytes = 0

    def _guard(self, action: Callable[[], None]) -> None:
        """Do ``action``; an error is stored, because nothing may be written after a gap."""
        try:
            action()
        except RecordingError as error:
            self._error = error
            raise

    def _check(self) -> None:
        if self._error is not None:
            raise self._error
        if self._closed:
            raise RecordingError(f"{self._file.path} is closed")
