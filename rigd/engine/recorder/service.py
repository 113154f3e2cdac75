"""The main loop of the recorder process: moves rows from the rings to disk until the run ends.

It ends when the daemon says that the run has, or when daemon and cycle are both gone; on SIGTERM
it puts what there is on disk and leaves the rest to another recorder. Where the disk fails it says
so, and stays: the rings then hold what they can.
"""

from __future__ import annotations

import os
import select
import signal
import time
from typing import Final

from rigd.engine.recorder.transfer import Transfer
from rigd.engine.shared import Board, Phase, RecorderState, RunFolder, Word
from rigd.model.errors import Exit, RecordingError

#: File in the run's folder with what kept the recorder from recording.
ERROR_FILE: Final = "recorder.error"
#: With the flush at each, what is not on disk is never older than this and a write.
EVERY_S: Final = 0.05
#: Daemon and cycle must be gone for this long: one may just be starting the other.
GONE_S: Final = 0.5


class RecorderService:
    """One recorder process at work on ``folder``."""

    def __init__(self, folder: RunFolder) -> None:
        self._folder = folder
        self._board = folder.board()
        self._others = Others(self._board)

    def run(self) -> Exit:
        """Record until the run is over; return how that went."""
        # Waited for, never delivered in the middle of something. INT and HUP are for the daemon.
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
            return self._fail(RecordingError(f"the recorder cannot go on: {error}"))
        if finished:
            # Said before the board goes: who sees neither would start another recorder.
            self._board[Word.RECORDER_STATE] = RecorderState.FINISHED
            self._folder.clear()
        else:
            self._board[Word.RECORDER_STATE] = RecorderState.STOPPED
        return Exit.OK

    def _record(self) -> bool:
        """Record until the run is over, or until told to stop; return whether it is over."""
        transfer = Transfer(self._folder)
        try:
            transfer.open(trusted=self._board[Word.SEALED])
            self._board[Word.SEALED] = transfer.sealed
            self._board[Word.RECORDER_STATE] = RecorderState.RECORDING
            told = False
            # Asked before the rings are emptied for the last time: nobody pushes any more.
            while not (reason := self._over()):
                if told:
                    transfer.pause()
                    return False
                transfer.move()
                self._board[Word.SEALED] = transfer.sealed
                told = self._told_to_stop()
            transfer.finish(reason)
            return True
        finally:
            transfer.close()

    def _fail(self, error: RecordingError) -> Exit:
        """Say what is wrong, and show signs of life until the run is over."""
        draft = self._folder.path / f"{ERROR_FILE}.new"
        draft.write_text(str(error))
        draft.replace(self._folder.path / ERROR_FILE)
        self._board[Word.RECORDER_STATE] = RecorderState.FAILED
        while not self._over() and not self._told_to_stop():
            pass
        return error.exit_code

    def _over(self) -> str:
        """Return why nobody pushes any more, or an empty text."""
        if self._board[Word.PHASE] == Phase.ENDED:
            return "the run did not say how it ended"
        if self._others.gone():
            return "the processes of the run were killed"
        return ""

    def _told_to_stop(self) -> bool:
        """Wait until the next round; return whether SIGTERM came."""
        told = signal.sigtimedwait({signal.SIGTERM}, EVERY_S)
        self._beat()
        return told is not None

    def _beat(self) -> None:
        self._board[Word.BEAT_RECORDER] = time.monotonic_ns()


class Others:
    """The daemon and the cycle, as far as the board names them."""

    def __init__(self, board: Board) -> None:
        self._board = board
        self._handles: dict[int, int | None] = {}  #: pidfd by process id; None: it was gone
        self._gone_since: float | None = None

    def gone(self) -> bool:
        """Return whether both have been dead for GONE_S; a daemon never named does not count."""
        pids = [self._board[Word.PID_DAEMON], self._board[Word.PID_CYCLE]]
        if not pids[0] or not all(self._dead(pid) for pid in pids if pid):
            self._gone_since = None
            return False
        now = time.monotonic()
        if self._gone_since is None:
            self._gone_since = now
        return now - self._gone_since >= GONE_S

    def _dead(self, pid: int) -> bool:
        if pid not in self._handles:
            try:
                self._handles[pid] = os.pidfd_open(pid)
            except ProcessLookupError:
                self._handles[pid] = None
        handle = self._handles[pid]
        return handle is None or bool(select.select([handle], [], [], 0)[0])
