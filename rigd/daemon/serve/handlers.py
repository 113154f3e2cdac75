"""Carries out each verb (kind of request) of the remote protocol on one rig."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from rigd.config.rig import RigConfig
from rigd.daemon.live import Feed
from rigd.daemon.serve.compared_pages import ComparedPages
from rigd.daemon.serve.describe import describe
from rigd.daemon.serve.library import Library
from rigd.daemon.serve.recordings import Recordings, is_drawn
from rigd.daemon.serve.steering import Steering
from rigd.daemon.serve.upkeep.audit import AuditLog
from rigd.daemon.serve.upkeep.certificates import CertificateWatch
from rigd.daemon.serve.upkeep.notices import Notices
from rigd.daemon.serve.upkeep.recovery import Interruptions
from rigd.daemon.serve.upkeep.trips import TripMemory
from rigd.daemon.serve.worker import CalculationWorker
from rigd.model.pages import page_of
from rigd.model.severity import Severity
from rigd.remote.protocol import ClientUser, Code, Handlers, LeaseView, Refusal, Requester
from rigd.remote.protocol.arguments import (
    CalibrateArguments,
    Checked,
    ComparedRuns,
    PieceArguments,
    ReasonArguments,
    Receiver,
    ReportPiece,
    ResumeRun,
    Since,
)
from rigd.remote.protocol.results import (
    ActionReply,
    CheckReport,
    DryRun,
    Events,
    PieceView,
    RenewedCalibration,
    Reported,
    Started,
    Stopped,
)
from rigd.remote.server import Lease


@dataclass(frozen=True)
class Parts:
    """The parts of the daemon that carry out the verbs."""

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
    compared: ComparedPages
    certificates: CertificateWatch

    @property
    def under_way(self) -> str | None:
        """The name of the recording that is being written."""
        running = self.steering.running
        return None if running is None else running.recording.name


def bind_handlers(parts: Parts) -> Handlers:
    """Return the handler of each verb, bound to ``parts``."""
    steering, lease, recordings = parts.steering, parts.lease, parts.recordings
    return Handlers(
        describe=lambda requester, _: describe(parts.rig, requester.role, parts.feed.of_run),
        events=lambda _, args: _events(parts, args),
        latest=lambda *_: parts.feed.latest(),
        history=lambda _, args: parts.feed.history(args.stream),
        lease=lambda *_: lease.view(),
        procedures=lambda *_: parts.library.lines(),
        procedure=lambda _, args: parts.library.view(args.name),
        check=lambda _, args: parts.library.check(args) or _check(parts, args),
        runs=lambda _, args: recordings.lines(args.limit, args.before, parts.under_way, args.where),
        run=lambda _, args: recordings.view(args.run, parts.under_way),
        report=lambda _, args: _report(parts, args),
        fetch=lambda _, args: _fetch(parts, args),
        compare=lambda _, args: _compare(parts, args),
        lease_take=lambda requester, _: lease.take(requester.client),
        lease_renew=lambda requester, _: lease.renew(requester.client),
        lease_release=lambda requester, _: lease.release(requester.client),
        lease_request=lambda requester, _: lease.request(requester.client),
        lease_give=lambda requester, args: _give(parts, requester, args),
        lease_seize=lambda requester, _: _seize(parts, requester),
        start=steering.start,
        resume_run=lambda requester, args: _resume_run(parts, requester, args),
        pause=lambda *_: steering.pause(),
        resume=lambda *_: steering.resume(),
        answer=lambda requester, args: steering.answer(requester, args.prompt_id, args.value),
        acknowledge=lambda requester, args: steering.acknowledge(
            requester, args.interlock, args.since_ns
        ),
        act=lambda requester, args: ActionReply(said=steering.act(requester, args)),
        identify=lambda _, args: parts.aside.identify(_finished(parts, args.run)),
        calibrate=lambda requester, args: _calibrate(parts, requester, args),
        draw=lambda _, args: _draw(parts, _finished(parts, args.run)),
        dry_run=lambda _, args: _dry_run(parts, args),
        stop=lambda requester, args: _stop(parts, Severity.STOP, requester, args),
        abort=lambda requester, args: _stop(parts, Severity.ABORT, requester, args),
        estop=lambda requester, args: _stop(parts, Severity.ESTOP, requester, args),
    )


def _events(parts: Parts, args: Since) -> Events:
    events, following = parts.feed.events(args.seq)
    return Events(events=tuple(events), next=following)


def _check(parts: Parts, args: Checked) -> CheckReport:
    source, file = parts.rig.source, args.procedure
    return parts.checks.check(source.text, source.path, file.text, file.name, args.set)


def _report(parts: Parts, args: ReportPiece) -> PieceView:
    report = parts.recordings.report(args.run, args.page)
    return parts.recordings.piece(report, args.offset, args.length)


def _fetch(parts: Parts, args: PieceArguments) -> PieceView:
    return parts.recordings.piece(_finished(parts, args.run), args.offset, args.length)


def _compare(parts: Parts, args: ComparedRuns) -> PieceView:
    recordings = [_finished(parts, run) for run in args.runs]
    return parts.compared.piece(recordings, args.offset, args.length)


# No event for taking or giving back the lease: the status shows its holder.
def _give(parts: Parts, requester: Requester, args: Receiver) -> LeaseView:
    view = parts.lease.give(requester.client, ClientUser.of(args.to, args.user))
    parts.notices.note(f"{requester} has handed control to {view.holder}")
    return view


def _seize(parts: Parts, requester: Requester) -> LeaseView:
    view = parts.lease.seize(requester.client)
    parts.notices.note(f"{requester} has seized control", "warning")
    return view


def _resume_run(parts: Parts, requester: Requester, args: ResumeRun) -> Started:
    path = parts.recordings.path(args.run)
    return parts.steering.resume_run(requester, path, args.on_client_loss)


def _calibrate(parts: Parts, requester: Requester, args: CalibrateArguments) -> RenewedCalibration:
    source, recording = parts.rig.source, _finished(parts, args.run)
    renewed = parts.aside.calibrate(
        source.text, source.path, recording, str(requester), args.days, write=args.write
    )
    if renewed.written:
        parts.notices.note(f"{requester} has renewed {renewed.file} from {args.run}")
    return renewed


def _draw(parts: Parts, recording: Path) -> Reported:
    """Return the page of a run; make it if it is missing; making it again gives the same page."""
    if is_drawn(recording):
        return Reported(run=recording.name, size=page_of(recording).stat().st_size)
    return parts.aside.draw(recording)


def _dry_run(parts: Parts, args: Checked) -> DryRun:
    rig = parts.rig
    done = parts.aside.dry_run(
        rig.source.text, rig.source.path, args.procedure.text, args.procedure.name, args.set
    )
    if done.physics != "none":
        parts.steering.expect(args, done.duration_s)
    return done


def _stop(parts: Parts, stop: Severity, requester: Requester, args: ReasonArguments) -> Stopped:
    why = f"{stop.word} by {requester}" + (f": {args.reason}" if args.reason else "")
    acted = parts.steering.stop(stop, why)
    if acted:
        parts.notices.note(why, "warning")
    return Stopped(acted=acted)


def _finished(parts: Parts, name: str) -> Path:
    """Return the path of a recording that is no longer written."""
    if name == parts.under_way:
        raise Refusal(Code.CONFLICT, f"{name} is being recorded", hint="wait for its end")
    return parts.recordings.path(name)
