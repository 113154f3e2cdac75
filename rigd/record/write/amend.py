"""Adds notes and results to a finished recording; no byte of its samples changes.

Metadata of MCAP stand in the data section, before the summary: to add some, the end of the file is
written anew. That is done in a copy, which then takes the name of the recording: at each moment a
complete file has that name, with the addition or without it.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping
from contextlib import ExitStack, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from rigd.model import RecordingError
from rigd.model.about import MOST_LETTERS, MOST_NOTE_LETTERS, check_text
from rigd.model.machine.system import copy_mode, sync_folder
from rigd.record.mcap.access import has_locks, how_to_recover, require_regular
from rigd.record.mcap.file import open_locked, write_error
from rigd.record.mcap.wire import map_file
from rigd.record.read.moment import DATE_KEY, recorded_at
from rigd.record.read.notes import NOTES_METADATA, Note, note_content
from rigd.record.read.reader import Recording
from rigd.record.scan.scan import scan
from rigd.record.write.writer import RecordingWriter

#: Ends the name of the copy until it is complete.
_DRAFT: Final = ".adding"


def add_note(path: Path, text: str, author: str, at: datetime | None = None) -> Note:
    """Add a note to a recording, and return it; ``at`` is now by default.

    Raises:
        ValueError: text or author is empty, too long, or has control characters.
        RecordingError: as :func:`add_metadata`.
    """
    text, author = text.strip(), author.strip()
    for given, name in ((text, "the note"), (author, "the author of the note")):
        if not given:
            raise ValueError(f"{name} is empty")
    check_text(text, "the note", MOST_NOTE_LETTERS, lines=True)
    check_text(author, "the author", MOST_LETTERS)
    moment = (at or datetime.now(UTC)).astimezone(UTC)
    note = Note(f"{moment:%Y-%m-%dT%H:%M:%S.%fZ}", author, text)
    added = {NOTES_METADATA: {note.at: note_content(note)}}
    recorded = recorded_at(Recording.open(path).info)
    if recorded.of == "file":  # which is new once the note is in it
        added["run"] = {DATE_KEY: recorded.at.isoformat()}
    add_metadata(path, added)
    return note


def add_metadata(path: Path, metadata: Mapping[str, Mapping[str, str]]) -> None:
    """Add metadata to a finished recording; values of a name that it has are merged over it.

    Needs the time and the space of a copy of the file.

    Raises:
        RecordingError: missing, damaged, not made by rigd, being written, or the disk refuses; the
            recording is as it was.
    """
    if path.is_symlink():
        path = path.resolve()
    try:
        require_regular(path)
        fd = open_locked(path)
    except OSError as error:
        raise RecordingError(f"cannot open {path}: {error.strerror}") from error
    with ExitStack() as opened:
        opened.callback(os.close, fd)
        try:
            _replace(fd, path, metadata, opened)
        except OSError as error:
            raise write_error(path, error) from error


def _data_end(fd: int, path: Path) -> int:
    """Return at which byte the data of an intact recording end; nothing stays mapped."""
    found = scan(map_file(fd))
    if not found.intact:
        raise RecordingError(f"{path} is damaged: {found.problem}", hint=how_to_recover(path))
    return found.data_end


def _replace(
    fd: int, path: Path, metadata: Mapping[str, Mapping[str, str]], opened: ExitStack
) -> None:
    recording = Recording.open(path)
    if not recording.written_by_rigd:
        raise RecordingError(f"{path} was not written by rigd, which therefore does not add to it")
    data_end = _data_end(fd, path)
    draft = path.with_name(f"{path.name}{_DRAFT}")
    try:
        with open(fd, "rb", closefd=False) as source, draft.open("wb") as target:
            copy_mode(target.fileno(), os.fstat(fd).st_mode)
            shutil.copyfileobj(source, target, 1 << 20)
        streams = tuple(recording.streams.values())
        RecordingWriter.append(draft, streams=streams, metadata=metadata, trusted=data_end).close()
        if not has_locks():
            opened.close()  # Windows replaces no file that is open
        draft.replace(path)
    except BaseException:
        with suppress(OSError):  # the first error is the one to report
            draft.unlink()
        raise
    sync_folder(path.parent)
