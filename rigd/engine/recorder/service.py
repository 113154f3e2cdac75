"""Runs the recorder process: moves rows from the rings to disk until the run ends.

The recorder ends when the daemon reports the end of the run, or when daemon and cycle are both
gone. On SIGTERM it writes the rows that are in the rings to disk, and leaves the rest to another
recorder. If the disk fails, the recorder reports the error and continues to run; the rings then
hold as many rows as they can.
"""

from __future__ import annotations

import os
import signal
import time
from typing import Final

from rigd.engine.recorder.transfer import Transfer
from rigd.engine.shared import Board, Phase, RecorderState, RunFolder, Word
from rigd.model.errors import Exit, RecordingError
from rigd.model.machine.other_process import OtherProcess

#: File in the run's folder with the error that stopped the recording.
ERROR_FILE: Final = "recorder.error"
#: With a flush at each, data are on disk after at most this time and a write.
EVERY_S: Final = 0.05
#: Daemon and cycle must both be missing for this time: one of them may just be starting the other.
MISSING_S: Final = 0.5


class RecorderService:
    """Runs one recorder process on ``folder``."""

    def __init__(self, folder: RunFolder) -> None:
        self._folder = folder
        self._board = folder.board()
        self._others = Others(self._board)

    def run(self) -> Exit:
        """Record until the run has ended; return the exit code."""
        # Waited for, never delivered in the middle of work. INT and HUP are for the daemon.
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
        self._board[Word.PID_RECORDER] = os.getpid()
        self._beat()
        try:
            finished = self._record()
        except RecordingError as error:
            return self._fail(error)
        except OSError as error:
            return self._fail(RecordingError(f"the recorder cannot continue: {error}"))
        if finished:
            # Before the board is removed: a daemon that sees neither would start another recorder.
            self._board[Word.RECORDER_STATE] = RecorderState.FINISHED
            self._folder.clear()
        else:
            self._board[Word.RECORDER_STATE] = RecorderState.STOPPED
        return Exit.OK

    def _record(self) -> bool:
        """Record until the run has ended, or until SIGTERM; return whether it has ended."""
        transfer = Transfer(self._folder)
        try:
            transfer.open(trusted=self._board[Word.SEALED])
            self._board[Word.SEALED] = transfer.sealed
            self._board[Word.RECORDER_STATE] = RecorderState.RECORDING
            stop_requested = False
            # Checked before the rings are emptied for the last time: no process pushes any more.
            while not (reason := self._over()):
                if stop_requested:
                    transfer.pause()
                    return False
                transfer.move()
                self._board[Word.SEALED] = transfer.sealed
                stop_requested = self._stop_requested()
            transfer.finish(reason)
            return True
        finally:
            transfer.close()

    def _fail(self, error: RecordingError) -> Exit:
        """Report the error, and give signs of life until the run has ended."""
        draft = self._folder.path / f"{ERROR_FILE}.new"
        draft.write_text(str(error))
        draft.replace(self._folder.path / ERROR_FILE)
        self._board[Word.RECORDER_STATE] = RecorderState.FAILED
        while not self._over() and not self._stop_requested():
            pass
        return error.exit_code

    def _over(self) -> str:
        """Return why no process pushes any more, or ""."""
        if self._board[Word.PHASE] == Phase.ENDED:
            return "the run did not report how it ended"
        if self._others.missing():
            return "the processes of the run were killed"
        return ""

    def _stop_requested(self) -> bool:
        """Wait until the next round; return whether SIGTERM came."""
        stop_requested = signal.sigtimedwait({signal.SIGTERM}, EVERY_S)
        self._beat()
        return stop_requested is not None

    def _beat(self) -> None:
        self._board[Word.BEAT_RECORDER] = time.monotonic_ns()


class Others:
    """Checks whether the daemon and the cycle, whose process ids are on the board, still run."""

    def __init__(self, board: Board) -> None:
        self._board = board
        self._processes: dict[int, OtherProcess] = {}  #: by process id
        self._missing_since: float | None = None

    def missing(self) -> bool:
        """Return whether both are missing for MISSING_S; a daemon never named does not count."""
        pids = [self._board[Word.PID_DAEMON], self._board[Word.PID_CYCLE]]
        if not pids[0] or not all(self._dead(pid) for pid in pids if pid):
            self._missing_since = None
            return False
        now = time.monotonic()
        if self._missing_since is None:
            self._missing_since = now
        return now - self._missing_since >= MISSING_S

    def _dead(self, pid: int) -> bool:
        if pid not in self._processes:
            self._processes[pid] = OtherProcess(pid)
        return self._processes[pid].ended()
