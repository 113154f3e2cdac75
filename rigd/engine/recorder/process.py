"""Starts, supervises and restarts the recorder process, and waits until it has finished."""

from __future__ import annotations

import os
import time
from enum import Enum, auto
from typing import Final

from rigd.engine.recorder.service import ERROR_FILE
from rigd.engine.shared import RecorderState, RunFolder, Word
from rigd.engine.shared.scarce import insist
from rigd.engine.system.child import Child, module
from rigd.model.errors import RecordingError

#: Output of the recorder, which is empty unless it has a bug.
LOG_FILE: Final = "recorder.log"
#: A disk may take this long for one flush; the rings hold a minute.
SILENCE_S: Final = 10.0
#: To continue a file, the recorder reads all of it: 1 GB takes about 1 s.
START_S: Final = 60.0
#: A recorder that fails more often than this while a run ends has a bug.
MOST_DEATHS: Final = 5
_LOOK_S: Final = 0.005
#: Longest wait for a free descriptor: shorter than the silence that the cycle accepts.
_PATIENCE_S: Final = 0.2
#: A killed process ends within this time, unless the kernel holds it.
_REAP_S: Final = 0.25


class Health(Enum):
    """The state of the recorder process."""

    WELL = auto()
    SILENT = auto()  #: no sign of life: it hangs, or was stopped
    DIED = auto()  #: ended early, killed or on request
    FAILED = auto()  #: it cannot write the recording, and reports why
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
        """Process id of the recorder; 0 before the start."""
        return 0 if self._child is None else self._child.pid

    def start(self) -> None:
        """Start the process; :meth:`wait_until_recording` reports when it is ready.

        This process is the daemon that the recorder then watches.
        """
        self._board[Word.PID_DAEMON] = os.getpid()
        self._board[Word.RECORDER_STATE] = RecorderState.STARTING
        self._started_ns = time.monotonic_ns()
        path = self._folder.path
        command = module("rigd.engine.recorder", str(path))
        self._child = Child(
            command, log=path / LOG_FILE, fds=(self._folder.lock_fd,), preferred=True
        )

    def wait_until_recording(self, timeout_s: float = START_S) -> None:
        """Return when the file exists and rows are accepted.

        Raises:
            RecordingError: the file cannot be written, or it took too long; the process has ended.
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
        """The state that the recorder reports."""
        return RecorderState(self._board[Word.RECORDER_STATE])

    def poll(self, silence_s: float = SILENCE_S) -> Health:
        """Return the health of the recorder; ``silence_s`` without a sign of life is silent."""
        has_ended = self._child is None or self._child.code is not None
        state = self.state  # read after the state: its last report
        if state is RecorderState.FAILED:
            return Health.FAILED
        if has_ended:
            return Health.ENDED if state is RecorderState.FINISHED else Health.DIED
        bound_s = START_S if state is RecorderState.STARTING else silence_s
        alive_ns = max(self._board[Word.BEAT_RECORDER], self._started_ns)
        if time.monotonic_ns() - alive_ns > bound_s * 1e9:
            return Health.DIED if self.fate else Health.SILENT
        return Health.WELL

    @property
    def fate(self) -> str:
        """How it ended, in words that follow its name; "" while it runs."""
        return "" if self._child is None else self._child.fate(0.0)

    def restart(self) -> None:
        """Make sure that the process has ended, then start it again with the same task.

        A process that the kernel holds, because its disk does not respond, cannot be waited for:
        the daemon would be silent meanwhile. A later call starts it again, when the process has
        ended.
        """
        if self._kill():
            insist(self.start, _PATIENCE_S)
        else:
            self._started_ns = time.monotonic_ns()  # not judged again for a while

    def finish(self, timeout_s: float = START_S) -> None:
        """Wait until the recording is closed; the board must show that the run has ended.

        The run's folder is then cleared. A recorder that fails or is silent meanwhile is started
        again.

        Raises:
            RecordingError: the recording could not be completed, with the message of the recorder;
                the rings stay as they are.
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
                if self._child is not None:
                    self._child.leave(0.0)
                raise RecordingError(
                    f"the recorder has not closed the recording within {timeout_s:g} s",
                    hint="The recorder continues; `rigd recover` reports the result.",
                )
            time.sleep(_LOOK_S)
        if self._child is not None:
            self._child.wait(None)
        self._folder.clear()

    def discard(self) -> None:
        """End the process before anything was sampled; a recording that it made new is removed."""
        self._kill()
        if self.state is RecorderState.RECORDING and not (job := self._folder.job).resume:
            job.recording.unlink(missing_ok=True)

    def _kill(self) -> bool:
        """Kill the process; return whether it has ended."""
        return self._child is None or self._child.fence(_REAP_S)

    def _failure(self) -> RecordingError:
        """Return the error of the recorder; it does nothing more."""
        self._kill()
        message, _, hint = (self._folder.path / ERROR_FILE).read_text().partition("\n")
        return RecordingError(message, hint=hint.strip() or None)

    def _death(self) -> RecordingError:
        last = "" if self._child is None else self._child.last_words()
        return RecordingError(
            f"the recorder process {self.fate or 'is silent'}: {last or 'it left no message'}",
            hint="`rigd recover` adds the remaining samples to the recording.",
        )
