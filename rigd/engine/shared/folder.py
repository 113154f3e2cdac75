"""Manages the folder in memory of a run: the lock of the rig, the job, the board and the rings.

The process that runs the rig holds the lock (flock) on ``<state>/<rig>/lock``. Every process that
it starts for the run inherits the lock. So the rig is in use until all of these processes have
ended. The lock file itself is never removed, so that two processes that wait for the lock never
hold two different files.
"""

from __future__ import annotations

import json
import os
import stat
import tempfile
import time
from collections.abc import Iterator, Mapping
from hashlib import blake2b
from pathlib import Path
from typing import Final, Self
from urllib.parse import quote

from rigd.engine.shared.board import Board, Word
from rigd.engine.shared.eventring import EventRing
from rigd.engine.shared.job import Job
from rigd.engine.shared.rowring import RowRing
from rigd.engine.shared.scarce import insist
from rigd.model.errors import Blocked, RecordingError

#: Environment variable that names the state folder.
STATE_VARIABLE: Final = "RIGD_STATE"
#: The processes with a ring of events: the cycle (trips, faults) and the daemon (all others).
EVENT_SOURCES: Final = ("cycle", "daemon")
#: Room for about 5000 events each, while no recorder runs.
EVENT_BYTES: Final = 1 << 20

_LOCK, _JOB, _BOARD = "lock", "job.json", "board"
#: Most bytes of a rig's name in the name of its folder; a file name has at most 255.
_NAME_BYTES: Final = 150
#: Interval of checks for a rig that will soon be free.
_LOOK_S: Final = 0.05


class InUse(Blocked):
    """Another process holds the rig; ``lives``: the process that took the rig still runs."""

    def __init__(self, reason: str, *, lives: bool = True) -> None:
        super().__init__([reason])
        self.lives = lives


