"""Repairs a recording: leaves out damaged records, keeps all others and the original file.

If only the end of a file is missing, rigd appends it to the file. In all other cases rigd makes a
repaired file beside the damaged file, and keeps the damaged file under another name. At every
moment one complete file, the damaged or the repaired one, has the name of the recording. So a
repair that is killed, or that fails because the disk is full, changes nothing.
"""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import count
from pathlib import Path
from typing import Final

from mcap import records as mcap
from mcap.opcode import Opcode

from rigd.model import RecordingError
from rigd.model.machine.system import BINARY, copy_mode, require_linux, sync_folder
from rigd.record.events.gaps import Gap, gaps_to_json
from rigd.record.mcap.access import how_to_recover, require_regular
from rigd.record.mcap.bounds import about
from rigd.record.mcap.contents import SummaryWriter, rows_by_topic
from rigd.record.mcap.crc import crc32
from rigd.record.mcap.file import open_locked, write_error
from rigd.record.mcap.journal import Saved, journal_path, read_journal
from rigd.record.mcap.prefix import GAPS_KEY, RECOVERY_METADATA
from rigd.record.mcap.wire import FRAME, Malformed, decode, map_file
from rigd.record.read.moment import DATE_KEY, VIRTUAL
from rigd.record.repair.rebuild import complete, rebuild
from rigd.record.scan.findings import collect, drop_copies
from rigd.record.scan.scan import Damage, Scan, scan
from rigd.record.scan.walk import walk

#: Bytes of the torn end of a file that are looked at together.
_PART_BYTES: Final = 1 << 20
#: The errors of file systems without second names of a file, such as exFAT and CIFS.
_NO_LINKS: Final = (errno.EPERM, errno.EOPNOTSUPP, errno.ENOSYS, errno.EMLINK)


class Headless(RecordingError):
    """The file contains no part of a recording, so nothing can be kept."""


@dataclass(frozen=True)
class RecoveryReport:
    """The result of :func:`recover`; ``rows_kept`` by topic.

    ``lost_bytes`` are those of the damaged file that the repaired file lacks.
    """

    path: Path
    intact: bool  #: nothing was wrong, and nothing was changed
    problem: str  #: what was wrong first; empty if intact
    from_journal: bool  #: whether rows came back from the journal of a torn flush
    rows_kept: dict[str, int]
    lost_bytes: int
    damages: tuple[Damage, ...] = ()
    gaps: tuple[Gap, ...] = ()  #: which rows are lost
    another: int | None = None  #: byte of the damaged file where another recording begins
    original: Path | None = None  #: where the damaged file is kept; None: completed in place


def recover(
    path: Path, *, trusted: int = 0, own: bool = False, others: bool = True
) -> RecoveryReport:
    """Make a recording readable again; does nothing to an intact one.

    Every message that can be read is kept, of a file of any program; without ``others`` the files
    of other programs are refused.

    The first ``trusted`` bytes are not checked (:mod:`~rigd.record.scan.scan`). ``own``: the caller
    has all rows that are not flushed, so the torn end of a file need not be kept. A recovery that
    is killed can be run again. A repaired recording has a metadata record ``recovery`` that names
    the rows that are lost; its run counts as interrupted if it has no ``run_end`` event.

    Raises:
        Headless: empty, or no MCAP file.
        InUse: being written.
        RecordingError: missing, no regular file, damaged without a message that can be read, or
            the disk refuses; the file is as it was.
        NeedsLinux: it is damaged, and this is another system.

    """
    if path.is_symlink():
        path = path.resolve()  # its journal and its original stand beside the file itself
    try:
        require_regular(path)
        fd = open_locked(path)
    except OSError as error:
        raise RecordingError(f"cannot open {path}: {error.strerror}") from error
    try:
        with about(path):
            return _recover(fd, path, trusted, own=own, others=others)
    except OSError as error:
        raise write_error(path, error) from error
    finally:
        os.close(fd)


