"""The board: status words and signs of life that the processes of a run share.

Each word has one writer. Signs of life are times of the monotonic clock, which all processes of a
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
    """The words of the board; behind each, who writes it."""

    BEAT_CYCLE = 0  #: cycle: its last sign of life, monotonic ns
    BEAT_DAEMON = 1  #: daemon
    BEAT_RECORDER = 2  #: recorder
    PID_CYCLE = 3  #: daemon: process id, 0 where there is none yet
    PID_DAEMON = 4  #: daemon
    PID_RECORDER = 5  #: recorder
    PHASE = 6  #: daemon: a :class:`Phase`
    RECORDER_STATE = 7  #: recorder: a :class:`RecorderState`
    CYCLES = 8  #: cycle: cycles run
    MISSED = 9  #: cycle: slots skipped
    STALE = 10  #: cycle: rows without a fresh answer
    START_NS = 11  #: daemon: Unix time of slot 0, ns
    ORIGIN_NS = 12  #: daemon: monotonic time of slot 0, ns
    CYCLE_STATE = 13  #: cycle: a :class:`CycleState`
    AT_REST = 14  #: cycle: 1 while every setpoint stands at its rest value
    MUTE = 15  #: cycle: devices that have not given a row yet
    SEALED = 16  #: recorder: bytes of the recording that nothing changes again
    OURS = 17  #: cycle: 1 once every link is open, and so nobody else's


class Phase(IntEnum):
    """How far a run is, for those who must know when to end."""

    UNDER_WAY = 0
    ENDED = 1  #: nobody pushes any more; what is in the rings is all there is


class CycleState(IntEnum):
    """What the cycle is at, which says how long it may be silent."""

    WAITING = 0  #: for commands, or for devices that are opened or closed
    TICKING = 1  #: exchanging with the devices, slot by slot
    MAKING_SAFE = 2


class RecorderState(IntEnum):
    """What the recorder is at."""

    STARTING = 0  #: no file yet
    RECORDING = 1
    FINISHED = 2  #: the file is complete, the rings are gone
    STOPPED = 3  #: the file is closed before the end, the rings wait for the next recorder
    FAILED = 4  #: the file could not be written; ``recorder.error`` says why


class Board:
    """``board[Word.X]`` reads and writes a word, a signed integer, 0 in the beginning."""

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
            RecordingError: it is missing, or that of another version.
        """
        return cls(SharedFile.attach(path, _MAGIC, len(Word)))

    def __getitem__(self, word: Word) -> int:
        return self._words[word]

    def __setitem__(self, word: Word, value: int) -> None:
        self._words[word] = value
