"""Defines the table of verbs (kinds of request): arguments, result, role, lane and handler of each.

A lane is a queue with its own thread.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from enum import Enum
from types import NoneType
from typing import Annotated, Any, Final, TypeAlias, TypeVar, get_args, get_type_hints

from rigd.remote.protocol.arguments import (
    ActArguments,
    Answered,
    CalibrateArguments,
    Checked,
    ComparedRuns,
    InterlockName,
    NoArguments,
    PieceArguments,
    ProcedureName,
    ReasonArguments,
    Receiver,
    ReportPiece,
    ResumeRun,
    RunArguments,
    Runs,
    Since,
    StartArguments,
    StreamName,
)
from rigd.remote.protocol.keys import Kind
from rigd.remote.protocol.message import Message
from rigd.remote.protocol.refusal import Code, Refusal
from rigd.remote.protocol.results import (
    ActionReply,
    CheckReport,
    Description,
    DryRun,
    Events,
    History,
    LatestValues,
    Nothing,
    PieceView,
    Procedures,
    ProcedureView,
    RenewedCalibration,
    Reported,
    RunList,
    RunView,
    Started,
    Stopped,
)
from rigd.remote.protocol.roles import Role
from rigd.remote.protocol.status import ClientUser, LeaseView

A = TypeVar("A", bound=Message)
R = TypeVar("R", bound=Message | None)


class Lane(Enum):
    """Requests of one lane are carried out one after the other, in parallel to other lanes."""

    STOP = "stop"
    ASK = "ask"  #: known at once
    LEASE = "lease"  #: of its own, so that no command keeps a lease from being renewed
    COMMAND = "command"
    CHECK = "check"  #: compiled
    FILES = "files"  #: read from recordings and procedure files
    LONG = "long"  #: calculated: dry runs and reports
    COMPARE = "compare"  #: calculated for everyone, so that no observer keeps an operator waiting


#: How long a client waits for a reply, in s; after that the reply counts as lost.
PATIENCE_S: Final[Mapping[Lane, float]] = {
    Lane.STOP: 2.0,
    Lane.ASK: 2.0,
    Lane.LEASE: 2.0,
    Lane.COMMAND: 10.0,
    Lane.CHECK: 30.0,
    Lane.FILES: 30.0,
    Lane.LONG: 900.0,
    Lane.COMPARE: 900.0,
}


@dataclass(frozen=True)
class Requester:
    """The origin of a request: a client by its ``identity``, and the ``user`` that it names."""

    identity: str
    user: str = ""
    role: Role = Role.OBSERVER
    stops: int = 0  #: how many stops the daemon had carried out when the request came
    certificate_until_ns: int = 0  #: when its certificate expires, as it says; 0: unknown

    @property
    def client(self) -> ClientUser:
        """The client and user that the lease belongs to."""
        return ClientUser.of(self.identity, self.user)

    def __str__(self) -> str:
        return str(self.client)


@dataclass(frozen=True)
class VerbRule:
    """The conditions under which a verb is carried out."""

    kind: Kind
    lane: Lane
    role: Role = Role.OBSERVER
    needs_lease: bool = False
    repeatable: bool = False  #: a second time changes nothing: may be sent twice, and at any age
    moves: bool = False  #: the rig may move, or its data change: only while it can be audited
    audited: bool = True


#: A function that carries out a verb. It raises :class:`Refusal`, or another error of rigd's, if it
#: cannot.
Handler: TypeAlias = Callable[[Requester, A], R]

_ASK = VerbRule(Kind.ASK, Lane.ASK)
_FILES = VerbRule(Kind.ASK, Lane.FILES)
_LEASE = VerbRule(Kind.COMMAND, Lane.LEASE, Role.OPERATOR)
_STEER = VerbRule(Kind.COMMAND, Lane.COMMAND, Role.OPERATOR, needs_lease=True)
_START = replace(_STEER, moves=True)
_LONG = VerbRule(Kind.COMMAND, Lane.LONG, Role.OPERATOR)
_STOP = VerbRule(Kind.STOP, Lane.STOP)


@dataclass(frozen=True)
class Handlers:
    """The table of verbs, with the function that carries out each verb on one rig.

    A field is a verb; its type holds the arguments and the result (None: a reply without content),
    its annotation the rule. A handler that is missing, or that has other types, fails mypy.
    """

    describe: Annotated[Handler[NoArguments, Description], _ASK]
    events: Annotated[Handler[Since, Events], _ASK]
    latest: Annotated[Handler[NoArguments, LatestValues], _ASK]
    history: Annotated[Handler[StreamName, History], _ASK]
    lease: Annotated[Handler[NoArguments, LeaseView], _ASK]
    procedures: Annotated[Handler[NoArguments, Procedures], _FILES]
    procedure: Annotated[Handler[ProcedureName, ProcedureView], _FILES]
    check: Annotated[Handler[Checked, CheckReport], VerbRule(Kind.ASK, Lane.CHECK)]
    runs: Annotated[Handler[Runs, RunList], _FILES]
    run: Annotated[Handler[RunArguments, RunView], _FILES]
    report: Annotated[Handler[ReportPiece, PieceView], _FILES]
    fetch: Annotated[Handler[PieceArguments, PieceView], _FILES]
    compare: Annotated[Handler[ComparedRuns, PieceView], replace(_ASK, lane=Lane.COMPARE)]

    lease_take: Annotated[Handler[NoArguments, LeaseView], _LEASE]
    # At any age: a clock that is set must not take the lease from a connected client.
    lease_renew: Annotated[
        Handler[NoArguments, LeaseView], replace(_LEASE, repeatable=True, audited=False)
    ]
    lease_release: Annotated[Handler[NoArguments, LeaseView], _LEASE]
    lease_request: Annotated[Handler[NoArguments, LeaseView], _LEASE]
    lease_give: Annotated[Handler[Receiver, LeaseView], _LEASE]
    lease_seize: Annotated[Handler[NoArguments, LeaseView], replace(_LEASE, role=Role.MAINTAINER)]
    start: Annotated[Handler[StartArguments, Started], _START]
    resume_run: Annotated[Handler[ResumeRun, Started], _START]
    pause: Annotated[Handler[NoArguments, None], _STEER]
    resume: Annotated[Handler[NoArguments, None], _STEER]
    answer: Annotated[Handler[Answered, None], _STEER]
    acknowledge: Annotated[Handler[InterlockName, None], _STEER]
    act: Annotated[Handler[ActArguments, ActionReply], replace(_START, role=Role.MAINTAINER)]
    identify: Annotated[Handler[RunArguments, Reported], replace(_STEER, lane=Lane.LONG)]
    calibrate: Annotated[
        Handler[CalibrateArguments, RenewedCalibration], replace(_START, lane=Lane.LONG)
    ]
    draw: Annotated[Handler[RunArguments, Reported], replace(_LONG, audited=False)]
    dry_run: Annotated[Handler[Checked, DryRun], _LONG]

    stop: Annotated[Handler[ReasonArguments, Stopped], _STOP]
    abort: Annotated[Handler[ReasonArguments, Stopped], _STOP]
    estop: Annotated[Handler[ReasonArguments, Stopped], _STOP]


@dataclass(frozen=True)
class Verb:
    """A row of the table."""

    name: str
    arguments: type[Message]
    result: type[Message]
    rule: VerbRule

    def carry_out(self, handlers: Handlers, requester: Requester, args: Message) -> Message:
        """Return the result of this verb's handler; raises its exceptions."""
        handler: Handler[Any, Message | None] = getattr(handlers, self.name)
        result = handler(requester, args)
        return Nothing() if result is None else result