def _recover(fd: int, path: Path, trusted: int, *, own: bool, others: bool) -> RecoveryReport:
    size = os.fstat(fd).st_size
    found = _scan(fd, path, trusted)
    if found.intact:
        journal_path(path).unlink(missing_ok=True)
        return _report(path, found, False, 0, None)
    require_linux("the repair of a damaged recording")
    if found.others:
        return _recover_others(fd, path, found, allowed=others)
    saved = read_journal(path)
    if saved is not None and not saved.identity.is_of(map_file(fd)):
        saved = None  # of another recording
    from_journal = saved is not None and _add_saved(found, saved)
    original: Path | None = None
    if own and saved is not None and found.data_end >= saved.offset:
        _complete(fd, found, saved.offset)
    elif (own and not found.behind and found.another is None) or (
        not from_journal and _loses_nothing(fd, found)
    ):
        _complete(fd, found, found.data_end)
    else:
        original = _replace(fd, path, found)
    if original is None and saved is not None:
        journal_path(path).unlink(missing_ok=True)
    kept = sum(len(piece.data) for piece in found.pieces)
    return _report(path, found, from_journal, max(size - kept, 0), original)


def _report(
    path: Path, found: Scan, from_journal: bool, lost_bytes: int, original: Path | None
) -> RecoveryReport:
    return RecoveryReport(
        path=path,
        intact=found.intact,
        problem=found.problem,
        from_journal=from_journal,
        rows_kept=rows_by_topic(found.contents),
        lost_bytes=lost_bytes,
        damages=tuple(found.damages),
        another=found.another,
        gaps=() if original is None else found.gaps(),
        original=original,
    )


def _recover_others(fd: int, path: Path, found: Scan, *, allowed: bool) -> RecoveryReport:
    """Make a repaired file of what another program wrote; the damaged file is always kept."""
    if not allowed:
        raise RecordingError(
            f"{path} was written by {found.library!r} and is damaged: {found.problem}",
            hint=how_to_recover(path),
        )
    _require_messages(path, found)
    original = _replace(fd, path, found)
    kept = sum(len(piece.data) for piece in found.pieces)
    lost = max(os.fstat(fd).st_size - kept, 0)
    return _report(path, found, False, lost, original)


def _require_messages(path: Path, found: Scan) -> None:
    """Refuse to give the name of a recording to a file without a message.

    Raises:
        RecordingError: nothing but indexes or definitions can be kept.
    """
    if not found.contents.messages and not found.unread:
        raise RecordingError(
            f"{path} has no message that can be read: {found.problem}",
            hint="The file is as it was.",
        )


def split_off(source: Path, at: int, beside: Path) -> Path:
    """Copy the recording that begins at byte ``at`` of a file to a file of its own; return it.

    Its name is that of ``beside`` with a number that no file has yet.

    Raises:
        RecordingError: the disk is full or fails.
    """
    for number in count(2):
        target = beside.with_name(f"{beside.stem}-{number}{beside.suffix}")
        try:
            with source.open("rb") as file, target.open("xb") as copy:
                try:
                    file.seek(at)
                    shutil.copyfileobj(file, copy, 1 << 20)
                except OSError:
                    target.unlink()
                    raise
        except FileExistsError:
            continue
        except OSError as error:
            raise write_error(target, error) from error
        return target
    raise AssertionError("count() does not end")


def _scan(fd: int, path: Path, trusted: int) -> Scan:
    if os.fstat(fd).st_size == 0:
        raise Headless(f"{path} is empty", hint="Nothing was recorded; the file can be deleted.")
    try:
        return scan(map_file(fd), trusted)
    except Malformed as error:
        raise Headless(
            f"{path} cannot be recovered: {error}", hint="It is no MCAP recording."
        ) from error


def _add_saved(found: Scan, saved: Saved) -> bool:
    """Add the chunks of the journal that the file lost; return whether there were any."""
    in_journal = Scan(data_end=saved.offset)
    walk(memoryview(saved.data), in_journal, saved.offset)
    # Of two that are equal, the first is kept: that of the file.
    found.pieces = [*found.pieces, *in_journal.pieces]
    drop_copies(found)
    ours = {id(piece) for piece in in_journal.pieces}
    added = [piece for piece in found.pieces if id(piece) in ours]
    rest = [piece for piece in found.pieces if id(piece) not in ours]
    front = [piece for piece in rest if piece.start < saved.offset]
    found.pieces = [*front, *added, *rest[len(front) :]]
    collect(found)
    return bool(added)


