"""Carries out the requests of clients on one rig (:class:`rigd.remote.server.Service`)."""

from __future__ import annotations

import itertools
import os
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from rigd import __version__
from rigd.config.rig import RigConfig
from rigd.daemon.live import Feed
from rigd.daemon.provenance import trial_label
from rigd.daemon.serve.asker import Asker
from rigd.daemon.serve.audit import AuditLog
from rigd.daemon.serve.describe import describe
from rigd.daemon.serve.descriptors import Descriptors
from rigd.daemon.serve.library import Library
from rigd.daemon.serve.notices import Notices, one_line
from rigd.daemon.serve.recordings import Recordings, is_drawn
from rigd.daemon.serve.recovery import Interruptions
from rigd.daemon.serve.running import Running
from rigd.daemon.serve.steering import Steering
from rigd.daemon.serve.trips import TripMemory
from rigd.daemon.serve.worker import CalculationWorker
from rigd.model.errors import ConfigError, RigdError
from rigd.model.pages import page_of
from rigd.model.severity import Severity
from rigd.procedure.program import CompiledProcedure, TrialPlan
from rigd.remote.protocol import (
    VERSION,
    Code,
    LeaseView,
    Message,
    Refusal,
    Role,
    Status,
    as_json,
)
from rigd.remote.protocol.arguments import (
    ActArguments,
    Answered,
    Checked,
    InterlockName,
    PieceArguments,
    ProcedureName,
    ReportPiece,
    ResumeRun,
    RunArguments,
    Runs,
    Since,
    StartArguments,
    StreamName,
)
from rigd.remote.protocol.results import (
    ActionReply,
    CheckReport,
    DryRun,
    Events,
    Nothing,
    PieceView,
    Reported,
    Stopped,
)
from rigd.remote.protocol.status import Daemon, RefusedCounts, TrialStatus
from rigd.remote.server import Lease

#: Commands that say nothing about what was done: the lease is renewed every two seconds, and pages
#: of past runs are looked at.
UNAUDITED: Final = frozenset({"lease_renew", "draw"})
#: Commands that show who has the lease.
HOLDING: Final = frozenset({"lease_take", "lease_seize", "lease_renew"})
#: Commands after which the rig may move, or its data change: only while they can be audited.
MOVING: Final = frozenset({"start", "resume_run", "act"})


@dataclass(frozen=True)
class Parts:
    """What a service is put together from."""

    rig: RigConfig
    lease: Lease
    feed: Feed
    steering: Steering
    recordings: Recordings
    library: Library
    interruptions: Interruptions
    trips: TripMemory
    notices: Notices
    audit: AuditLog
    aside: CalculationWorker
    checks: CalculationWorker
    descriptors: Descriptors


