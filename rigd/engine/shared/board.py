"""Stores the status words and signs of life that the processes of a run share (the board).

Each word has one writer. A sign of life is a time of the monotonic clock, which all processes of a
machine share.
"""

from __future__ import annotations

from enum import IntEnum, unique
from pathlib import Path
from typing import Final, Self

from rigd.engine.shared.mapping import FIRST_FREE_WORD, SharedFile

_MAGIC: Final = b"rigdbrd1"


@unique
class Word(IntEnum):
    """Names the words of the board; the comment of each names the process that writes it."""

    BEAT_CYCLE = 0  #: cycle: its last sign of life, monotonic ns
    BEAT_DAEMON = 1  #: daemon
    BEAT_RECORDER = 2  #: recorder
    PID_CYCLE = 3  #: daemon: process id, 0 if there is no daemon yet
    PID_DAEMON = 4  #: daemon
    PID_RECORDER = 5  #: recorder
    PHASE = 6  #: daemon: a :class:`Phase`
    RECORDER_STATE = 7  #: recorder: a :class:`RecorderState`
    CYCLES = 8  #: cycle: cycles run
    MISSED = 9  #: cycle: slots skipped
    STALE = 10  #: cycle: rows without a new answer
    START_NS = 11  #: daemon: Unix time of slot 0, ns
    ORIGIN_NS = 12  #: daemon: monotonic time of slot 0, ns
    CYCLE_STATE = 13  #: cycle: a :class:`CycleState`
    AT_REST = 14  #: cycle: 1 while every setpoint has its rest value
    SILENT_DEVICES = 15  #: cycle: devices that have not returned a row yet
    SEALED = 16  #: recorder: bytes of the recording that do not change any more
    OURS = 17  #: cycle: 1 when every link is open, and so used by no other program
    HELD = 18  #: cycle: 1 while a pause holds the present step


class Phase(IntEnum):
    """The phase of a run; the recorder ends its work when the phase is ENDED."""

    UNDER_WAY = 0
    ENDED = 1  #: no process pushes any more; the rings are complete


class CycleState(IntEnum):
    """The state of the cycle process; it decides how long the process may be silent."""

    WAITING = 0  #: it waits for commands, or opens or closes devices
    TICKING = 1  #: it exchanges with the devices, slot by slot
    MAKING_SAFE = 2


class RecorderState(IntEnum):
    """The state of the recorder process."""

    STARTING = 0  #: no file yet
    RECORDING = 1
    FINISHED = 2  #: the file is complete, the rings are removed
    STOPPED = 3  #: the file is closed before the end, the rings wait for the next recorder
    FAILED = 4  #: the file could not be written; ``recorder.error`` has the reason


class Board:
    """``board[Word.X]`` reads and writes a word, a signed integer, which is 0 at first."""

    def __init__(self, file: SharedFile) -> None:
        """Use :meth:`create` or :meth:`attach`."""
        self._words = file.words.cast("B")[8 * FIRST_FREE_WORD :].cast("q")

    @classmethod
    def create(cls, path: Path) -> Self:
        """Make a board of zeros.

        Raises:
            RecordingError: it exists already, or there is no room for it.
        """
        return cls(SharedFile.create(path, _MAGIC, len(Word), 0))

    @classmethod
    def attach(cls, path: Path) -> Self:
        """Open a board that another process made.

        Raises:
            RecordingError: it is missing, or has another version.
        """
        return cls(SharedFile.attach(path, _MAGIC, len(Word)))

    def __getitem__(self, word: Word) -> int:
        return self._words[word]

    def __setitem__(self, word: Word, value: int) -> None:
        self._words[word] = value
