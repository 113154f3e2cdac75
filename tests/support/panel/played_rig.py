"""A rig that is played: the service behind a real server, with traces like those of a real run.

It answers every verb, checks nothing that the server has checked, and can be looked at and changed.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from support.panel.played_campaign import (
    ACTIONS,
    CHANNELS,
    COMPARISON,
    DETAILS,
    INTERLOCKS,
    LISTED,
    PROCEDURES,
    RECORDING,
    REPORT,
    RUN_PAGE,
    SETPOINTS,
    STREAMS,
    TRIP,
    Carriage,
    check,
    dry_run,
    past,
    past_runs,
    piece,
    renewed_by,
    run_line,
)

from rigd.remote.protocol import ClientUser, Code, Kind, Message, Refusal, Requester, Verb
from rigd.remote.protocol.arguments import (
    Answered,
    CalibrateArguments,
    ComparedRuns,
    InterlockName,
    NoArguments,
    PieceArguments,
    ProcedureName,
    ReasonArguments,
    ReportPiece,
    Since,
    StartArguments,
    StreamName,
)
from rigd.remote.protocol.frame import Frame, encode_frame
from rigd.remote.protocol.limits import VERSION
from rigd.remote.protocol.results import (
    ActionReply,
    Description,
    Events,
    History,
    LatestReply,
    LatestValues,
    PieceView,
    ProcedureView,
    RenewedCalibration,
    Reported,
    RunLine,
    RunList,
    RunView,
    Started,
    StatedView,
    Stopped,
)
from rigd.remote.protocol.status import (
    CertificateView,
    Daemon,
    Interrupted,
    LastRun,
    PromptView,
    RigEvent,
    State,
    Status,
    TrialStatus,
    TripView,
)
from rigd.remote.protocol.verbs import Handlers
from rigd.remote.server import Lease, RigPublisher

TICK_S = 1 / 30
#: So long that a client which keeps the lease does not lose it on a crowded machine, in s.
LEASE_S = 600.0
EVENTS_OF_ANSWER = 100  #: a daemon bounds them too, by their bytes
RUN = "2026-11-21T14-02-11_constant_current.mcap"
#: What its setpoints do in a pause, and what follows.
WAITS = "setpoints at rest: wheel_servo.current 0 A; then trial 2 of 10, current 0.2 A"
TITLE = "LuGre omni-wheel rig, simulated"


@dataclass(frozen=True)
class Asked:
    """A request that has reached the rig."""

    requester: Requester
    verb: Verb
    args: Message


class PlayedRig:
    """One rig, which any thread may change; a run that is stopped ends once a test ends it.

    ``prompts`` are asked at the beginning of each run. ``wall`` is the clock of its computer.
    """

    def __init__(
        self,
        name: str = "lugre-1",
        *,
        prompts: tuple[PromptView, ...] = (),
        lease_s: float = LEASE_S,
        wall: Callable[[], int] = time.time_ns,
    ) -> None:
        self.name = name
        self.lease = Lease(duration_s=lease_s, wall=wall)
        self.publisher: RigPublisher | None = None  #: once it is served
        self.requests: list[Asked] = []
        self.stops = 0
        self.changes = 0  #: commands and stops that were carried out, but for renewals of the lease
        self.state: State = "idle"
        self.descriptors = 40
        self.run = RUN
        self.carriage = Carriage()
        self.events: list[RigEvent] = []
        self.trips: list[TripView] = []
        self.interrupted: tuple[Interrupted, ...] = ()
        self.certificates: tuple[CertificateView, ...] = ()
        self.last: LastRun | None = None
        self.runs = past_runs()
        self.said = 0  #: statuses
        self.fails = ""  #: the verb that raises ``error``
        self.error: Exception = RuntimeError("a bug of the rig's own")
        self.stated: tuple[StatedView, ...] = ()  #: what the lab demands
        self.keeps_running = False  #: after any stop
        self.told: dict[str, Any] = {}  #: fields of the status that a test sets
        self.can_hold = False  #: whether a pause holds the present step
        self.computes_s = 0.0  #: processor time that each reply to a question takes
        self.begun = threading.Event()  #: a verb hangs
        self.let_go = threading.Event()
        self._hangs = ""
        self._prompts, self._wall = prompts, wall
        self._waiting: list[PromptView] = []
        self._began = 0.0
        self._emitting = threading.Lock()
        self._showing = threading.Lock()
        self._handlers = self._table()

    # What tests see of it, and do to it.

    @property
    def done(self) -> list[tuple[str, str]]:
        """Return identity and verb of each command and stop."""
        return [
            (item.requester.identity, item.verb.name)
            for item in self.requests
            if item.verb.rule.kind is not Kind.ASK
        ]

    def verbs(self) -> list[str]:
        """Return the commands and stops, but for renewals of the lease."""
        return [verb for _, verb in self.done if verb != "lease_renew"]

    def given(self, verb: str) -> list[dict[str, Any]]:
        """Return the arguments of each request for ``verb``, but those left at their default."""
        return [
            item.args.model_dump(mode="json", exclude_defaults=True)
            for item in self.requests
            if item.verb.name == verb
        ]

    def users(self, verb: str) -> list[str]:
        """Return the user of each request for ``verb``."""
        return [item.requester.user for item in self.requests if item.verb.name == verb]

    def hold_lease(self, identity: str, user: str = "") -> None:
        """Give the lease to a client."""
        self.lease.seize(ClientUser.of(identity, user))

    @contextmanager
    def hanging(self, verb: str) -> Iterator[None]:
        """Let ``verb`` hang while inside, or until it is ``let_go``."""
        self.begun.clear()
        self.let_go.clear()
        self._hangs = verb
        try:
            yield
        finally:
            self._hangs = ""
            self.let_go.set()

    @property
    def prompt(self) -> PromptView | None:
        """The question that waits for an answer."""
        return next(iter(self._waiting), None)  # another thread may answer meanwhile

    @prompt.setter
    def prompt(self, prompt: PromptView | None) -> None:
        self._waiting = [] if prompt is None else [prompt]
        self.show()

    def emit(self, kind: str, **data: Any) -> None:
        """Let something happen."""
        trial = self.carriage.trial if self.state == "running" else -1
        with self._emitting:
            event = RigEvent(
                v=VERSION, seq=len(self.events), t_ns=self._wall(), kind=kind, trial=trial,
                data=data,
            )  # fmt: skip
            self.events.append(event)
            if self.publisher is not None:
                self.publisher.event(event)
        self.show()

    def show(self) -> None:
        """Publish the status now, rather than with the next heartbeat."""
        if self.publisher is not None:
            with self._showing:
                self.publisher.status(self.status())

    def become(self, state: State) -> None:
        """Go to a state, and show it."""
        self.state = state
        self.show()

    def end(self, ending: str = "complete", reason: str = "as a test wants it") -> None:
        """End the run."""
        exit_code = {"complete": 0, "incomplete": 6}.get(ending, 5)
        self._waiting.clear()
        self.state = "idle"
        self.last = LastRun(run=self.run, ending=ending, reason=reason, exit_code=exit_code)
        self.runs = [run_line(self.run, ending), *(r for r in self.runs if r.run != self.run)]
        self.emit("run_end", ending=ending, reason=reason)

    def trip(self, trip: TripView = TRIP) -> None:
        """Let an interlock act."""
        self.trips.append(trip.model_copy(update={"since_ns": time.time_ns()}))
        self.emit("interlock", name=trip.interlock, action=trip.action, reason=trip.message)
        if self.state != "idle":
            self.end("aborted", f"interlock {trip.interlock}")

    def play(self, until: threading.Event) -> None:
        """Publish frames while a run is under way."""
        sequence = 0
        while not until.wait(TICK_S):
            if self.state == "idle" or self.publisher is None:
                continue
            moves = self.state in ("running", "pausing") and not self._waiting
            t_s, rows, ended = self.carriage.play(TICK_S, moves)
            if ended:
                self._trial_ended()
            now_ns = time.time_ns() - round(TICK_S * 1e9)
            sequence += 1
            for number, stream in enumerate(STREAMS):
                values = np.array([rows[f"{stream}.{name}"] for name in CHANNELS[stream]], "f4")
                frame = Frame(number, sequence, now_ns, t_s, values, values)
                self.publisher.frame(stream, encode_frame(frame))

    # What the server asks of it.

    def status(self) -> Status:
        """Return the state of everything."""
        self.said += 1
        plays, played = self.state != "idle", self.carriage
        run_s = time.monotonic() - self._began if plays and self._began else 0.0
        trial = TrialStatus(
            number=played.trial, repeat=1, label=f"current {played.target:.3g} A",
            parameters={"current": played.target, "floor": "stone"}, units={"current": "A"},
        )  # fmt: skip
        return Status(
            v=VERSION, rig=self.name, title=TITLE, t_ns=self._wall(),
            rows_ns=time.time_ns(), seq=self.said,
            daemon=Daemon(
                version="0.1.0", pid=os.getpid(), started_ns=1, descriptors=self.descriptors
            ),
            state=self.state,
            procedure="constant_current" if plays else None,
            run=self.run if plays else None,
            step=played.step if plays else None, can_hold=self.can_hold and plays,
            trial=trial if plays and not self._waiting else None,
            trials_done=played.trial - 1 if plays else 0, trials_total=10 if plays else 0,
            run_s=run_s, left_s=max(0.0, 95.0 - run_s) if plays else None,
            pause_in_s=12.0 if self.state == "pausing" else None,
            waits=WAITS if self.state in ("held", "paused") else "",
            prompt=self.prompt, lease=self.lease.view(),
            trips=tuple(self.trips), interrupted=self.interrupted, last=self.last,
            certificates=self.certificates,
        ).model_copy(update=self.told)  # fmt: skip

    def answer(self, verb: Verb, requester: Requester, args: Message) -> Message:
        """Carry out a verb."""
        self.requests.append(Asked(requester, verb, args))
        if verb.name == self._hangs:
            self.begun.set()
            assert self.let_go.wait(600)
        if verb.name == self.fails:
            raise self.error
        result = verb.carry_out(self._handlers, requester, args)
        if verb.rule.kind is Kind.ASK:
            end_s = time.thread_time() + self.computes_s
            while time.thread_time() < end_s:
                pass
        elif verb.name != "lease_renew" and result != Stopped(acted=False):
            self.changes += 1
            self.show()
        return result

    def _runs(self, where: str) -> RunList:
        """Return the recordings with the state that ``where`` compares, ``state == stopped``."""
        name, _, value = where.partition(" == ")
        if name not in ("", "state"):
            raise Refusal(
                Code.BAD_REQUEST, f"there is no field {name!r}", hint="did you mean 'state'?"
            )
        return RunList(
            runs=tuple(run for run in self.runs if not name or run.state == value), more=False
        )

    def _table(self) -> Handlers:
        lease = self.lease
        return Handlers(
            describe=self._describe,
            events=self._events,
            latest=self._latest,
            history=self._history,
            lease=lambda _, __: lease.view(),
            procedures=lambda _, __: LISTED,
            procedure=_procedure,
            check=lambda _, wanted: check(wanted.set),
            runs=lambda _, wanted: self._runs(wanted.where),
            run=lambda _, wanted: RunView(line=self._line(wanted.run), details=DETAILS),
            report=self._report,
            fetch=self._fetch,
            compare=self._compare,
            lease_take=lambda by, _: lease.take(by.client),
            lease_renew=lambda by, _: lease.renew(by.client),
            lease_release=lambda by, _: lease.release(by.client),
            lease_request=lambda by, _: lease.request(by.client),
            lease_give=lambda by, to: lease.give(by.client, ClientUser.of(to.to, to.user)),
            lease_seize=lambda by, _: lease.seize(by.client),
            start=self._start,
            resume_run=lambda _, wanted: self._begin(wanted.run),
            pause=self._pause,
            resume=self._resume,
            answer=self._answer,
            acknowledge=self._acknowledge,
            act=lambda _, wanted: ActionReply(said=f"{wanted.device} is tared"),
            identify=lambda _, wanted: self._made(wanted.run, "has_report", REPORT),
            calibrate=self._calibrate,
            draw=lambda _, wanted: self._made(wanted.run, "has_page", RUN_PAGE),
            dry_run=lambda _, wanted: dry_run(wanted.set),
            stop=self._stop,
            abort=partial(self._end_by, "aborted"),
            estop=partial(self._end_by, "estopped"),
        )

    def _describe(self, by: Requester, _: NoArguments) -> Description:
        return Description(
            rig=self.name, title=TITLE, simulated=True, streams=tuple(STREAMS.values()),
            setpoints=SETPOINTS, interlocks=INTERLOCKS, actions=ACTIONS, role=by.role,
            stated=self.stated,
        )  # fmt: skip

    def _events(self, _: Requester, since: Since) -> Events:
        found = self.events[since.seq :][:EVENTS_OF_ANSWER]
        return Events(events=tuple(found), next=since.seq + len(found))

    def _latest(self, _: Requester, __: NoArguments) -> LatestValues:
        values = {
            name: LatestReply(value=float(value), age_s=0.2)
            for name, value in self.carriage.values.items()
        }
        return LatestValues(t_ns=time.time_ns(), values=values)

    def _history(self, _: Requester, wanted: StreamName) -> History:
        return History(frame=past(wanted.stream))

    def _fetch(self, _: Requester, wanted: PieceArguments) -> PieceView:
        self._line(wanted.run)
        return piece(RECORDING, wanted)

    def _compare(self, _: Requester, wanted: ComparedRuns) -> PieceView:
        lines = [self._line(run) for run in wanted.runs]
        if not all(line.identifies for line in lines):
            raise Refusal(Code.REFUSED, "one has nothing to compare", hint="leave it out")
        return piece(COMPARISON, wanted)

    def _report(self, _: Requester, wanted: ReportPiece) -> PieceView:
        line = self._line(wanted.run)
        if not (line.has_page if wanted.page == "run" else line.has_report):
            raise Refusal(Code.NOT_FOUND, "this run has no such page yet")
        return piece(RUN_PAGE if wanted.page == "run" else REPORT, wanted)

    def _start(self, _: Requester, start: StartArguments) -> Started:
        if self.state != "idle" or any(not trip.acknowledged for trip in self.trips):
            raise Refusal(Code.CONFLICT, "not now")
        self._waiting = list(self._prompts) if start.answers == "ask" else []
        return self._begin(RUN, procedure=start.procedure.name, set=start.set)

    def _begin(self, run: str, **data: Any) -> Started:
        self.run, self.state, self._began = run, "running", time.monotonic()
        self.carriage = Carriage()
        self.emit("run_start", **data)
        self._trial_begins()
        if self.prompt is not None:
            self.emit("prompt", name=self.prompt.name, text=self.prompt.text)
        return Started(run=run)

    def _pause(self, _: Requester, __: NoArguments) -> None:
        if self.state == "running":
            self.state = "held" if self.can_hold else "pausing"

    def _resume(self, _: Requester, __: NoArguments) -> None:
        if self.state in ("pausing", "held", "paused"):
            self.state = "running"

    def _answer(self, _: Requester, answered: Answered) -> None:
        prompt, value = self.prompt, answered.value
        if prompt is None or answered.prompt_id != prompt.id:
            raise Refusal(Code.CONFLICT, "this question is not asked any more")
        if prompt.kind == "choice" and value not in prompt.choices:
            raise Refusal(Code.REFUSED, f"{value!r} is not one of the choices")
        self._waiting.pop(0)
        self.emit("answer", name=prompt.name, answer=value)

    def _acknowledge(self, _: Requester, named: InterlockName) -> None:
        found = [trip for trip in self.trips if trip.interlock == named.interlock]
        newest_ns = max((trip.since_ns for trip in found), default=0)
        if named.since_ns is not None and newest_ns - named.since_ns > 1000:
            raise Refusal(Code.CONFLICT, f"{named.interlock} has tripped again since: {found}")
        self.trips = [trip for trip in self.trips if trip.interlock != named.interlock]

    def _stop(self, by: Requester, _: ReasonArguments) -> Stopped:
        if self.state in ("idle", "stopping"):
            return Stopped(acted=False)
        self._waiting.clear()
        self.state = "stopping"
        self.emit("state", state="stopping", reason=f"stop by {by}")
        return Stopped(acted=True)

    def _end_by(self, ending: str, by: Requester, _: ReasonArguments) -> Stopped:
        if self.state == "idle":
            return Stopped(acted=False)
        if not self.keeps_running:
            self.end(ending, f"by {by}")
        return Stopped(acted=True)

    def _calibrate(self, by: Requester, wanted: CalibrateArguments) -> RenewedCalibration:
        self._line(wanted.run)
        return renewed_by(str(by), write=wanted.write)

    def _made(self, run: str, what: str, page: bytes) -> Reported:
        line = self._line(run)
        self.runs[self.runs.index(line)] = line.model_copy(update={what: True})
        return Reported(run=run, size=len(page))

    def _line(self, run: str) -> RunLine:
        for line in self.runs:
            if line.run == run:
                return line
        raise Refusal(Code.NOT_FOUND, f"there is no recording {run!r}")

    def _trial_ended(self) -> None:
        if self.state == "pausing":
            self.state = "paused"
        self.emit("trial_end", number=self.carriage.trial - 1)
        self._trial_begins()

    def _trial_begins(self) -> None:
        self.emit(
            "trial_start", number=self.carriage.trial,
            parameters={"current": self.carriage.target}, units={"current": "A"},
        )  # fmt: skip


def _procedure(_: Requester, wanted: ProcedureName) -> ProcedureView:
    if wanted.name not in PROCEDURES:
        raise Refusal(Code.NOT_FOUND, f"there is no procedure {wanted.name}")
    return PROCEDURES[wanted.name]
