"""Permits one run or one device action at a time on a rig, and passes commands to the run.

Several threads call the methods: those of the server, the thread of the run and the main thread.
``_lock`` guards the data that they share; no thread waits for anything while it holds the lock.
"""

from __future__ import annotations

import itertools
import logging
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Final

from rigd.analysis.plan import judged
from rigd.config.lab.lab import stated_specimen
from rigd.config.rig import RigConfig
from rigd.daemon.execute import RunRequest, check_resumable, new_path
from rigd.daemon.live import Feed
from rigd.daemon.resume import ResumePoint, left_out, read_resume_point
from rigd.daemon.serve.idle_rig import IdleRig
from rigd.daemon.serve.library import Library
from rigd.daemon.serve.prompts import RemoteAnswers
from rigd.daemon.serve.running import RunListeners, Running
from rigd.daemon.serve.upkeep.notices import Notices
from rigd.daemon.serve.upkeep.trips import RememberedTrip, TripMemory
from rigd.engine.play.control import Control
from rigd.engine.play.interlocks import Trip
from rigd.engine.run.result import TimeLeft
from rigd.engine.shared import RunFolder
from rigd.model.about import About
from rigd.model.severity import Severity
from rigd.procedure.loader import parse_procedure
from rigd.procedure.program import OnClientLoss
from rigd.remote.protocol import ClientUser, Code, Refusal, Requester
from rigd.remote.protocol.arguments import ActArguments, Checked, StartArguments
from rigd.remote.protocol.results import Started
from rigd.remote.protocol.status import LastRun
from rigd.remote.server import Lease

_LOG: Final = logging.getLogger(__name__)
#: The hint if the rig is in use.
HINT: Final = (
    "steer it through its daemon: rigd remote start PROCEDURE --rig {rig}, "
    "or rigd remote act DEVICE tare"
)
#: The simulation of a rig has this seed unless a client gives another, as with `rigd run`.
SEED: Final = 1
#: The durations of so many dry runs are stored, the newest.
_EXPECTED: Final = 32
#: So often a daemon that waits for the end of its run looks whether a signal has come, in s.
_LOOK_S: Final = 0.2


@dataclass(frozen=True)
class Acting:
    """A device action that is in progress."""

    what: str
    control: Control


