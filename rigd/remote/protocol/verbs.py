"""Every verb of the protocol in one table: who may use it, and what it is asked with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Final

from rigd.remote.protocol.arguments import (
    Act,
    Answered,
    Checked,
    InterlockName,
    NoArguments,
    Piece,
    ProcedureName,
    Reason,
    Receiver,
    Run,
    Runs,
    Since,
    Start,
    StreamName,
)
from rigd.remote.protocol.keys import Kind
from rigd.remote.protocol.message import Message
from rigd.remote.protocol.refusal import Code, Refusal


class Role(Enum):
    """What an identity may do; each may do what the one before may."""

    OBSERVER = "observer"  #: see everything, and stop
    OPERATOR = "operator"  #: run procedures
    MAINTAINER = "maintainer"  #: act on devices, take the lease from another

    def includes(self, other: Role) -> bool:
        """Whether this role may do what ``other`` may."""
        order = list(Role)
        return order.index(self) >= order.index(other)


class Lane(Enum):
    """Requests of one lane are carried out one after the other, beside those of other lanes."""

    STOP = "stop"
    ASK = "ask"  #: known at once
    COMMAND = "command"
    FILES = "files"  #: read from recordings and procedure files
    LONG = "long"  #: calculated: dry runs and reports


#: How long a client waits for a reply before it takes it for lost, in s.
PATIENCE_S: Final[Mapping[Lane, float]] = {
    Lane.STOP: 2.0,
    Lane.ASK: 2.0,
    Lane.COMMAND: 10.0,
    Lane.FILES: 30.0,
    Lane.LONG: 900.0,
}


@dataclass(frozen=True)
class Verb:
    """One verb: the least role it needs, whether it needs the lease, its lane, its arguments."""

    role: Role
    needs_lease: bool
    lane: Lane
    arguments: type[Message] = NoArguments


def _ask(arguments: type[Message] = NoArguments, lane: Lane = Lane.ASK) -> Verb:
    return Verb(Role.OBSERVER, False, lane, arguments)


def _lead(arguments: type[Message] = NoArguments, lane: Lane = Lane.COMMAND) -> Verb:
    return Verb(Role.OPERATOR, True, lane, arguments)


def _free(arguments: type[Message] = NoArguments, lane: Lane = Lane.COMMAND) -> Verb:
    return Verb(Role.OPERATOR, False, lane, arguments)


def _stop() -> Verb:
    return Verb(Role.OBSERVER, False, Lane.STOP, Reason)


VERBS: Final[Mapping[Kind, Mapping[str, Verb]]] = {
    Kind.ASK: {
        "describe": _ask(),
        "events": _ask(Since),
        "latest": _ask(),
        "history": _ask(StreamName),
        "lease": _ask(),
        "procedures": _ask(lane=Lane.FILES),
        "procedure": _ask(ProcedureName, Lane.FILES),
        "check": _ask(Checked, Lane.FILES),
        "runs": _ask(Runs, Lane.FILES),
        "run": _ask(Run, Lane.FILES),
        "report": _ask(Piece, Lane.FILES),
        "fetch": _ask(Piece, Lane.FILES),
    },
    Kind.COMMAND: {
        "lease_take": _free(),
        "lease_renew": _free(),
        "lease_release": _free(),
        "lease_request": _free(),
        "lease_give": _lead(Receiver),
        "lease_seize": Verb(Role.MAINTAINER, False, Lane.COMMAND),
        "start": _lead(Start),
        "pause": _lead(),
        "resume": _lead(),
        "answer": _lead(Answered),
        "acknowledge": _lead(InterlockName),
        "resume_run": _lead(Run),
        "identify": _lead(Run, Lane.LONG),
        "dry_run": _free(Checked, Lane.LONG),
        "act": Verb(Role.MAINTAINER, True, Lane.COMMAND, Act),
    },
    Kind.STOP: {
        "stop": _stop(),
        "abort": _stop(),
        "estop": _stop(),
    },
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
