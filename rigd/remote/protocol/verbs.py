"""The table of verbs: role, lane, arguments and result of each request."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import Enum
from typing import Final

from rigd.model.severity import STOPS
from rigd.remote.protocol.arguments import (
    ActArguments,
    Answered,
    Checked,
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
    Reported,
    RunList,
    RunView,
    Started,
    Stopped,
)
from rigd.remote.protocol.roles import Role
from rigd.remote.protocol.status import LeaseView


class Lane(Enum):
    """Requests of one lane are carried out one after the other, beside those of other lanes."""

    STOP = "stop"
    ASK = "ask"  #: known at once
    LEASE = "lease"  #: of its own, so that no command keeps a lease from being renewed
    COMMAND = "command"
    CHECK = "check"  #: compiled
    FILES = "files"  #: read from recordings and procedure files
    LONG = "long"  #: calculated: dry runs and reports


#: How long a client waits for a reply before it takes it for lost, in s.
PATIENCE_S: Final[Mapping[Lane, float]] = {
    Lane.STOP: 2.0,
    Lane.ASK: 2.0,
    Lane.LEASE: 2.0,
    Lane.COMMAND: 10.0,
    Lane.CHECK: 30.0,
    Lane.FILES: 30.0,
    Lane.LONG: 900.0,
}


@dataclass(frozen=True)
class Verb:
    """One verb: what it is asked with and answered with, its lane, and who may use it.

    ``repeatable``: done again it changes nothing more, so it may be sent twice, and at any age.
    """

    arguments: type[Message]
    result: type[Message]
    lane: Lane
    role: Role = Role.OBSERVER
    needs_lease: bool = False
    repeatable: bool = False


def _lease(arguments: type[Message] = NoArguments, role: Role = Role.OPERATOR) -> Verb:
    return Verb(arguments, LeaseView, Lane.LEASE, role)


def _lead(
    arguments: type[Message] = NoArguments,
    result: type[Message] = Nothing,
    lane: Lane = Lane.COMMAND,
    role: Role = Role.OPERATOR,
) -> Verb:
    """Return a verb that needs the lease."""
    return Verb(arguments, result, lane, role, needs_lease=True)


VERBS: Final[Mapping[Kind, Mapping[str, Verb]]] = {
    Kind.ASK: {
        "describe": Verb(NoArguments, Description, Lane.ASK),
        "events": Verb(Since, Events, Lane.ASK),
        "latest": Verb(NoArguments, LatestValues, Lane.ASK),
        "history": Verb(StreamName, History, Lane.ASK),
        "lease": Verb(NoArguments, LeaseView, Lane.ASK),
        "procedures": Verb(NoArguments, Procedures, Lane.FILES),
        "procedure": Verb(ProcedureName, ProcedureView, Lane.FILES),
        "check": Verb(Checked, CheckReport, Lane.CHECK),
        "runs": Verb(Runs, RunList, Lane.FILES),
        "run": Verb(RunArguments, RunView, Lane.FILES),
        "report": Verb(ReportPiece, PieceView, Lane.FILES),
        "fetch": Verb(PieceArguments, PieceView, Lane.FILES),
    },
    Kind.COMMAND: {
        "lease_take": _lease(),
        # Whatever the clocks say: a clock that is set must not end the run of who is there.
        "lease_renew": replace(_lease(), repeatable=True),
        "lease_release": _lease(),
        "lease_request": _lease(),
        "lease_give": _lease(Receiver),
        "lease_seize": _lease(role=Role.MAINTAINER),
        "start": _lead(StartArguments, Started),
        "resume_run": _lead(ResumeRun, Started),
        "pause": _lead(),
        "resume": _lead(),
        "answer": _lead(Answered),
        "acknowledge": _lead(InterlockName),
        "act": _lead(ActArguments, ActionReply, role=Role.MAINTAINER),
        "identify": _lead(RunArguments, Reported, Lane.LONG),
        "draw": Verb(RunArguments, Reported, Lane.LONG, Role.OPERATOR),
        "dry_run": Verb(Checked, DryRun, Lane.LONG, Role.OPERATOR),
    },
    Kind.STOP: {stop.word: Verb(ReasonArguments, Stopped, Lane.STOP) for stop in STOPS},
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


def check_role(role: Role, verb: Verb, name: str) -> None:
    """Check that ``role`` may use ``verb``.

    Raises:
        Refusal: it may not.
    """
    if not role.includes(verb.role):
        raise Refusal(
            Code.FORBIDDEN,
            f"{name} needs the role {verb.role.value}, yours is {role.value}",
            hint="the rig file gives roles, under 'remote: {roles: ...}'",
        )
