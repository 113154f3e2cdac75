"""Lists and reads the recordings of a rig for clients; clients give a file name, never a path."""

from __future__ import annotations

import base64
import errno
import hashlib
import json
import os
import re
import stat
from collections import OrderedDict
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from datetime import datetime
from functools import cache
from io import BufferedReader
from pathlib import Path
from typing import Final

from rigd.analysis.plan import calibrating
from rigd.catalogue import parse_where, search
from rigd.catalogue.facts import assigned, condition_of
from rigd.engine.shared.scarce import insist
from rigd.model.errors import ConfigError, RecordingError
from rigd.model.machine.folders import make_folder
from rigd.model.pages import page_of
from rigd.record import Recording, RunInfo, info_json
from rigd.record.events.trials import INTERRUPTED
from rigd.record.read.index import DamagedRecording
from rigd.record.read.moment import is_virtual, recorded_at
from rigd.remote.protocol import Code, Refusal
from rigd.remote.protocol.arguments import RUN_NAME
from rigd.remote.protocol.results import PieceView, RunLine, RunList, RunView
from rigd.remote.protocol.status import Interrupted

#: The errors of reading a recording that is torn, or not made by rigd.
_UNREADABLE: Final = (RecordingError, ValueError)
#: The form of the name of a recording; other files in the folder are left out.
_NAME: Final = re.compile(RUN_NAME)
_KNOWN: Final = "`rigd remote runs` lists those there are"
_MAKE: Final = "`rigd remote report {} --make` makes one"
IDENTIFICATION: Final = "identification"
#: Digests of so many files are stored: a transfer needs the digest of its file for each piece.
_DIGESTS: Final = 8
#: One message contains so many trials of a recording, the newest.
_TRIALS: Final = 1000


