"""A rig that is played: what the panel needs of one, with traces like those of a real run.

Speaks in the protocol's own models, so that what it says has the form that a daemon's has.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Mapping
from typing import Any, TypeVar

import numpy as np
from pydantic import ValidationError
from support.played_campaign import (
    ACTIONS,
    CHANNELS,
    DETAILS,
    INTERLOCKS,
    PROCEDURES,
    PROMPT,
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
    piece,
)

from rigd.model.errors import LinkError
from rigd.remote.protocol.arguments import Answered, Receiver, StartArguments
from rigd.remote.protocol.frame import Frame, encode_frame
from rigd.remote.protocol.limits import VERSION
from rigd.remote.protocol.message import Message
from rigd.remote.protocol.refusal import Code, Refusal
from rigd.remote.protocol.results import (
    Description,
    Events,
    History,
    LatestReply,
    LatestValues,
    ProcedureLine,
    Procedures,
    Reported,
    RunLine,
    RunList,
    RunView,
    Started,
)
from rigd.remote.protocol.roles import Role
from rigd.remote.protocol.status import (
    Daemon,
    Interrupted,
    LastRun,
    LeaseView,
    PromptView,
    RigEvent,
    Status,
    TrialStatus,
    TripView,
    as_json,
)

TICK_S = 1 / 30
RUN = "2026-11-21T14-02-11_constant_current.mcap"


class PlayedRig:
    """A rig in this process, on the panel's loop; what was asked of it stands in ``given``."""

    identity = "panel"

    def __init__(self, prompts: tuple[PromptView, ...] = (PROMPT,)) -> None:
        self.given: list[tuple[str, dict[str, Any]]] = []
        self.users: dict[str, str] = {}  # by command: for whom the newest was given
        self.changes = 0  #: everything that a client changed
        self.is_silent = False
        self.is_maintained = False
        self.delay_s = 0.0  #: how long a command takes
        self.dry_run_s = 0.0  #: how long a dry run takes
        self.prompts = prompts
        self.carriage = Carriage()
        self._asked: list[PromptView] = []
        self._seq = 0
        self._event_seq = 0
        self._events: list[RigEvent] = []
        self._news = asyncio.Condition()
        self._began = 0.0
        self.trips: list[TripView] = []
        self.holder: str | None = None
        self.asked_by: tuple[str, ...] = ()
        self.state = "idle"
        self.interrupted: tuple[Interrupted, ...] = ()
        self.last: LastRun | None = None
        self.runs = [
            RunLine(
                run=f"2026-11-{day:02d}T09-12-0{day % 10}_constant_current.mcap",
                procedure="constant_current",
                state="complete" if day % 3 else "stopped",
                started_ns=time.time_ns() - (40 - day) * 86_400 * 10**9,
                duration_s=93.4, trials_done=10 if day % 3 else 4, trials_total=10,
                size=len(RECORDING), has_report=bool(day % 2),
                has_page=day == 19, identifies=day != 18,
            )
            for day in range(20, 12, -1)
        ]  # fmt: skip

    # What it tells.

    def status(self) -> Status:
        """Return what it would say now."""
        self._seq += 1
        plays = self.state not in ("idle", "done")
        run_s = time.monotonic() - self._began if plays else 0.0
        played = self.carriage
        return Status(
            v=VERSION, rig="lugre-1", title="LuGre omni-wheel rig, simulated", t_ns=time.time_ns(),
            seq=self._seq, daemon=Daemon(version="0.1.0", pid=1, started_ns=1),
            state="idle" if self.state == "done" else self.state,  # type: ignore[arg-type]
            procedure="constant_current" if plays else None,
            run=RUN if plays else None,
            step=played.step if plays else None,
            trial=TrialStatus(number=played.trial, repeat=1,
                        parameters={"current": played.target, "floor": "stone"},
                        label=f"current {played.target:.3g} A")
            if plays and not self._asked else None,
            trials_done=played.trial - 1 if plays else 0, trials_total=10 if plays else 0,
            run_s=run_s, left_s=max(0.0, 95.0 - run_s) if plays else None,
            prompt=self._asked[0] if self._asked else None,
            lease=LeaseView(holder=self.holder, asked_by=self.asked_by,
                            until_ns=time.time_ns() + 6 * 10**9 if self.holder else 0),
            trips=tuple(self.trips), interrupted=self.interrupted, last=self.last,
        )  # fmt: skip

    async def statuses(self) -> AsyncIterator[dict[str, Any]]:
        """Yield the status at every change and twice a second."""
        while True:
            if not self.is_silent:
                yield as_json(self.status())
            async with self._news:
                try:
                    await asyncio.wait_for(self._news.wait(), 0.5)
                except TimeoutError:
                    continue

    async def events(self) -> AsyncIterator[dict[str, Any]]:
        """Yield every event from now on."""
        told = len(self._events)
        while True:
            while told < len(self._events):
                yield as_json(self._events[told])
                told += 1
            async with self._news:
                await self._news.wait()

    async def frames(self) -> AsyncIterator[bytes]:
        """Yield frames while it plays."""
        sequence = 0
        while True:
            await asyncio.sleep(TICK_S)
            if self.is_silent or self.state in ("idle", "done"):
                continue
            runs = self.state in ("running", "pausing") and not self._asked
            t_s, rows, ended = self.carriage.play(TICK_S, runs)
            if ended:
                await self._trial_ended()
            now_ns = time.time_ns() - round(TICK_S * 1e9)
            sequence += 1
            for number, stream in enumerate(STREAMS):
                values = np.array([rows[f"{stream}.{name}"] for name in CHANNELS[stream]], "f4")
                frame = Frame(number, sequence, now_ns, t_s, values, values)
                yield encode_frame(frame)

    async def emit(self, kind: str, **data: Any) -> None:
        """Let something happen."""
        self._event_seq += 1
        trial = self.carriage.trial if self.state == "running" else -1
        event = RigEvent(
            v=VERSION, seq=self._event_seq, t_ns=time.time_ns(), kind=kind, trial=trial, data=data
        )
        self._events.append(event)
        await self.wake()

    async def wake(self) -> None:
        """Tell the status at once."""
        async with self._news:
            self._news.notify_all()

    # What it is asked.

    async def ask(self, what: str, args: Mapping[str, Any]) -> dict[str, Any]:
        """Answer."""
        self._hear(what, args)
        match what:
            case "describe":
                return as_json(
                    Description(
                        rig="lugre-1", title="LuGre omni-wheel rig, simulated", simulated=True,
                        streams=tuple(STREAMS.values()), setpoints=SETPOINTS,
                        interlocks=INTERLOCKS, actions=ACTIONS,
                        role=Role.MAINTAINER if self.is_maintained else Role.OPERATOR,
                    )
                )  # fmt: skip
            case "procedures":
                lines = [
                    ProcedureLine(name=procedure.procedure.name, title=procedure.title,
                                  sha256=procedure.procedure.sha256)
                    for procedure in PROCEDURES.values()
                ]  # fmt: skip
                problem = "the rig lugre-1 has no channel 'scale.mass'"
                lines.append(ProcedureLine(name="calibrate_scale", title="Calibrate the scale",
                                           sha256="0" * 64, problem=problem))  # fmt: skip
                return as_json(Procedures(procedures=tuple(lines)))
            case "procedure":
                if args.get("name") not in PROCEDURES:
                    raise Refusal(Code.NOT_FOUND, "there is no such procedure")
                return as_json(PROCEDURES[args["name"]])
            case "check":
                return as_json(check(str(args.get("set", {}).get("brake_at", ""))))
            case "events":
                return as_json(Events(events=tuple(self._events), next=self._event_seq + 1))
            case "latest":
                values = {
                    name: LatestReply(value=value, age_s=0.2)
                    for name, value in self._newest().items()
                }
                return as_json(LatestValues(t_ns=time.time_ns(), values=values))
            case "history":
                return as_json(History(frame=past(str(args["stream"]))))
            case "runs":
                return as_json(RunList(runs=tuple(self.runs), more=False))
            case "run":
                return as_json(RunView(line=self._run(args), details=DETAILS))
            case "report" if args.get("page") == "run":
                if not self._run(args).has_page:
                    raise Refusal(Code.NOT_FOUND, "this run has no page yet")
                return piece(RUN_PAGE.encode(), args)
            case "report":
                if not self._run(args).has_report:
                    raise Refusal(Code.NOT_FOUND, "this run has no report yet")
                return piece(REPORT.encode(), args)
            case "fetch":
                self._run(args)
                return piece(RECORDING, args)
        raise Refusal(Code.UNKNOWN_VERB, what)

    async def command(self, verb: str, args: Mapping[str, Any], user: str = "") -> dict[str, Any]:
        """Obey."""
        self._hear(verb, args)
        self.users[verb] = user
        await asyncio.sleep(self.delay_s)
        if verb == "draw":
            return self._made(args, "has_page", RUN_PAGE)
        if verb == "dry_run":
            await asyncio.sleep(self.dry_run_s)
            return as_json(dry_run(float(args["set"].get("brake_at", "1.15 m").split()[0])))
        match verb:
            case "lease_take" if self.holder in (None, self.identity):
                self.holder = self.identity
            case "lease_take":
                raise Refusal(Code.LEASE_HELD, f"{self.holder} has control")
            case "lease_seize":
                if not self.is_maintained:
                    raise Refusal(Code.FORBIDDEN, "lease_seize needs the role maintainer")
                self.holder = self.identity
            case "lease_renew":
                if self.holder != self.identity:
                    raise Refusal(Code.NO_LEASE, "the lease is not yours")
                return {}
            case "lease_request":
                self.asked_by = (*self.asked_by, self.identity)
            case "lease_release":
                self.holder = None
            case "lease_give":
                self.holder, self.asked_by = _checked(Receiver, args).to, ()
            case _ if self.holder != self.identity:
                raise Refusal(Code.NO_LEASE, "you do not have control")
            case "start":
                await self._start(_checked(StartArguments, args))
                self.changes += 1
                await self.wake()
                return as_json(Started(run=RUN))
            case "pause" if self.state == "running":
                self.state = "pausing"
            case "resume" if self.state in ("pausing", "paused"):
                self.state = "running"
            case "answer":
                await self._answer(_checked(Answered, args))
            case "acknowledge":
                self._acknowledge(args.get("interlock"))
            case "act":
                return {"said": f"{args['device']} is tared"}
            case "identify":
                return await self._identify(args)
            case _:
                raise Refusal(Code.CONFLICT, f"cannot {verb} while {self.state}")
        self.changes += 1
        await self.wake()
        return {}

    async def stop(self, verb: str, user: str = "") -> dict[str, Any]:
        """Stop."""
        self._hear(verb, {"user": user})
        await asyncio.sleep(self.delay_s)
        if self.is_silent:
            raise LinkError("the daemon does not answer")
        if self.state in ("idle", "done"):
            return {"acted": False}
        if verb == "stop" and self.state == "stopping":
            return {"acted": False}
        self.changes += 1
        self._asked.clear()
        if verb == "stop":
            self.state = "stopping"
            await self.emit("state", state="stopping", reason=f"stop by {user}")
            return {"acted": True}
        await self.end("estopped" if verb == "estop" else "aborted", f"{verb} by {user}")
        return {"acted": True}

    async def end(self, ending: str, reason: str) -> None:
        """End the run."""
        self.state = "idle"
        self.last = LastRun(run=RUN, ending=ending, reason=reason, exit_code=5)
        await self.emit("run_end", ending=ending, reason=reason)

    async def trip(self, trip: TripView = TRIP) -> None:
        """Let an interlock act."""
        self.trips.append(trip.model_copy(update={"since_ns": time.time_ns()}))
        await self.emit("interlock", name=trip.interlock, action=trip.action, reason=trip.message)
        if self.state != "idle":
            await self.end("aborted", f"interlock {trip.interlock}")

    def _hear(self, verb: str, args: Mapping[str, Any]) -> None:
        self.given.append((verb, dict(args)))
        if self.is_silent:
            raise LinkError(
                "the daemon does not answer", hint="is it running, and is the address right?"
            )

    async def _start(self, start: StartArguments) -> None:
        if self.state != "idle" or any(not trip.acknowledged for trip in self.trips):
            raise Refusal(Code.CONFLICT, "not now")
        self.carriage = Carriage()
        self.state, self._began = "running", time.monotonic()
        self._asked = list(self.prompts) if start.answers == "ask" else []
        await self.emit("run_start", procedure=start.procedure.name, set=start.set)
        await self._trial_begins()
        if self._asked:
            await self.emit("prompt", name=self._asked[0].name, text=self._asked[0].text)

    async def _answer(self, answered: Answered) -> None:
        if not self._asked or answered.prompt_id != self._asked[0].id:
            raise Refusal(Code.CONFLICT, "this question is not asked any more")
        prompt, value = self._asked[0], answered.value
        if prompt.kind == "choice" and value not in prompt.choices:
            raise Refusal(Code.REFUSED, f"{value!r} is not one of the choices")
        self._asked.pop(0)
        await self.emit("answer", name=prompt.name, answer=value)

    def _acknowledge(self, interlock: object) -> None:
        if interlock not in [trip.interlock for trip in self.trips]:
            raise Refusal(Code.NOT_FOUND, f"{interlock} has not acted")
        self.trips = [trip for trip in self.trips if trip.interlock != interlock]

    async def _identify(self, args: Mapping[str, Any]) -> dict[str, Any]:
        await asyncio.sleep(0.2)
        return self._made(args, "has_report", REPORT)

    def _made(self, args: Mapping[str, Any], what: str, text: str) -> dict[str, Any]:
        line = self._run(args)
        self.runs[self.runs.index(line)] = line.model_copy(update={what: True})
        return as_json(Reported(run=line.run, size=len(text)))

    async def _trial_ended(self) -> None:
        if self.state == "pausing":
            self.state = "paused"
        await self.emit("trial_end", number=self.carriage.trial - 1)
        await self._trial_begins()

    async def _trial_begins(self) -> None:
        number, current = self.carriage.trial, self.carriage.target
        await self.emit("trial_start", number=number, parameters={"current": current},
                        units={"current": "A"})  # fmt: skip

    def _run(self, args: Mapping[str, Any]) -> RunLine:
        for run in self.runs:
            if run.run == args.get("run"):
                return run
        raise Refusal(Code.NOT_FOUND, f"there is no recording {args.get('run')!r}")

    def _newest(self) -> dict[str, float]:
        return {
            f"{stream}.{name}": float(self.carriage.values[f"{stream}.{name}"])
            for stream in STREAMS
            for name in CHANNELS[stream]
        }


M = TypeVar("M", bound=Message)


def _checked(kind: type[M], args: Mapping[str, Any]) -> M:
    """Return the arguments as the protocol has them."""
    try:
        return kind.model_validate(dict(args))
    except ValidationError as error:
        raise Refusal(Code.BAD_REQUEST, str(error)[:200]) from error
