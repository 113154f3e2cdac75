"""A rig behind a server that answers every verb rightly, and plays a run when it is started."""

from __future__ import annotations

import hashlib
import os
import threading
import time
from base64 import b64encode
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from support.served_rig import free_port

from rigd.config.remote import RemoteSetup
from rigd.remote.protocol import (
    VERSION,
    Code,
    Frame,
    Message,
    Refusal,
    RigEvent,
    Role,
    Status,
    encode_frame,
)
from rigd.remote.protocol.arguments import (
    Answered,
    Checked,
    PieceArguments,
    ProcedureFile,
    ProcedureName,
    ReportPiece,
    RunArguments,
    Runs,
    Since,
    StartArguments,
)
from rigd.remote.protocol.results import (
    ActionReply,
    ChannelView,
    CheckReport,
    Description,
    DryRun,
    Events,
    History,
    LatestReply,
    LatestValues,
    Nothing,
    PieceView,
    ProcedureLine,
    Procedures,
    ProcedureView,
    Reported,
    RunLine,
    RunList,
    RunView,
    Started,
    Stopped,
    StreamView,
)
from rigd.remote.protocol.status import (
    Daemon,
    Interrupted,
    LastRun,
    PromptView,
    TrialStatus,
    TripView,
)
from rigd.remote.server import Lease, Result, Server

#: So long that on a crowded machine it runs out for nobody who keeps it, in s.
LEASE_S = 600.0
TEXT = """\
procedure: small
title: A small procedure
doc: For clients.
parameters:
  floor: {doc: Floor, choices: [stone, pvc], default: stone}
trial:
  steps:
    - step: drive
      set: {wheel_servo.current: 0.5 A}
      for: 0.1 s
"""
FILE = ProcedureFile(name="small", text=TEXT, sha256=hashlib.sha256(TEXT.encode()).hexdigest())
RECORDING = bytes(range(256)) * 4000  # four pieces, the last one short
RUN_PAGE = b"<!doctype html><title>run</title>"
REPORT = b"<!doctype html><title>report</title>"
QUESTION = PromptView(
    id=7, name="weight", text="Put the weight on", kind="number", unit="kg", low=0.5, high=2.0,
    answer=1.0,
)  # fmt: skip