class Recordings:
    """The recordings in ``folder``."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._digests: OrderedDict[tuple[Path, int, int], str] = OrderedDict()

    def make_folder(self) -> None:
        """Make the folder if a person has removed it.

        Raises:
            RecordingError: it cannot be made.
        """
        make_folder(self.folder, "--runs")

    def lines(
        self, limit: int, before: str | None, under_way: str | None, where: str = ""
    ) -> RunList:
        """Return the newest ``limit`` recordings, of those older than ``before`` if given.

        The recording ``under_way`` has the state ``running``. ``where``: only recordings for which
        this condition holds; one that cannot be read is none of them.

        Raises:
            Refusal: the condition is wrong.
        """
        names = sorted((path.name for path in self._paths()), reverse=True)
        if where.strip():
            matching = self._matching(where)
            names = [name for name in names if name in matching]
        older = [name for name in names if before is None or name < before]
        lines = [self._line(name, under_way) for name in older[:limit]]
        return RunList(runs=tuple(lines), more=len(older) > limit)

    def view(self, name: str, under_way: str | None) -> RunView:
        """Return all data of a recording.

        Raises:
            Refusal: there is none of that name.
        """
        path = self.path(name)
        try:
            info = _info(path)
            line = _line_of(info, name == under_way)
        except _UNREADABLE as error:
            return RunView(line=_unread(path, error, name == under_way))
        newest = replace(info, trials=info.trials[-_TRIALS:])
        details = json.loads(json.dumps(info_json(newest)))
        return RunView(line=line, details=details)

    def piece(self, path: Path, offset: int, length: int) -> PieceView:
        """Return a piece of a file.

        Raises:
            Refusal: ``offset`` is beyond its end, or it cannot be read.
        """
        try:
            with _opened(path) as file:
                size, digest = self._digest(path, file)
                file.seek(min(offset, size))
                data = file.read(length)
        except OSError as error:
            raise Refusal(Code.REFUSED, f"{path.name} cannot be read: {error.strerror}") from error
        if offset > size:
            raise Refusal(Code.BAD_REQUEST, f"{path.name} has {size} bytes, none at {offset}")
        return PieceView(size=size, sha256=digest, offset=offset, data=base64.b64encode(data))

    def path(self, name: str) -> Path:
        """Return the path of a recording.

        Raises:
            Refusal: there is none of that name.
        """
        path = self.folder / name
        if path.suffix != ".mcap" or _NAME.fullmatch(name) is None or not _is_regular(path):
            raise Refusal(Code.NOT_FOUND, f"there is no recording {name}", hint=_KNOWN)
        return path

    def report(self, name: str, page: str = IDENTIFICATION) -> Path:
        """Return the path of a page on a recording: ``run`` or ``identification``.

        Raises:
            Refusal: there is none.
        """
        recording = self.path(name)
        if page == IDENTIFICATION:
            path, hint = recording.with_suffix(".html"), _MAKE.format(name)
        else:
            path, hint = page_of(recording), "`draw` makes one"
        if not _is_regular(path):
            raise Refusal(Code.NOT_FOUND, f"there is no report on {name}", hint=hint)
        return path

    def of(self, rig: str) -> Sequence[RunInfo]:
        """Return the readable recordings of a rig, newest first."""
        found = []
        for path in self._paths():
            try:
                info = _info(path)
            except RecordingError:
                continue  # it is listed, with its problem
            if info.rig == rig:
                found.append(info)
        return sorted(found, key=lambda info: info.path.name, reverse=True)

    def interrupted(self, name: str) -> Interrupted | None:
        """Return the resumable state of a recording, if it exists and its run was interrupted."""
        try:
            return interrupted(insist(lambda: _info(self.folder / name)))
        except RecordingError:
            return None  # it is listed, with its problem

    def unreadable(self) -> Sequence[Path]:
        """Return the recordings that are torn."""
        torn = []
        for path in filter(_is_regular, self._paths()):
            try:
                Recording.open(path)
            except RecordingError:
                torn.append(path)
        return torn

    def _paths(self) -> list[Path]:
        return [path for path in self.folder.glob("*.mcap") if _NAME.fullmatch(path.name)]

    def _matching(self, where: str) -> set[str]:
        """Return the names of the recordings for which a condition holds.

        Raises:
            Refusal: it is wrong, or the folder is missing.
        """
        try:
            return {line.file for line in search(self.folder, parse_where(where)).lines}
        except (ConfigError, RecordingError) as error:
            raise Refusal(Code.BAD_REQUEST, error.message, hint=error.hint) from error

    def _line(self, name: str, under_way: str | None) -> RunLine:
        path = self.folder / name
        try:
            return _line_of(_info(path), name == under_way)
        except _UNREADABLE as error:
            return _unread(path, error, name == under_way)

    def _digest(self, path: Path, file: BufferedReader) -> tuple[int, str]:
        """Return size and SHA-256 of a file; the result is stored for a while."""
        known = os.fstat(file.fileno())
        key = path, known.st_size, known.st_mtime_ns
        if key not in self._digests:
            self._digests[key] = hashlib.file_digest(file, "sha256").hexdigest()
            if len(self._digests) > _DIGESTS:
                self._digests.popitem(last=False)
        self._digests.move_to_end(key)
        return known.st_size, self._digests[key]


def _is_regular(path: Path) -> bool:
    """Return whether a path is a file itself: no link to elsewhere, no pipe that keeps waiting."""
    try:
        return stat.S_ISREG(path.lstat().st_mode)
    except OSError:
        return False


@contextmanager
def _opened(path: Path) -> Iterator[BufferedReader]:
    """Open a regular file to read it.

    Raises:
        OSError: it is none, or cannot be opened.
    """
    number = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    with os.fdopen(number, "rb") as file:
        if not stat.S_ISREG(os.fstat(number).st_mode):
            raise OSError(errno.EINVAL, "it is no regular file")
        yield file


def is_drawn(recording: Path) -> bool:
    """Return whether the page of a run is there, and as new as its recording."""
    try:
        return page_of(recording).stat().st_mtime_ns >= recording.stat().st_mtime_ns
    except OSError:
        return False


def interrupted(info: RunInfo) -> Interrupted | None:
    """Return the resumable state of a run without a regular end, or None."""
    if info.state != INTERRUPTED or info.foreign is not None:
        return None
    return Interrupted(
        run=info.path.name,
        reason=info.reason or "its recording has no end",
        trials_done=info.trials_done,
        trials_total=_total(info),
    )


def _info(path: Path) -> RunInfo:
    if os.path.lexists(path) and not _is_regular(path):
        raise RecordingError(f"{path.name} is no file of its own, but a link, a pipe or a folder")
    return Recording.open(path).info


def _total(info: RunInfo) -> int:
    text = info.metadata.get("run", {}).get("trials", "")
    return int(text) if text.isdecimal() else 0


def _line_of(info: RunInfo, under_way: bool) -> RunLine:
    if under_way:
        info = replace(info, state="running")
    return RunLine(
        run=info.path.name,
        procedure=info.procedure,
        state=info.state,
        started_ns=_started_ns(info),
        duration_s=info.took_s,
        trials_done=info.trials_done,
        trials_total=_total(info),
        size=info.size,
        has_report=_is_regular(info.path.with_suffix(".html")),
        has_page=is_drawn(info.path),
        identifies="identify" in info.metadata,
        calibrates=info.metadata.get("identify", {}).get("model") in _calibrating(),
        set=assigned(info.metadata.get("overrides", {})),
        specimen=info.specimen.get("name", ""),
        condition=condition_of(info),
    )


@cache
def _calibrating() -> Collection[str]:
    return frozenset(calibrating())


def _started_ns(info: RunInfo) -> int:
    """Return the calendar time of the start of a run, in ns since 1970; 0 if unknown.

    Raises:
        ValueError: the file contains an invalid date.
    """
    if is_virtual(info):  # virtual time begins anew in each run
        return round(recorded_at(info).at.timestamp() * 1e9)
    return round(datetime.fromisoformat(info.started).timestamp() * 1e9) if info.started else 0


def _unread(path: Path, error: Exception, under_way: bool) -> RunLine:
    """Return the line of a recording that is damaged, or has no rows on disk yet."""
    problem = error.message if isinstance(error, RecordingError) else f"not one of rigd's: {error}"
    try:
        size = path.stat().st_size
    except OSError:  # removed since, or a link to nowhere
        size = 0
    return RunLine(
        run=path.name,
        procedure="",
        state="running" if under_way else "unreadable",
        started_ns=0,
        duration_s=0.0,
        trials_done=0,
        trials_total=0,
        size=size,
        has_report=False,
        has_page=is_drawn(path),
        identifies=False,
        condition="damaged" if isinstance(error, DamagedRecording) and not under_way else "",
        problem=None if under_way else problem,
    )
