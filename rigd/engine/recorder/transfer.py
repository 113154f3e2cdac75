"""Moves every row and every event from the rings into the recording exactly once.

The recorder takes rows from a ring, writes and flushes them, and only then releases them. A
recorder that is killed in between leaves rows that are both on disk and in the ring. The next
recorder counts these rows: the rows of a stream on disk since the run began, minus the released
rows. The events of several rings share one channel of the file, so the next recorder compares the
last events one by one.
"""

from __future__ import annotations

import json
import os
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from rigd.engine.shared import EVENT_SOURCES, Job, RunFolder
from rigd.model.errors import RecordingError
from rigd.record import NO_TRIAL, Event, Recording, RecordingWriter, recover
from rigd.record.mcap.file import RecordingInUse
from rigd.record.repair.recover import Headless

#: The contents of the file at the start of the run, in the run's folder; written before the first
#: row.
_BEGUN: Final = "begun.json"
#: Key in the data of an event that the recorder itself adds: its process id.
BY_RECORDER: Final = "recorder"
#: A reader or `rigd recover` may lock the file for a moment.
_PATIENCE_S: Final = 10.0


class Transfer:
    """Moves rows and events from the rings of one run into its recording.

    Call :meth:`open`, then :meth:`move` from time to time, at the end :meth:`finish` or
    :meth:`pause`.
    """

    def __init__(self, folder: RunFolder) -> None:
        """Read job and rings in ``folder``.

        Raises:
            RecordingError: one of them is missing.
        """
        job = folder.job
        self._folder = folder
        self._job: Job = job
        self._rows = folder.row_rings(job)
        self._events = [folder.event_ring(source) for source in EVENT_SOURCES]
        self._writer: RecordingWriter | None = None
        self._latest_ns = job.start_ns  #: time of the latest recorded row or event
        self._ended = False  #: whether the end of the run is recorded

    def open(self, trusted: int = 0) -> None:
        """Begin the recording, or continue it after an earlier recorder was killed.

        ``trusted`` is the last :attr:`sealed` that this recorder reported, which avoids reading all
        of a long file; 0 if the machine may have failed since.

        Raises:
            RecordingError: the recording cannot be written.
        """
        deadline = time.monotonic() + _PATIENCE_S
        while self._writer is None:
            try:
                self._open_writer(trusted)
            except RecordingInUse:
                if time.monotonic() > deadline:
                    raise
                time.sleep(0.05)

    @property
    def empty(self) -> bool:
        """Whether the rings are empty."""
        return not any(ring.fill for ring in self._rows.values()) and not any(
            ring.fill for ring in self._events
        )

    @property
    def sealed(self) -> int:
        """Bytes of the recording that do not change any more."""
        return self._to.sealed

    @property
    def begun(self) -> bool:
        """Whether a recorder has already begun with this run."""
        return self._begun_path.exists()

    def move(self) -> None:
        """Write everything in the rings to disk, then release it.

        Raises:
            RecordingError: the disk is full or fails; nothing is released.
        """
        rows = {name: ring.peek() for name, ring in self._rows.items()}
        events = [ring.take() for ring in self._events]
        for name, block in rows.items():
            if len(block):
                self._to.write(name, block)
                self._latest_ns = max(self._latest_ns, int(block["t_ns"][-1]))
        for event in _in_order(events):
            self._write_event(event)
        self._to.flush()
        for name, block in rows.items():
            self._rows[name].release(len(block))
        for ring, some in zip(self._events, events, strict=True):
            ring.release(len(some))

    def finish(self, reason: str) -> None:
        """Empty the rings and close the file for good; the run's folder may then be cleared.

        A run without a recorded end is marked interrupted, with ``reason``.

        Raises:
            RecordingError: the disk is full or fails; the rings still contain the rows not on disk.
        """
        self.move()
        lost = {name: ring.overruns for name, ring in self._rows.items() if ring.overruns}
        events_lost = sum(ring.overruns for ring in self._events)
        if lost or events_lost:
            self._own_event("overrun", {"rows": lost, "events": events_lost})
        if not self._ended:
            self._own_event("run_end", {"state": "interrupted", "reason": reason})
        self._to.close()

    def pause(self) -> None:
        """Write everything in the rings to disk and close the file; another recorder continues.

        Raises:
            RecordingError: the disk is full or fails; the rings still contain the rows not on disk.
        """
        self.move()
        self._to.close()

    def close(self) -> None:
        """Close the file after an error; silent otherwise."""
        if self._writer is not None:
            self._writer.close()

    @property
    def _to(self) -> RecordingWriter:
        if self._writer is None:
            raise RecordingError(f"{self._job.recording} is not open")
        return self._writer

    @property
    def _begun_path(self) -> Path:
        return self._folder.path / _BEGUN

    def _open_writer(self, trusted: int) -> None:
        path = self._job.recording
        if self.begun:
            self._go_on(trusted)
        elif self._job.resume:
            recover(path, others=False)
            self._note_begun(Recording.open(path))
            self._go_on(path.stat().st_size)
        elif path.exists():
            raise RecordingError(
                f"{path} exists already", hint="Choose another name; rigd overwrites no recording."
            )
        else:
            self._note_begun(None)
            self._create()

    def _create(self) -> None:
        job = self._job
        self._writer = RecordingWriter.create(
            job.recording,
            streams=job.streams,
            metadata=job.metadata,
            attachments=job.attachments,
            start_ns=job.start_ns,
            compression=job.compression,
        )

    def _go_on(self, trusted: int) -> None:
        """Continue the file, after counting the rows of the rings that it already contains."""
        path, job = self._job.recording, self._job
        if not job.resume and not path.exists():
            return self._create_again("the recording was missing")
        try:
            recover(path, trusted=trusted, own=True)
        except Headless:
            if job.resume:
                raise
            # The recorder was killed while it made the file: nothing was released yet. Renamed,
            # because rigd does not delete a file that it cannot read.
            path.rename(path.with_name(f"{path.name}.torn"))
            return self._create_again("the recording had no beginning")
        recording = Recording.open(path)
        if not job.resume and recording.start_ns != job.start_ns:
            raise RecordingError(
                f"{path} is not the recording that the rings in {self._folder.path} belong to",
                hint=(
                    f"Restore the right file, or remove {self._folder.path} to discard the samples."
                ),
            )
        known, held = recording.metadata, recording.attachments
        self._writer = RecordingWriter.append(
            path,
            streams=job.streams,
            metadata={
                name: values
                for name, values in job.metadata.items()
                if not values.items() <= known.get(name, {}).items()
            },
            attachments=[
                attachment for attachment in job.attachments if attachment.name not in held
            ],
            compression=job.compression,
            trusted=path.stat().st_size,  # recover has just read all of it
        )
        self._latest_ns = max(recording.end_ns, job.start_ns)
        self._settle(recording)
        return None

    def _create_again(self, reason: str) -> None:
        self._create()
        lost = {name: ring.tail for name, ring in self._rows.items() if ring.tail}
        self._note_restart(reason, lost, sum(ring.released for ring in self._events))

    def _settle(self, recording: Recording) -> None:
        """Release rows that an earlier recorder has put on disk but not released."""
        before = self._before
        since = recording.events()[before["events"] :]
        self._ended = any(event.kind == "run_end" for event in since)
        rows_lost = self._settle_rows(recording, before["rows"])
        events_lost = self._settle_events([item for item in since if BY_RECORDER not in item.data])
        rows_since = any(recording.recorded(name) > before["rows"][name] for name in self._rows)
        if rows_lost or events_lost or ((since or rows_since) and not self._ended):
            self._note_restart("the previous recorder was killed", rows_lost, events_lost)

    def _settle_rows(self, recording: Recording, before: Mapping[str, int]) -> dict[str, int]:
        """Return the number of released rows that are not on disk, by stream."""
        lost: dict[str, int] = {}
        for name, ring in self._rows.items():
            unreleased = recording.recorded(name) - before[name] - ring.tail
            if unreleased >= 0:
                ring.release(min(unreleased, ring.head - ring.tail))
            else:
                lost[name] = -unreleased
        return lost

    def _settle_events(self, on_disk: Sequence[Event]) -> int:
        """Write the events that are not on disk; return the number of released ones missing."""
        if len(on_disk) == sum(ring.taken for ring in self._events):
            # All taken events are on disk; only the release was interrupted.
            for ring in self._events:
                ring.release(ring.taken - ring.released)
        # Else not all of the last taken events are on disk, so none of them was released, and they
        # come after all others.
        unreleased = len(on_disk) - sum(ring.released for ring in self._events)
        known = Counter(map(_key, on_disk[len(on_disk) - max(unreleased, 0) :]))
        waiting = [ring.take() for ring in self._events]
        for event in _in_order(waiting):
            if known[_key(event)] > 0:
                known[_key(event)] -= 1
            else:
                self._write_event(event)
        self._to.flush()
        for ring, some in zip(self._events, waiting, strict=True):
            ring.release(len(some))
        return max(-unreleased, 0)

    def _note_begun(self, recording: Recording | None) -> None:
        """Write down the contents of the file before the run."""
        if recording is None:
            rows, events = dict.fromkeys(self._rows, 0), 0
        else:
            known = recording.streams
            rows = {name: recording.recorded(name) if name in known else 0 for name in self._rows}
            events = len(recording.events())
        draft = self._begun_path.with_suffix(".new")
        draft.write_text(json.dumps({"rows": rows, "events": events}))
        draft.replace(self._begun_path)

    @property
    def _before(self) -> Mapping[str, Any]:
        content: Mapping[str, Any] = json.loads(self._begun_path.read_bytes())
        return content

    def _write_event(self, event: Event) -> None:
        self._to.event(event.t_ns, event.kind, event.trial, event.data)
        self._latest_ns = max(self._latest_ns, event.t_ns)
        self._ended = self._ended or event.kind == "run_end"

    def _note_restart(self, reason: str, rows_lost: Mapping[str, int], events_lost: int) -> None:
        data = {"reason": reason, "rows_lost": rows_lost, "events_lost": events_lost}
        self._own_event("recorder_restarted", data)
        self._to.flush()

    def _own_event(self, kind: str, data: Mapping[str, Any]) -> None:
        """Record an event of the recorder itself, at the latest time that it knows."""
        self._to.event(self._latest_ns, kind, NO_TRIAL, {**data, BY_RECORDER: os.getpid()})


def _key(event: Event) -> tuple[int, str, int, str]:
    return event.t_ns, event.kind, event.trial, json.dumps(event.data, sort_keys=True)


def _in_order(events: Sequence[Sequence[Event]]) -> list[Event]:
    """Return the events of several rings by time; events of the same time ring by ring."""
    return sorted((event for some in events for event in some), key=lambda event: event.t_ns)