class RunFolder:
    """The folder of one rig's run; :meth:`take` locks the rig, :meth:`at` opens without the lock.

    ``lock_fd`` is for ``pass_fds`` of the processes that the run starts; -1 if not held.
    """

    def __init__(self, path: Path, lock_fd: int = -1) -> None:
        """Use :meth:`take` or :meth:`at`."""
        self.path = path
        self.lock_fd = lock_fd

    @classmethod
    def take(
        cls, rig: str, *, command: str, recording: Path | None = None, patience_s: float = 0.0
    ) -> Self:
        """Lock the rig for this process; a process that waits sees ``command``, ``recording``.

        If the process of a run has ended, wait at most ``patience_s`` for its children.

        Raises:
            Blocked: the rig is in use, or the state folder is not private.
            RecordingError: the folder cannot be made.
        """
        until = time.monotonic() + patience_s
        while True:
            try:
                return cls.take_at(state_folder() / folder_name(rig), rig, command, recording)
            except InUse as error:
                if error.lives or time.monotonic() > until:
                    raise
            time.sleep(_LOOK_S)

    @classmethod
    def take_at(cls, path: Path, rig: str, command: str, recording: Path | None = None) -> Self:
        """Like :meth:`take`, for the rig whose folder is ``path``."""
        try:
            path.mkdir(mode=0o700, exist_ok=True)
            fd = os.open(path / _LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        except OSError as error:
            raise RecordingError(f"cannot make {path}: {error.strerror}") from error
        try:
            import fcntl  # Linux and macOS alone have it

            fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            in_use = _in_use(rig, fd)
            os.close(fd)
            raise in_use from error
        folder = cls(path, fd)
        try:
            folder.mark(command, recording)
        except RecordingError:
            folder.release()
            raise
        return folder

    @classmethod
    def at(cls, path: Path) -> Self:
        """Open the folder of a run for a process that its owner started."""
        return cls(path)

    def mark(
        self,
        command: str,
        recording: Path | None = None,
        *,
        hint: str = "",
        served: tuple[str, str] | None = None,
    ) -> None:
        """Leave a text for a process that wants the rig meanwhile; ``hint`` is the remedy.

        ``served`` are name and address of the rig, if clients reach it: see :func:`served_rigs`.

        Raises:
            RecordingError: there is no room for it.
        """
        mark = {
            "pid": os.getpid(),
            "command": command,
            "recording": None if recording is None else str(recording.absolute()),
            "hint": hint,
            "served": served,
        }
        text = json.dumps(mark).encode()
        try:
            # Truncated last: the page that the file already has always has room.
            os.pwrite(self.lock_fd, text, 0)
            os.ftruncate(self.lock_fd, len(text))
        except OSError as error:
            raise RecordingError(
                f"cannot write {self.path / _LOCK}: {error.strerror}",
                hint=f"{STATE_VARIABLE} names a folder in memory (tmpfs) with room.",
            ) from error

    @property
    def has_job(self) -> bool:
        """Whether the folder contains a run: in progress, or with all its processes ended."""
        return (self.path / _JOB).exists()

    @property
    def job(self) -> Job:
        """The run's job.

        Raises:
            RecordingError: it is missing, or cannot be read.
        """
        return Job.read(self.path / _JOB)

    def prepare(self, job: Job, capacities: Mapping[str, int]) -> None:
        """Make the board, a ring for each stream (with this number of rows) and those for events.

        Slot 0 is at the start of the job: the clock on the board has run since then.

        Raises:
            RecordingError: the folder still contains data of an earlier run, or has no room.
        """
        if self.has_job:
            raise RecordingError(
                f"{self.path} holds samples of an earlier run that are not in its recording yet",
                hint="`rigd recover` adds them to it.",
            )
        self.clear()  # data that was begun here and never completed
        board = Board.create(self.path / _BOARD)
        for number, stream in enumerate(job.streams):
            RowRing.create(self._rows(number), stream, capacities[stream.name])
        for source in EVENT_SOURCES:
            EventRing.create(self._events(source), EVENT_BYTES)
        # Making the rings took a while, and saving an earlier run's samples perhaps minutes: slot 0
        # was due at the start, or every time stamp would be late by that time.
        since_start_ns = max(time.time_ns() - job.start_ns, 0)  # a resumed run may begin later
        board[Word.START_NS] = job.start_ns
        board[Word.ORIGIN_NS] = time.monotonic_ns() - since_start_ns
        # Last, and in one step: a folder with a job is complete.
        draft = self.path / f"{_JOB}.new"
        draft.write_text(job.to_json())
        draft.replace(self.path / _JOB)

    def board(self) -> Board:
        """Return the board.

        Raises:
            RecordingError: it is missing.
        """
        return Board.attach(self.path / _BOARD)

    def ring_path(self, job: Job, stream: str) -> Path | None:
        """Return the path of the ring of ``stream``; None if it is not recorded."""
        names = [item.name for item in job.streams]
        return self._rows(names.index(stream)) if stream in names else None

    def row_rings(self, job: Job) -> dict[str, RowRing]:
        """Return the rings of all streams of ``job``, by name.

        Raises:
            RecordingError: a ring is missing.
        """
        return {
            stream.name: RowRing.attach(self._rows(number), stream)
            for number, stream in enumerate(job.streams)
        }

    def event_ring(self, source: str) -> EventRing:
        """Return the ring of one of EVENT_SOURCES.

        Raises:
            RecordingError: it is missing.
        """
        return EventRing.attach(self._events(source))

    def clear(self) -> None:
        """Remove the data of the run, the job first; the lock stays."""
        (self.path / _JOB).unlink(missing_ok=True)
        for path in self.remaining:
            path.unlink(missing_ok=True)

    @property
    def remaining(self) -> list[Path]:
        """The files of the run that still exist."""
        files = insist(lambda: list(self.path.iterdir()))
        return [path for path in files if path.name != _LOCK]

    def release(self) -> None:
        """Release the rig, if this process holds it."""
        if self.lock_fd >= 0:
            os.close(self.lock_fd)
            self.lock_fd = -1

    def _rows(self, number: int) -> Path:
        return self.path / f"rows-{number}.ring"

    def _events(self, source: str) -> Path:
        return self.path / f"events-{source}.ring"


def leftovers() -> Iterator[RunFolder]:
    """Yield the folders that contain a run, in progress or not; lock a folder before use.

    Raises:
        Blocked: the state folder is not private.
    """
    for path in sorted(state_folder().iterdir()):
        folder = RunFolder.at(path)
        if folder.has_job:
            yield folder


def served_rigs() -> dict[str, str]:
    """Return the address of each rig that a process of this user serves now, by name."""
    found = {}
    for path in sorted(_state_path().glob(f"*/{_LOCK}")):
        try:
            mark = json.loads(path.read_bytes())
            pid, served = int(mark["pid"]), mark.get("served")
        except (OSError, KeyError, TypeError, ValueError):
            continue  # it is being written, or of another version: then it is not listed
        if served is not None and _runs(pid):
            rig, endpoint = map(str, served)
            found[rig] = endpoint
    return found


def state_folder() -> Path:
    """Return the folder of this user's runs; make it if it is missing.

    RIGD_STATE, or else a folder in memory, so that no part of a run waits for a disk.

    Raises:
        Blocked: it belongs to another user, or others may write to it.
        RecordingError: it cannot be made.
    """
    path = _state_path()
    try:
        path.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = path.lstat()
    except OSError as error:
        raise RecordingError(
            f"cannot make the state folder {path}: {error.strerror}",
            hint=f"Set {STATE_VARIABLE} to a folder in memory that belongs to you.",
        ) from error
    private = stat.S_ISDIR(found.st_mode) and not found.st_mode & 0o077
    if found.st_uid != os.geteuid() or not private:
        raise Blocked(
            [
                f"the state folder {path} is not private: make it private (chmod 700), or set "
                f"{STATE_VARIABLE} to another folder"
            ]
        )
    return path


def folder_name(rig: str) -> str:
    """Return the name of a rig's folder: the rig's name, in characters of a file name."""
    name = quote(rig, safe=" ")
    if name.startswith("."):
        name = f"%2E{name[1:]}"
    if len(name) > _NAME_BYTES:
        name = f"{name[:_NAME_BYTES]}-{blake2b(rig.encode(), digest_size=8).hexdigest()}"
    return name


def _state_path() -> Path:
    given = os.environ.get(STATE_VARIABLE)
    if given:
        return Path(given)
    memory = Path("/dev/shm")
    if os.access(memory, os.W_OK | os.X_OK):
        return memory / f"rigd-{os.geteuid()}"
    session = os.environ.get("XDG_RUNTIME_DIR")
    if session:
        return Path(session) / "rigd"
    return Path(tempfile.gettempdir()) / f"rigd-{os.geteuid()}"


def _in_use(rig: str, fd: int) -> InUse:
    """Return the error with the text that the holder of the lock left."""
    try:
        mark = json.loads(os.pread(fd, 4096, 0))
        pid, command, recording = int(mark["pid"]), mark["command"], mark["recording"]
        hint = mark.get("hint", "")
    except (KeyError, TypeError, ValueError):
        return InUse(f"rig {rig} is in use by another process, which has just started")
    description = f"{command}, recording {recording}" if recording else command
    if not _runs(pid):
        children = f"children of process {pid} ({description}), which died; they are still ending"
        return InUse(f"rig {rig} is in use by {children}", lives=False)
    text = f"rig {rig} is in use by process {pid} ({description})"
    return InUse(f"{text}\n  {hint}" if hint else text)


def _runs(pid: int) -> bool:
    """Return whether a process runs; one that has ended but is not reaped does not."""
    try:
        os.kill(pid, 0)
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except (ProcessLookupError, FileNotFoundError):
        return False
    except PermissionError:
        return True  # it runs, under another user
    return state not in ("Z", "X")