@dataclass
class AnsweringRig:
    """One rig whose run goes on until :meth:`end` or a stop; any thread may change it."""

    name: str
    lease: Lease
    done: list[tuple[str, str, Message | str]] = field(default_factory=list)
    running: str | None = None
    last: LastRun | None = None
    prompt: PromptView | None = None
    interrupted: tuple[Interrupted, ...] = ()
    trials_done: int = 0
    told: list[RigEvent] = field(default_factory=list)
    recording: bytes = RECORDING
    breaks_at: int | None = None  #: offset of the piece whose reading fails, once
    slow_s: float = 0.0  #: how long each dry run takes
    keeps_running: bool = False  #: whatever it is told
    asked: list[str] = field(default_factory=list)
    users: dict[str, str] = field(default_factory=dict)  #: by command or stop: for whom
    trips: tuple[TripView, ...] = ()
    trial: TrialStatus | None = None
    _said: int = 0
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def status(self) -> Status:
        """Return the state of everything."""
        with self._lock:
            self._said += 1
            said = self._said
        running = self.running
        return Status(
            v=VERSION,
            rig=self.name,
            title="A rig that answers",
            t_ns=time.time_ns(),
            seq=said,
            daemon=Daemon(version="0", pid=os.getpid(), started_ns=0),
            state="idle" if running is None else "running",
            procedure=None if running is None else "small",
            run=running,
            trial=self.trial,
            trials_done=self.trials_done,
            trials_total=3,
            prompt=self.prompt,
            lease=self.lease.view(),
            trips=self.trips,
            interrupted=self.interrupted,
            last=self.last,
        )

    def end(self, ending: str = "complete", exit_code: int = 0) -> None:
        """End the run."""
        assert self.running is not None
        self.last = LastRun(
            run=self.running, ending=ending, reason="as a test wants it", exit_code=exit_code
        )
        self.running = self.prompt = None

    def tell(self, kind: str, **data: Any) -> RigEvent:
        """Return a new event, which is still known when it is asked for later."""
        event = RigEvent(v=VERSION, seq=len(self.told), t_ns=time.time_ns(), kind=kind, data=data)
        self.told.append(event)
        return event

    def ask(self, identity: str, role: Role, what: str, args: Message) -> Result:
        """Return what there is."""
        self.asked.append(what)
        match what, args:
            case "describe", _:
                channel = ChannelView(name="scale.mass", unit="kg")
                stream = StreamView(number=0, name="scale", channels=(channel,), rate_hz=10.0)
                return Description(
                    rig=self.name, title="Answers", simulated=True, streams=(stream,), role=role
                )
            case "lease", _:
                return self.lease.view()
            case "latest", _:
                return LatestValues(
                    t_ns=1, values={"scale.mass": LatestReply(value=1.5, age_s=0.1)}
                )
            case "history", _:
                frame = b64encode(encode_frame(frame_of(1)))
                return History(frame=frame)
            case "events", Since(seq=seq):
                return Events(events=tuple(self.told[seq:]), next=len(self.told))
            case "procedures", _:
                line = ProcedureLine(name=FILE.name, title="Small", sha256=FILE.sha256)
                return Procedures(procedures=(line,))
            case "procedure", ProcedureName(name=name):
                if name != FILE.name:
                    raise Refusal(Code.NOT_FOUND, f"there is no procedure {name}")
                return ProcedureView(
                    procedure=FILE, title="Small", doc="", parameters=(), on_client_loss="stop"
                )
            case "check", Checked():
                return CheckReport(ok=True, trials=3, prompts=1)
            case "runs", Runs():
                return RunList(runs=(self._line("a.mcap"),), more=False)
            case "run", RunArguments(run=run):
                return RunView(line=self._line(run), details={"rig": self.name})
            case "fetch", PieceArguments() as piece:
                return self._piece(self.recording, piece)
            case "report", ReportPiece(page="run") as piece:
                return self._piece(RUN_PAGE, piece)
            case "report", PieceArguments() as piece:
                return self._piece(REPORT, piece)
        raise AssertionError(what)

    def command(self, identity: str, role: Role, verb: str, args: Message, user: str) -> Result:
        """Do it, and note it."""
        self.done.append((identity, verb, args))
        self.users[verb] = user
        match verb, args:
            case "start", StartArguments():
                self.running, self.trials_done = f"run{len(self.done)}.mcap", 0
                return Started(run=self.running)
            case "resume_run", RunArguments(run=run):
                self.running = run
                return Started(run=run)
            case "answer", Answered(prompt_id=given):
                if self.prompt is None or given != self.prompt.id:
                    raise Refusal(Code.CONFLICT, f"no prompt {given} waits for an answer")
                self.prompt = None
            case "dry_run", _:
                time.sleep(self.slow_s)
                return DryRun(ok=True, duration_s=2.0, trials=3)
            case (("identify" | "draw"), RunArguments(run=run)):
                return Reported(run=run, size=len(REPORT))
            case "act", _:
                return ActionReply(said="done")
            case _ if verb.startswith("lease_"):
                return self.lease.obey(identity, verb, args)
        return Nothing()

    def stop(self, identity: str, verb: str, reason: str, user: str) -> Result:
        """End the run."""
        self.done.append((identity, verb, reason))
        self.users[verb] = user
        if self.running is None:
            return Stopped(acted=False)
        if not self.keeps_running:
            self.end("stopped", 5)
        return Stopped(acted=True)

    def verbs(self) -> list[str]:
        """Return the verbs that were carried out, but for renewals of the lease."""
        return [verb for _, verb, _ in self.done if verb != "lease_renew"]

    def _line(self, run: str) -> RunLine:
        return RunLine(
            run=run,
            procedure="small",
            state="complete",
            started_ns=0,
            duration_s=2.0,
            trials_done=3,
            trials_total=3,
            size=len(self.recording),
            has_report=True,
            has_page=True,
            identifies=run != "plain.mcap",
        )

    def _piece(self, whole: bytes, piece: PieceArguments) -> PieceView:
        if self.breaks_at is not None and piece.offset >= self.breaks_at:
            self.breaks_at = None
            raise Refusal(Code.INTERNAL, "the disk fell off")
        data = whole[piece.offset : piece.offset + piece.length]
        digest = hashlib.sha256(whole).hexdigest()
        return PieceView(size=len(whole), sha256=digest, offset=piece.offset, data=b64encode(data))


def frame_of(sequence: int) -> Frame:
    """Return a frame of one channel and two points."""
    value = np.array([[1.0, 2.0]], dtype=np.float32)
    return Frame(0, sequence, 0, np.array([0.0, 0.1]), value, value)


@dataclass
class Served:
    """An answering rig, its server, and where that is found."""

    rig: AnsweringRig
    server: Server
    endpoint: str

    def show(self) -> None:
        """Tell the status as it is now: what a test changes is else shown by the next heartbeat."""
        self.server.publisher.status(self.rig.status())

    def tell(self, kind: str, **data: Any) -> None:
        """Let something happen, and tell it to who listens."""
        self.server.publisher.event(self.rig.tell(kind, **data))


@contextmanager
def served(name: str = "lugre-1", setup: RemoteSetup | None = None) -> Iterator[Served]:
    """Serve an answering rig, by default on a free port, with carol as its maintainer."""
    setup = setup or RemoteSetup((f"tcp/127.0.0.1:{free_port()}",), roles={"carol": "maintainer"})
    lease = Lease(lambda _: True, duration_s=LEASE_S)
    with Server(name, setup, lease) as server:
        rig = AnsweringRig(name, lease)
        server.start(rig)
        yield Served(rig, server, setup.listen[0])