class RigService:
    """Serves one rig; every method may be called from any thread.

    ``refused`` says how many messages the server has refused, ``changed`` is called when the
    status has changed.
    """

    def __init__(
        self, parts: Parts, refused: Callable[[], RefusedCounts], changed: Callable[[], None]
    ) -> None:
        self._parts = parts
        self._refused = refused
        self._changed = changed
        self._numbers = itertools.count()
        self._stops: deque[tuple[Asker, str, str]] = deque()  # not written down yet
        self._steered = Asker("")  # who showed last that they have the lease
        self._broken = ""  # why the audit log could not be written when it was last looked at
        self._daemon = Daemon(version=__version__, pid=os.getpid(), started_ns=time.time_ns())
        self._crowding = (0, 0)  # accept_pauses and unauthenticated_ended in the audit log

    def status(self) -> Status:
        """Return the state of everything."""
        parts, running = self._parts, self._parts.steering.running
        return Status(
            v=VERSION,
            rig=parts.rig.name,
            title=parts.rig.title,
            t_ns=time.time_ns(),
            seq=next(self._numbers),
            daemon=self._daemon.model_copy(update=parts.descriptors.as_status()),
            **({"state": "idle"} if running is None else _progress(running)),
            lease=parts.lease.view(),
            trips=parts.trips.views(),
            interrupted=tuple(
                view for view in parts.interruptions.views() if view.run != self._under_way
            ),
            last=parts.steering.last,
            refused=self._refused(),
            notices=parts.notices.views(),
        )

    @property
    def helpless(self) -> str:
        """Why a daemon that is started anew serves clients and this one does not, or "".

        A run under way goes on: connected clients steer it, and a stop reaches its drives.
        """
        running = self._parts.steering.running
        return self._parts.descriptors.helpless if running is None else ""

    @property
    def doing(self) -> str:
        """What goes on, in a few words."""
        running = self._parts.steering.running
        if running is None:
            return "idle"
        progress = running.progress
        return (
            f"{running.request.procedure.name}: {progress.state.name.lower()}, "
            f"{progress.trials_done} of {progress.trials_total} trials"
        )

    def ask(self, identity: str, role: Role, what: str, args: Message) -> Message:
        """Return what was asked for; changes nothing."""
        parts = self._parts
        match what, args:
            case "describe", _:
                return describe(parts.rig, role)
            case "lease", _:
                return parts.lease.view()
            case "latest", _:
                return parts.feed.latest()
            case "events", Since() as since:
                events, following = parts.feed.events(since.seq)
                return Events(events=tuple(events), next=following)
            case "history", StreamName() as stream:
                return parts.feed.history(stream.stream)
            case "procedures", _:
                return parts.library.lines()
            case "procedure", ProcedureName() as procedure:
                return parts.library.view(procedure.name)
            case "check", Checked() as checked:
                return parts.library.check(checked) or self._check_aside(checked)
            case "runs", Runs() as runs:
                return parts.recordings.lines(runs.limit, runs.before, self._under_way)
            case "run", RunArguments() as run:
                return parts.recordings.view(run.run, self._under_way)
            case "fetch", PieceArguments() as piece:
                return self._fetch(piece)
            case "report", ReportPiece() as piece:
                report = parts.recordings.report(piece.run, piece.page)
                return parts.recordings.piece(report, piece.offset, piece.length)
        raise Refusal(Code.UNKNOWN_VERB, f"this daemon cannot tell {what}")

    def command(
        self, identity: str, role: Role, verb: str, args: Message, user: str = ""
    ) -> Message:
        """Do it, write down who wanted it, and return once it is done or under way."""
        asker = Asker(identity, one_line(user))
        try:
            if verb in MOVING:
                self._parts.recordings.make_folder()
                self._parts.audit.check()
            result = self._command(asker, verb, args)
        except Refusal as refusal:
            self._write(asker, role, verb, args, f"{refusal.code.value}: {refusal.message}")
            raise
        except RigdError as error:
            self._write(asker, role, verb, args, f"refused: {error}")
            raise _refusal(error) from error
        except Exception as error:
            self._write(asker, role, verb, args, f"internal: {error!r}")
            raise
        self._write(asker, role, verb, args, "done")
        if verb in HOLDING:
            self._steered = asker
        self._changed()
        return result

    def stop(self, identity: str, verb: str, reason: str, user: str = "") -> Stopped:
        """Stop, abort or estop whatever happens on the rig.

        :meth:`tend` writes it down: a disk that hangs keeps no estop from following a stop.
        """
        asker, reason = Asker(identity, one_line(user)), one_line(reason)
        why = f"{verb} by {asker}" + (f": {reason}" if reason else "")
        acted = self._parts.steering.stop(Severity[verb.upper()], why)
        if acted:  # what was asked before is asked again by whoever is impatient
            self._stops.append((asker, verb, reason))
            self._parts.notices.note(why, "warning")
        return Stopped(acted=acted)

    def tend(self) -> None:
        """Do what is due now and then: write down who stopped, see whose lease has run out."""
        while self._stops:
            asker, verb, reason = self._stops.popleft()
            self._parts.audit.write(asker.identity, verb, {"reason": reason}, user=asker.user)
            self._tell(asker, verb, {"reason": reason})
        for identity in self._parts.lease.lost():
            who = self._steered if self._steered.identity == identity else Asker(identity)
            done = self._parts.steering.client_lost(who)
            self._parts.notices.note(f"{who.lost}: {done}", "warning")
            self._parts.audit.write(identity, "lease_lost", {}, done, user=who.user)
        broken, self._broken = self._broken, self._parts.audit.broken
        if self._broken and not broken:
            self._parts.notices.note(f"nothing can start: {self._broken}", "error")
        descriptors = self._parts.descriptors
        crowding = descriptors.accept_pauses, descriptors.unauthenticated_ended
        if crowding != self._crowding:
            self._crowding = crowding
            seen = dict(zip(("accept_pauses", "unauthenticated_ended"), crowding, strict=True))
            self._parts.audit.write("rigd", "unauthenticated", seen)
        self._parts.steering.tend()

    def _command(self, who: Asker, verb: str, args: Message) -> Message:
        steering, parts = self._parts.steering, self._parts
        match verb, args:
            case "start", StartArguments() as start:
                return steering.start(who, start)
            case "resume_run", ResumeRun() as again:
                path = parts.recordings.path(again.run)
                return steering.resume_run(who, path, again.on_client_loss)
            case "pause", _:
                steering.pause()
            case "resume", _:
                steering.resume()
            case "answer", Answered() as given:
                steering.answer(who, given.prompt_id, given.value)
            case "acknowledge", InterlockName() as name:
                steering.acknowledge(who, name.interlock)
            case "act", ActArguments() as act:
                return ActionReply(said=steering.act(act))
            case "dry_run", Checked() as checked:
                return self._dry_run(checked)
            case "identify", RunArguments() as run:
                return parts.aside.identify(self._finished(run.run))
            case "draw", RunArguments() as run:
                return self._draw(self._finished(run.run))
            case _ if verb.startswith("lease_"):
                return self._lease(who, verb, args)
            case _:
                raise Refusal(Code.UNKNOWN_VERB, f"this daemon cannot {verb}")
        return Nothing()

    def _lease(self, who: Asker, verb: str, args: Message) -> LeaseView:
        view = self._parts.lease.obey(who.identity, verb, args)
        # That commands take it and give it back is no news: who has it stands in the status.
        if verb == "lease_seize":
            self._parts.notices.note(f"{who} has seized control", "warning")
        elif verb == "lease_give":
            self._parts.notices.note(f"{who} has handed control to {view.holder}")
        return view

    def _check_aside(self, args: Checked) -> CheckReport:
        source, file = self._parts.rig.source, args.procedure
        return self._parts.checks.check(source.text, source.path, file.text, file.name, args.set)

    def _dry_run(self, args: Checked) -> DryRun:
        rig = self._parts.rig
        if rig.plant is None:
            raise Refusal(
                Code.REFUSED,
                f"rig {rig.name} has no `plant`: a dry run plays on physics simulated in process",
                hint="try it on the simulated sibling of this rig",
            )
        done = self._parts.aside.dry_run(
            rig.source.text, rig.source.path, args.procedure.text, args.procedure.name, args.set
        )
        self._parts.steering.expect(args, done.duration_s)
        return done

    def _draw(self, recording: Path) -> Reported:
        """Return the page of a run, made unless it is there; making one again gives the same."""
        if is_drawn(recording):
            return Reported(run=recording.name, size=page_of(recording).stat().st_size)
        return self._parts.aside.draw(recording)

    def _fetch(self, piece: PieceArguments) -> PieceView:
        path = self._finished(piece.run)
        return self._parts.recordings.piece(path, piece.offset, piece.length)

    def _write(self, who: Asker, role: Role, verb: str, args: Message, result: str) -> None:
        """Keep what was commanded in the audit log, and tell it to who looks on."""
        if verb in UNAUDITED:
            return
        self._parts.audit.write(
            who.identity, verb, _audited(args), result, role=role.value, user=who.user
        )
        if result == "done":
            self._tell(who, verb, _audited(args))

    def _tell(self, who: Asker, verb: str, args: Mapping[str, Any]) -> None:
        self._parts.feed.tell("command", {"who": str(who), "verb": verb, "args": dict(args)})

    def _finished(self, name: str) -> Path:
        """Return the path of a recording that nobody writes any more."""
        if name == self._under_way:
            raise Refusal(Code.CONFLICT, f"{name} is being recorded", hint="wait for its end")
        return self._parts.recordings.path(name)

    @property
    def _under_way(self) -> str | None:
        running = self._parts.steering.running
        return None if running is None else running.recording.name


