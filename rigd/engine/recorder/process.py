"""Starts, supervises and restarts the recorder process, and waits until it has finished."""

from __future__ import annotations

import os
import time
from enum import Enum, auto
from typing import Final

from rigd.engine.child import Child, module
from rigd.engine.recorder.service import ERROR_FILE
from rigd.engine.shared import RecorderState, RunFolder, Word
from rigd.engine.shared.scarce import insist
from rigd.model.errors import RecordingError

#: What the recorder prints, which is nothing unless it has a bug.
LOG_FILE: Final = "recorder.log"
#: A disk may take this long for one flush; the rings hold a minute.
SILENCE_S: Final = 10.0
#: Opening a file to go on with it reads all of it: 1 GB takes about 1 s.
START_S: Final = 60.0
#: A recorder that dies more often than this while a run ends has a bug.
MOST_DEATHS: Final = 5
_LOOK_S: Final = 0.005
#: How long a descriptor for it is waited for: less than the silence that the cycle bears.
_PATIENCE_S: Final = 0.2
#: A process that was killed is gone within this, unless the kernel holds it.
_REAP_S: Final = 0.25


class Health(Enum):
    """How the recorder process is."""

    WELL = auto()
    SILENT = auto()  #: no sign of life: it hangs, or was stopped
    DIED = auto()  #: gone before the end, killed or told to
    FAILED = auto()  #: it cannot write the recording, and says why
    ENDED = auto()  #: the recording is closed


class RecorderProcess:
    """The recorder of the run in ``folder``, which this process holds."""

    def __init__(self, folder: RunFolder) -> None:
        self._folder = folder
        self._board = folder.board()
        self._child: Child | None = None
        self._started_ns = 0

    @property
    def pid(self) -> int:
        """Process id of the recorder; 0 before it was started."""
        return 0 if self._child is None else self._child.pid

    def start(self) -> None:
        """Start the process; :meth:`wait_until_recording` says when it is ready.

        This process is the daemon that the recorder then watches.
        """
        self._board[Word.PID_DAEMON] = os.getpid()
        self._board[Word.RECORDER_STATE] = RecorderState.STARTING
        self._started_ns = time.monotonic_ns()
        path = self._folder.path
        command = module("rigd.engine.recorder", str(path))
        self._child = Child(command, log=path / LOG_FILE, fds=(self._folder.lock_fd,))

    def wait_until_recording(self, timeout_s: float = START_S) -> None:
        """Return once the file is there and rows are taken.

        Raises:
            RecordingError: the file cannot be written, or it took too long; the process is gone.
        """
        deadline = time.monotonic() + timeout_s
        while self.state is RecorderState.STARTING:
            if self.poll() is Health.DIED:
                raise self._death()
            if time.monotonic() > deadline:
                self._kill()
                raise RecordingError(f"the recorder did not begin within {timeout_s:g} s")
            time.sleep(_LOOK_S)
        if self.state is RecorderState.FAILED:
            raise self._failure()

    @property
    def state(self) -> RecorderState:
        """What the recorder says it is at."""
        return RecorderState(self._board[Word.RECORDER_STATE])

    def poll(self, silence_s: float = SILENCE_S) -> Health:
        """Return how the recorder is; it is silent after ``silence_s`` without a sign of life."""
        gone = self._child is None or self._child.code is not None
        state = self.state  # asked after: the last that it said
        if state is RecorderState.FAILED:
            return Health.FAILED
        if gone:
            return Health.ENDED if state is RecorderState.FINISHED else Health.DIED
        bound_s = START_S if state is RecorderState.STARTING else silence_s
        alive_ns = max(self._board[Word.BEAT_RECORDER], self._started_ns)
        if time.monotonic_ns() - alive_ns > bound_s * 1e9:
            return Health.SILENT
        return Health.WELL

    def restart(self) -> None:
        """Make sure that the process is dead, then start it again where it was.

        One that the kernel holds, as its disk does not answer, cannot be waited for: that would
        silence the daemon. It is started again by a later call, once it is gone.
        """
        if self._kill():
            insist(self.start, _PATIENCE_S)
        else:
            self._started_ns = time.monotonic_ns()  # not judged again for a while

    def finish(self, timeout_s: float = START_S) -> None:
        """Wait until the recording is closed; the board must say that the run has ended.

        The run's folder is then cleared. A recorder that dies or falls silent meanwhile is
        started again.

        Raises:
            RecordingError: the recording could not be kept, in the recorder's own words; the
                rings stay where they are.
        """
        deadline = time.monotonic() + timeout_s
        deaths = 0
        while (health := self.poll()) is not Health.ENDED:
            if health is Health.FAILED:
                raise self._failure()
            if health is not Health.WELL:
                deaths += 1
                if deaths > MOST_DEATHS:
                    raise self._death()
                self.restart()
            if time.monotonic() > deadline:
                raise RecordingError(
                    f"the recorder has not closed the recording within {timeout_s:g} s",
                    hint="It goes on; `rigd recover` says what became of it.",
                )
            time.sleep(_LOOK_S)
        if self._child is not None:
            self._child.wait(None)
        self._folder.clear()

    def _kill(self) -> bool:
        """Kill the process; return whether it is gone."""
        return self._child is None or self._child.fence(_REAP_S)

    def _failure(self) -> RecordingError:
        """Return what the recorder has to say; nothing more is to be had of it."""
        self._kill()
        message, _, hint = (self._folder.path / ERROR_FILE).read_text().partition("\n")
        return RecordingError(message, hint=hint.strip() or None)

    def _death(self) -> RecordingError:
        cause = "" if self._child is None else self._child.ended
        last = "" if self._child is None else self._child.last_words()
        return RecordingError(
            f"the recorder process died ({cause or 'it was silent'}): "
            f"{last or 'it left no message'}",
            hint="`rigd recover` puts what it left into the recording.",
        )