class Steering:
    """Starts and stops runs and device actions on ``rig``, whose ``folder`` this process holds.

    ``runs`` is the folder of recordings. ``changed`` is called when the status has changed,
    ``ended`` when a run has ended, ``settle`` before a run begins: it saves the data of an earlier
    run, and ends what is calculated for a start.
    """

    def __init__(
        self,
        rig: RigConfig,
        folder: RunFolder,
        runs: Path,
        *,
        library: Library,
        lease: Lease,
        feed: Feed,
        trips: TripMemory,
        notices: Notices,
        looks: IdleRig,
        changed: Callable[[], None],
        ended: Callable[[LastRun], None],
        settle: Callable[[], None],
    ) -> None:
        self.last: LastRun | None = None  #: how the last run ended
        self.stops = 0  #: how many were carried out: an older request begins nothing any more
        self._rig, self._folder, self._runs = rig, folder, runs
        self._library, self._lease, self._feed = library, lease, feed
        self._trips, self._notices = trips, notices
        self._looks = looks
        self._changed, self._ended, self._settle = changed, ended, settle
        self._lock = threading.Lock()
        self._running: Running | None = None
        self._acting: Acting | None = None
        self._preparing = False  #: whether a start is checked and compiled; nothing runs yet
        self._leaving = ""  #: why nothing begins any more
        # No id comes again: an answer to a prompt of an earlier daemon must not be accepted.
        self._prompt_ids = itertools.count(time.time_ns() // 1_000_000)
        self._expected_s: dict[tuple[str, frozenset[tuple[str, str]]], float] = {}
        self._mark()

    @property
    def running(self) -> Running | None:
        """The run under way."""
        return self._running

    def start(self, requester: Requester, args: StartArguments) -> Started:
        """Begin a run.

        Raises:
            Refusal: it cannot be.
            RigdError: the procedure does not fit, or the recording cannot be made.
        """
        with self._preparation():
            procedure = self._library.compile(args)
            rig = self._calibrated()
            loss = args.on_client_loss
            about = About(str(requester), args.note, args.meta, args.specimen)
            request = RunRequest(
                procedure,
                args.procedure.text,
                rig,
                seed=SEED if args.seed is None else args.seed,
                pace=self._pace,
                folder=self._runs,
                overrides=args.set,
                about=about,
                specimen=stated_specimen(about, rig.lab),
            )
            return self._begin(
                requester,
                replace(request, output=new_path(request)),
                by_person=args.answers == "ask",
                on_client_loss=procedure.on_client_loss if loss is None else OnClientLoss(loss),
                expected_s=self._expected_s.get(_key(args)),
            )

    def resume_run(self, requester: Requester, recording: Path, loss: str | None = None) -> Started:
        """Continue a run that ended before its last trial, in its file.

        ``loss`` is its action when its client vanishes; None: as its procedure specifies.

        Raises:
            Refusal: nothing is missing, or it cannot begin.
            RigdError: it was made with other files, or cannot be read.
        """
        with self._preparation():
            point = read_resume_point(recording, self._folder)
            rig = self._calibrated()
            procedure = judged(
                parse_procedure(_text(point), Path("procedure.yaml")),
                rig,
                point.overrides,
                done=left_out(rig, self._pace, point.done),
            )
            if len(point.done) >= len(procedure.trials):
                raise Refusal(Code.REFUSED, f"{recording.name} is complete: no trial is missing")
            request = RunRequest(
                procedure,
                _text(point),
                rig,
                seed=point.seed,
                pace=self._pace,
                output=recording,
                resume=point,
                overrides=point.overrides,
                about=About(operator=str(requester)),
            )
            check_resumable(request, point)
            return self._begin(
                requester,
                request,
                by_person=point.answered_by != "procedure",
                on_client_loss=procedure.on_client_loss if loss is None else OnClientLoss(loss),
            )

    def act(self, requester: Requester, args: ActArguments) -> str:
        """Perform an action of a device, and return the reply; nothing is armed.

        Raises:
            Refusal: it has no such action, or the rig is not free.
            RigdError: it could not be reached, or refused.
        """
        self._looks.check(args.device, args.action)
        control = Control()
        with self._lock:
            self._check_free_locked()
            self._acting = Acting(f"{args.action} of {args.device}", control)
        try:
            self._check_not_stopped(requester)
            self._looks.end()
            return self._looks.act(args.device, args.action, control)
        finally:
            with self._lock:
                self._acting = None
            self.show()

    def pause(self) -> None:
        """Pause in a step that can be held, or after the present trial.

        Raises:
            Refusal: no run is in progress.
        """
        self._run().control.pause_wanted = True

    def resume(self) -> None:
        """Cancel a pause, or the end after this trial.

        Raises:
            Refusal: no run is in progress.
        """
        self._run().control.resume()

    def answer(self, requester: Requester, prompt_id: int, value: float | str | bool) -> None:
        """Answer the prompt that waits.

        Raises:
            Refusal: none of that id waits, or it does not accept the answer.
        """
        answers = self._run().answers
        if answers is None:
            raise Refusal(Code.CONFLICT, "this run takes the procedure's own answers")
        answers.give(prompt_id, value, str(requester))

    def acknowledge(
        self, requester: Requester, interlock: str, since_ns: int | None = None
    ) -> None:
        """Acknowledge an interlock that has tripped, so that it no longer blocks a start.

        ``since_ns`` is the time of the trip that the client has seen; None: any.

        Raises:
            Refusal: it has nothing to acknowledge, or has tripped again since.
        """
        self._trips.acknowledge(interlock, str(requester), since_ns)
        running = self._running
        if running is not None:
            running.control.acknowledged.append(interlock)

    def stop(self, stop: Severity, reason: str) -> bool:
        """End the activity on the rig; return whether the request is new. Waits for nothing.

        A start or device action that was requested before does not begin any more.
        """
        self.stops += 1
        preparing = self._preparing
        busy = [item.control for item in (self._running, self._acting) if item is not None]
        new = [item for item in busy if item.asked is None or item.asked < stop]
        for control in new:
            control.request(stop, reason)
            control.pause_wanted = False
        return bool(new) or (preparing and not busy)

    def client_lost(self, lost: ClientUser) -> str:
        """Do what the run specifies for a lost client; return the action, as text."""
        running, holder = self._running, self._lease.view().holder
        if running is None:
            return "nothing was running"
        if holder is not None:
            return f"the run goes on, {holder} has taken over"
        return running.client_lost(lost)

    def expect(self, args: Checked, duration_s: float) -> None:
        """Store the duration of a dry run, for the remaining time of the run itself."""
        self._expected_s[_key(args)] = duration_s
        if len(self._expected_s) > _EXPECTED:
            del self._expected_s[next(iter(self._expected_s))]

    def show(self) -> None:
        """Show the channels, if requested and nothing else happens on the rig."""
        with self._lock:
            if self._running is None and self._acting is None and not self._leaving:
                self._looks.show()

    def tend(self) -> None:
        """Do periodic work."""
        running = self._running
        if running is not None:
            running.tend()
        self._trips.save()

    def leave(self, reason: str) -> Severity | None:
        """Prevent every start, and end the activity; each call ends it with a higher severity.

        Returns the requested stop. A signal handler may call it: it takes no lock.
        """
        self._leaving = reason
        running, acting = self._running, self._acting
        if acting is not None:
            acting.control.request(Severity.STOP, reason)
        return None if running is None else running.control.escalate(reason)

    def close(self) -> None:
        """Return when nothing happens on the rig any more; nothing can start again."""
        if not self._leaving:
            self.leave("the daemon has failed")
        running = self._running
        if running is not None:
            while not running.wait(_LOOK_S):  # a second signal that comes just before is heeded
                pass
        self._looks.end()
        self._trips.save()

    def _calibrated(self) -> RigConfig:
        """Return the rig with its calibration file as it is now.

        Raises:
            ConfigError: the file is wrong.
        """
        setup = self._rig.calibration
        return self._rig if setup is None else replace(self._rig, calibration=setup.read_again())

    @contextmanager
    def _preparation(self) -> Iterator[None]:
        """Check that a run may start, and let a stop end what is done within."""
        with self._lock:
            self._check_free_locked()
            self._preparing = True
        try:
            yield
        finally:
            self._preparing = False

    def _begin(
        self,
        requester: Requester,
        request: RunRequest,
        *,
        by_person: bool,
        on_client_loss: OnClientLoss,
        expected_s: float | None = None,
    ) -> Started:
        self._trips.begin_run()
        answers = RemoteAnswers(self._prompt_ids, self._changed) if by_person else None
        running = Running(
            request,
            self._folder,
            on_client_loss,
            answers,
            TimeLeft(expected_s),
            RunListeners(
                begun=self._begun,
                moved=self._changed,
                tripped=self._tripped,
                notified=self._notices.note,
                ended=self._over,
            ),
        )
        with self._lock:
            self._check_free_locked()
            self._running = running
        if self._leaving:  # a signal that came since
            running.control.request(Severity.STOP, self._leaving)
        try:
            self._check_not_stopped(requester)
            # Reading a long file may take longer than the lease lasts. From here on, a lost lease
            # has the effect on this run that the request states.
            self._lease.check(requester.client)
            self._looks.end()
            self._settle()
            self._mark(running.recording)
            running.start()
        except BaseException:
            self._running = None
            self.show()
            raise
        self._notices.note(f"{requester} began {request.procedure.name}: {running.recording.name}")
        return Started(run=running.recording.name)

    def _begun(self) -> None:
        """The run's rings are there."""
        try:
            self._feed.attach(self._folder)
        except Exception as error:  # noqa: BLE001 - it is recorded all the same
            self._notices.note(f"the run cannot be shown: {error}", "error")

    def _tripped(self, trips: Sequence[Trip]) -> None:
        self._trips.note(RememberedTrip.of(trip) for trip in trips)
        self._changed()

    def _over(self, last: LastRun) -> None:
        """Note that the run has ended; called from its thread. A step that fails skips no other."""
        for step in (self._feed.detach, self._trips.save, self._mark, partial(self._ended, last)):
            try:
                step()
            except Exception as error:  # noqa: BLE001 - the daemon lives on, and shows the rig
                _LOG.exception("the end of a run was not noted completely")
                self._notices.note(f"after the end of {last.run}: {error}", "error")
        with self._lock:
            # Together: a client that sees that nothing runs also sees how the run ended.
            self.last, self._running = last, None
        self._notices.note(
            f"{last.run}: {last.ending}: {last.reason}",
            "warning" if last.exit_code else "info",
        )
        self.show()

    def _run(self) -> Running:
        running = self._running
        if running is None:
            raise Refusal(Code.CONFLICT, "nothing is running")
        return running

    def _check_free_locked(self) -> None:
        if self._leaving:
            raise Refusal(Code.CONFLICT, f"the daemon is ending: {self._leaving}")
        if self._running is not None:
            name = self._running.request.procedure.name
            raise Refusal(Code.CONFLICT, f"{name} is running", hint="wait for its end, or stop it")
        if self._acting is not None:
            raise Refusal(Code.CONFLICT, f"{self._acting.what} is under way")

    def _check_not_stopped(self, requester: Requester) -> None:
        """Refuse what was requested before a stop; the activity must be known to :meth:`stop`."""
        if requester.stops != self.stops:
            raise Refusal(
                Code.CONFLICT,
                "stopped before it began",
                hint="a stop came after this request; if it is to begin all the same, repeat it",
            )

    @property
    def _pace(self) -> float | None:
        """On a rig simulated in process, the pace of the wall; else its devices set it."""
        return None if self._rig.plant is None else 1.0

    def _mark(self, recording: Path | None = None) -> None:
        rig = self._rig
        hint, served = HINT.format(rig=rig.name), (rig.name, rig.remote.endpoint)
        self._folder.mark("rigd serve", recording, hint=hint, served=served)


def _key(args: Checked) -> tuple[str, frozenset[tuple[str, str]]]:
    """Return the properties on which the duration of a run depends."""
    return args.procedure.sha256, frozenset(args.set.items())


def _text(point: ResumePoint) -> str:
    return point.texts["procedure.yaml"].decode()