def _progress(running: Running) -> dict[str, Any]:
    """Return what the status says of a run."""
    progress = running.progress
    trial, answers = progress.trial, running.answers
    return {
        "state": progress.state.name.lower(),
        "procedure": running.request.procedure.name,
        "run": running.recording.name,
        "step": progress.step or None,
        "trial": None if trial is None else _trial(trial, running.request.procedure),
        "trials_done": progress.trials_done,
        "trials_total": progress.trials_total,
        "run_s": max(progress.run_s, 0.0),
        "left_s": running.left.left_s(progress),
        "prompt": None if answers is None else answers.view(),
    }


def _trial(trial: TrialPlan, procedure: CompiledProcedure) -> TrialStatus:
    return TrialStatus(
        number=trial.number,
        repeat=trial.repeat,
        parameters=dict(trial.parameters),
        label=trial_label(trial, procedure),
    )


def _refusal(error: RigdError) -> Refusal:
    """Return what a client is told; of a file, everything that is wrong with it."""
    if isinstance(error, ConfigError):
        return Refusal(Code.WRONG, str(error))
    return Refusal(Code.REFUSED, error.message, hint=error.hint)


def _audited(args: Message) -> dict[str, Any]:
    """Return what was commanded; a procedure by its digest, not its text."""
    told = as_json(args)
    if isinstance(args, Checked):
        del told["procedure"]["text"]
    return told
