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


@dataclass(frozen=True)
class Verb:
    """One verb: the least role it needs, whether it needs the lease, its arguments."""

    role: Role = Role.OBSERVER
    needs_lease: bool = False
    arguments: type[Message] = NoArguments


def _ask(arguments: type[Message] = NoArguments) -> Verb:
    return Verb(arguments=arguments)


def _operate(arguments: type[Message] = NoArguments, *, needs_lease: bool = True) -> Verb:
    return Verb(Role.OPERATOR, needs_lease, arguments)


def _maintain(arguments: type[Message] = NoArguments, *, needs_lease: bool = True) -> Verb:
    return Verb(Role.MAINTAINER, needs_lease, arguments)


VERBS: Final[Mapping[Kind, Mapping[str, Verb]]] = {
    Kind.ASK: {
        "describe": _ask(),
        "procedures": _ask(),
        "procedure": _ask(ProcedureName),
        "check": _ask(Checked),
        "runs": _ask(Runs),
        "run": _ask(Run),
        "report": _ask(Piece),
        "fetch": _ask(Piece),
        "events": _ask(Since),
        "latest": _ask(),
        "lease": _ask(),
    },
    Kind.COMMAND: {
        "lease_take": _operate(needs_lease=False),
        "lease_renew": _operate(needs_lease=False),
        "lease_release": _operate(needs_lease=False),
        "lease_request": _operate(needs_lease=False),
        "lease_give": _operate(Receiver),
        "lease_seize": _maintain(needs_lease=False),
        "start": _operate(Start),
        "pause": _operate(),
        "resume": _operate(),
        "answer": _operate(Answered),
        "acknowledge": _operate(InterlockName),
        "resume_run": _operate(Run),
        "identify": _operate(Run),
        "dry_run": _operate(Checked, needs_lease=False),
        "act": _maintain(Act),
    },
    Kind.STOP: {
        "stop": _ask(Reason),
        "abort": _ask(Reason),
        "estop": _ask(Reason),
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
