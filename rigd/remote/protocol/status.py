"""Defines the status and the events that a daemon sends to clients.

The daemon sends both at every change. It also sends the status regularly, as a heartbeat.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import Field

from rigd.remote.protocol.message import DaemonData, DaemonText, Message, Name, User, Version

Count = Annotated[int, Field(ge=0)]
Nanoseconds = Annotated[int, Field(ge=0, lt=2**63)]

#: The states of a run (:class:`rigd.model.states.RunState`).
State = Literal[
    "idle", "preflight", "blocked", "armed", "running", "pausing", "held", "paused", "stopping",
    "finishing", "aborting", "faulted", "estopped", "done",
]  # fmt: skip


#: What an interlock does, in words of :class:`rigd.model.severity.Severity`.
ActionName = Literal["warn", "end_trial", "stop", "abort", "estop"]


class Daemon(Message):
    """The process of the daemon."""

    version: DaemonText
    pid: Count
    started_ns: Nanoseconds
    descriptors: Count = 0
    """Files and connections that it has open."""
    descriptors_most: Count = 0
    """Its limit; 0 if unknown."""
    unauthenticated_ended: Count = 0
    """Unauthenticated connections that it has ended to stay below that."""
    accept_pauses: Count = 0
    """How often it accepted no connection for a while, as too many were unauthenticated."""


class TrialStatus(Message):
    """The trial under way."""

    number: Count
    repeat: Count
    parameters: dict[str, float | str | bool]
    """Quantities in SI."""
    units: dict[str, str] = Field(default_factory=dict)
    """The units of the quantities, as the procedure has them."""
    label: DaemonText = ""
    """Its difference from other trials, for people: ``current 0.15 A, repeat 2``."""


class PromptView(Message):
    """A question that waits for an answer."""

    id: Count
    """Each time a prompt is put, it has an id of its own."""
    name: DaemonText
    text: DaemonText
    kind: Literal["confirm", "number", "choice", "text"]
    unit: DaemonText = "1"
    """Of a number; the answer, `low` and `high` are in SI."""
    low: float | None = None
    high: float | None = None
    choices: tuple[DaemonText, ...] = ()
    answer: float | str | bool | None = None
    """The procedure's own answer."""
    objection: DaemonText = ""
    """The reason against the previous answer."""


class ClientUser(Message):
    """A client, and the user that it names."""

    identity: Name
    user: User = ""
    """A person at the client, as the client reports; empty if it serves one person only."""

    @classmethod
    def of(cls, identity: str, user: str = "") -> Self:
        """Return a user of a client; without ``user`` the client alone."""
        return cls(identity=identity, user=user)

    def __str__(self) -> str:
        return f"{self.user} ({self.identity})" if self.user else self.identity


class LeaseView(Message):
    """The client and user that may command the rig."""

    holder: ClientUser | None = None
    until_ns: Nanoseconds = 0
    """When the lease ends unless it is renewed, in ns since the Unix epoch; 0 if it is free."""
    asked_by: tuple[ClientUser, ...] = ()
    """Clients and users that ask the holder for the lease, the first first."""

    def is_held_by(self, identity: str) -> bool:
        """Return whether a client that names no user holds the lease."""
        return self.holder == ClientUser.of(identity)


class TripView(Message):
    """An interlock that has acted."""

    interlock: DaemonText
    action: ActionName
    message: DaemonText
    since_ns: Nanoseconds
    latched: bool
    """Whether it waits for a person to acknowledge it."""
    acknowledged: bool


class Interrupted(Message):
    """A run that ended before its last trial; `resume_run` goes on with it."""

    run: DaemonText
    reason: DaemonText
    trials_done: Count
    trials_total: Count


class LastRun(Message):
    """How the last run ended."""

    run: DaemonText
    ending: DaemonText
    reason: DaemonText
    exit_code: Count
    """As `rigd run` would have exited."""
    recorded: bool = True
    """Whether it has a recording: a run that preflight refused has none."""


class RefusedCounts(Message):
    """How many messages were refused since the daemon started."""

    malformed: Count = 0
    oversized: Count = 0
    replayed: Count = 0
    forbidden: Count = 0
    too_many: Count = 0
    """Questions of clients that asked more than they may."""


class OperatorNotice(Message):
    """A line for the operator of the rig."""

    t_ns: Nanoseconds
    level: Literal["info", "warning", "error"]
    text: DaemonText


class CertificateView(Message):
    """A certificate that expires soon, or has expired: clients cannot connect by it any more."""

    whose: Literal["daemon", "authority", "client"]
    name: DaemonText
    """Of its file; of a client its name."""
    until_ns: Nanoseconds
    """When it expires, in ns since the Unix epoch."""


class Status(Message):
    """Everything about a rig that is not a sample."""

    v: Version
    rig: Name
    title: DaemonText
    t_ns: Nanoseconds
    """Its time, in ns since the Unix epoch."""
    rows_ns: Nanoseconds
    """The same time on the clock of live data, which does not follow a step of the system clock."""
    seq: Count
    """Counts the status messages of this daemon."""
    daemon: Daemon
    state: State
    procedure: DaemonText | None = None
    run: DaemonText | None = None
    """File name of the recording under way."""
    step: DaemonText | None = None
    can_hold: bool = False
    """Whether a pause holds this step; else it waits for one that does, or the end of the trial."""
    trial: TrialStatus | None = None
    trials_done: Count = 0
    trials_total: Count = 0
    run_s: Annotated[float, Field(ge=0)] = 0.0
    """Since the run began."""
    left_s: Annotated[float, Field(ge=0)] | None = None
    """Estimated time until it ends; null if unknown, or if it has ended."""
    pause_in_s: Annotated[float, Field(ge=0)] | None = None
    """While `pausing`: the time after which the pause has begun at the latest; null if unknown."""
    waits: DaemonText = ""
    """While `held` or `paused`: what the setpoints do, and what `resume` plays next."""
    ending: DaemonText = ""
    """How the run in progress ends, once that is known, as in `LastRun`; the rig is made safe."""
    coming_to_rest: bool = False
    """Whether rows are recorded on after the end of the run in progress, until the rig rests."""
    prompt: PromptView | None = None
    lease: LeaseView = LeaseView()
    trips: tuple[TripView, ...] = ()
    interrupted: tuple[Interrupted, ...] = ()
    last: LastRun | None = None
    refused: RefusedCounts = RefusedCounts()
    notices: tuple[OperatorNotice, ...] = ()
    """The newest 20, the newest last."""
    certificates: tuple[CertificateView, ...] = ()
    """Those that expire within 30 days, or have expired; of clients, of those that were seen."""


class RigEvent(Message):
    """Something that happened; the same as in the recording."""

    v: Version
    seq: Count
    """Counts the events of this daemon: a gap is a missed event, which `events` returns."""
    t_ns: Nanoseconds
    kind: DaemonText
    trial: int = -1
    """-1 outside of every trial."""
    data: DaemonData = Field(default_factory=dict)
    """Its details; a NaN or an infinity as text, as in the recording."""


def as_json(message: Message) -> dict[str, Any]:
    """Return a message as plain data, such as the result of a request."""
    return message.model_dump(mode="json")
