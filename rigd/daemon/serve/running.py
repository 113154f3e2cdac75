"""Executes a run in a thread of the daemon and passes requests to the run."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from rigd.daemon.execute import RunRequest, perform
from rigd.daemon.serve.prompts import RemoteAnswers
from rigd.engine.play.control import Control
from rigd.engine.play.interlocks import Trip
from rigd.engine.run.result import Progress, TimeLeft
from rigd.engine.shared import RunFolder
from rigd.model.errors import Blocked, Exit, RigdError
from rigd.model.severity import Severity
from rigd.model.states import RunState
from rigd.procedure.program import CycleProgram, OnClientLoss
from rigd.remote.protocol import ClientUser
from rigd.remote.protocol.limits import LEASE_S
from rigd.remote.protocol.status import LastRun

_LOG: Final = logging.getLogger(__name__)


def loss_of(holder: ClientUser, also: str = "") -> str:
    """Return in words what is known of a holder whose lease has run out; a user has a page."""
    who = f"{holder.user}'s page ({holder.identity})" if holder.user else str(holder)
    if also and not holder.user:
        who += f", {also},"
    return f"{who} gave no sign of life for {LEASE_S:g} s"


@dataclass(frozen=True)
class RunListeners:
    """Functions that the thread of a run calls at events; only ``ended`` may wait.

    ``begun``: its rings and its file exist. ``moved``: it is in another state, step or trial.
    ``tripped``: interlocks have tripped. ``notified``: a line for the operator. ``ended``: it has
    ended completely, and how.
    """

    begun: Callable[[], None]
    moved: Callable[[], None]
    tripped: Callable[[Sequence[Trip]], None]
    notified: Callable[[str], None]
    ended: Callable[[LastRun], None]


@dataclass
class Running:
    """A run of ``request``, on a rig held by ``folder``.

    ``request.output`` must name the recording. ``answers`` None: the procedure's own.
    """

    request: RunRequest
    folder: RunFolder
    on_client_loss: OnClientLoss
    answers: RemoteAnswers | None
    left: TimeLeft
    listeners: RunListeners
    control: Control = field(default_factory=Control)
    progress: Progress = field(init=False)
    can_be_held: frozenset[str] = field(init=False)  #: the names of the steps with `hold`
    _thread: threading.Thread = field(init=False)

    def __post_init__(self) -> None:
        done = 0 if self.request.resume is None else len(self.request.resume.done)
        total = len(self.request.procedure.trials)
        self.progress = Progress(RunState.PREFLIGHT, "", done, total, None, 0.0)
        self.can_be_held = frozenset(
            segment.name
            for step in self.request.procedure.steps()
            if isinstance(step, CycleProgram)
            for segment in step.segments
            if segment.hold is not None
        )
        self._thread = threading.Thread(target=self._work, name="run", daemon=True)

    @property
    def recording(self) -> Path:
        """The file it is recorded to."""
        path = self.request.output
        if path is None:
            raise RuntimeError("a run of the daemon was not given a file")
        return path

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def wait(self, timeout_s: float | None = None) -> bool:
        """Wait for the end; return whether it has come."""
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def client_lost(self, holder: ClientUser) -> str:
        """Do what the procedure specifies for a lost client; return the action, as text."""
        reason = loss_of(holder, "who steered this run")
        match self.on_client_loss:
            case OnClientLoss.CONTINUE:
                return "the run goes on"
            case OnClientLoss.FINISH_TRIAL:
                self.control.end_after_trial(reason)
                return "the run stops after this trial"
            case OnClientLoss.STOP:
                self.control.request(Severity.STOP, reason)
                return "the run is stopped"

    def tend(self) -> None:
        """End a run at once that is to end after its trial, but waits for a person."""
        wanted = self.control.last_trial
        waits = self.progress.state is RunState.HELD
        if wanted and (waits or (self.answers is not None and self.answers.waits)):
            self.control.request(Severity.STOP, wanted)

    def _watch(self, progress: Progress) -> None:
        before, self.progress = self.progress, progress
        self.left.watch(progress)
        while self.control.notices:
            self.listeners.notified(self.control.notices.popleft())
        if len(progress.trips) > len(before.trips):
            self.listeners.tripped(progress.trips[len(before.trips) :])
        if _place(progress) != _place(before):
            self.listeners.moved()

    def _work(self) -> None:
        last = LastRun(run=self.recording.name, ending="faulted", reason="", exit_code=1)
        try:
            last = self._perform()
        finally:
            if self.answers is not None:
                self.answers.withdraw()
            self.listeners.ended(last)

    def _perform(self) -> LastRun:
        name = self.recording.name
        try:
            result = perform(
                self.request,
                self.control,
                answers=self.answers,
                watch=self._watch,
                announce=lambda _: self.listeners.begun(),
                held=self.folder,
            ).result
        except Blocked as error:
            return self._failed("blocked", "; ".join(error.reasons), error.exit_code)
        except RigdError as error:
            return self._failed("faulted", error.one_line, error.exit_code)
        except Exception as error:  # noqa: BLE001 - the thread's boundary: the rig is safe, the daemon lives on
            _LOG.exception("the run failed by a bug in rigd")
            return self._failed("faulted", f"{type(error).__name__}: {error}", Exit.INTERNAL)
        reason = "; ".join([result.reason, *result.problems])
        return _last(name, result.ending, reason, result.exit_code)

    def _failed(self, ending: str, reason: str, code: Exit) -> LastRun:
        """Return how a run ended that may not even have begun its file."""
        last = _last(self.recording.name, ending, reason, code)
        return last.model_copy(update={"recorded": self.recording.exists()})


def _place(progress: Progress) -> tuple[object, ...]:
    """Return the progress of a run, without values that change all the time."""
    return (
        progress.state,
        progress.step,
        progress.trial,
        progress.trials_done,
        progress.coming_to_rest,
    )


def _last(run: str, ending: str, reason: str, code: Exit) -> LastRun:
    return LastRun(run=run, ending=ending, reason=reason, exit_code=int(code))