def _loses_nothing(fd: int, found: Scan) -> bool:
    """Return whether only indexes and the end are missing behind sound data, and no row."""
    if found.behind or found.another is not None:
        return False
    rest = map_file(fd)[found.data_end :]
    if found.data_sound:
        # What is longer than an end may be anything, such as a second recording.
        return len(rest) <= len(SummaryWriter(found.contents).tail(found.data_end, 0, ()))
    if found.missing_index:
        return len(rest) < len(found.missing_index)
    parts = (rest[at : at + _PART_BYTES] for at in range(0, len(rest), _PART_BYTES))
    return not any(part.tobytes().strip(b"\0") for part in parts)


def _complete(fd: int, found: Scan, cut: int) -> None:
    """Write the missing parts from byte ``cut`` of the file on."""
    marks = _marks(fd, found, {"problem": found.problem})
    complete(fd, found, cut, crc32(map_file(fd)[:cut]), marks)


def _marks(fd: int, found: Scan, mark: Mapping[str, str]) -> dict[str, Mapping[str, str]]:
    """Return the metadata that a recovery adds: ``mark``, and the date that it would change."""
    run: dict[str, str] = {}
    for piece in found.pieces:
        if piece.opcode == Opcode.METADATA:
            content = decode(mcap.Metadata, piece.data[FRAME.size :])
            run |= content.metadata if content.name == "run" else {}
    marks = {RECOVERY_METADATA: mark}
    if VIRTUAL in run.get("mode", "") and DATE_KEY not in run:
        date = datetime.fromtimestamp(os.fstat(fd).st_mtime, UTC)
        marks["run"] = {DATE_KEY: date.isoformat()}
    return marks


def _replace(fd: int, path: Path, found: Scan) -> Path:
    """Replace the damaged file by a repaired file; return the path of the damaged file."""
    draft = path.with_name(f"{path.name}.recovering")
    mark = {"problem": found.problem, GAPS_KEY: gaps_to_json(found.gaps())}
    marks = _marks(fd, found, mark)
    target = os.open(draft, os.O_RDWR | os.O_CREAT | os.O_TRUNC | BINARY, 0o600)
    try:
        try:
            rebuild(target, found, marks)
            copy_mode(target, os.fstat(fd).st_mode)
        finally:
            os.close(target)
        original = _kept(fd, path)
        draft.replace(path)
    except OSError:
        with suppress(OSError):  # the first error is the one to report
            draft.unlink()
        raise
    journal = journal_path(path)
    with suppress(FileNotFoundError):
        journal.rename(journal_path(original))
    sync_folder(path.parent)
    return original


def _kept(fd: int, path: Path) -> Path:
    """Give the damaged file a second name, as yet unused; return it."""
    for number in count(1):
        name = f"{path.name}.orig" if number == 1 else f"{path.name}.orig{number}"
        original = path.with_name(name)
        try:
            _link(fd, path, original)
        except FileExistsError:
            if not os.path.samestat(os.fstat(fd), original.stat()):
                continue
            # A repair that was killed immediately afterwards gave it its second name.
        return original
    raise AssertionError("count() does not end")


def _link(fd: int, path: Path, original: Path) -> None:
    """Give a file a second name; where the file system has no second names, copy it.

    Raises:
        FileExistsError: the name is taken.
        OSError: the disk is full or fails.
    """
    try:
        os.link(path, original)
    except OSError as error:
        if error.errno not in _NO_LINKS:
            raise
        if original.exists():
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST)) from error
        copy = original.with_name(f"{original.name}.copying")
        try:
            with copy.open("wb") as target:
                target.write(map_file(fd))
                copy_mode(target.fileno(), os.fstat(fd).st_mode)
                target.flush()
                os.fsync(target.fileno())
            copy.replace(original)
        except OSError:
            with suppress(OSError):  # the first error is the one to report
                copy.unlink()
            raise