def _verb(name: str, annotation: Any) -> Verb:
    handler, rule = get_args(annotation)
    (_, arguments), result = get_args(handler)
    return Verb(name, arguments, Nothing if result is NoneType else result, rule)


_ROWS = [_verb(*field) for field in get_type_hints(Handlers, include_extras=True).items()]
VERBS: Final[Mapping[Kind, Mapping[str, Verb]]] = {
    kind: {verb.name: verb for verb in _ROWS if verb.rule.kind is kind}
    for kind in (Kind.ASK, Kind.COMMAND, Kind.STOP)
}


def find_verb(kind: Kind, name: str) -> Verb:
    """Return the verb of that name.

    Raises:
        Refusal: there is none.
    """
    try:
        return VERBS[kind][name]
    except KeyError:
        raise Refusal(
            Code.UNKNOWN_VERB,
            f"{kind.value} has no verb {name!r}",
            hint="known: " + ", ".join(VERBS[kind]),
        ) from None


def check_role(role: Role, verb: Verb) -> None:
    """Check that ``role`` may use ``verb``.

    Raises:
        Refusal: it may not.
    """
    needed = verb.rule.role
    if not role.includes(needed):
        raise Refusal(
            Code.FORBIDDEN,
            f"{verb.name} needs the role {needed.value}, yours is {role.value}",
            hint="the rig file gives roles, under 'remote: {roles: ...}'",
        )
