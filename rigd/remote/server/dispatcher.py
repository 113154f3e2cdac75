"""Authorises, validates, de-duplicates and executes requests.

Its key says who asks for what; then the role, then the message itself, then whether it was
carried out before, then its age, then the lease.
"""

from __future__ import annotations

import hashlib
import logging
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from rigd.config.remote import RemoteSetup
from rigd.model.errors import RigdError
from rigd.remote.protocol import (
    Address,
    Code,
    Keys,
    Kind,
    Lane,
    Message,
    Refusal,
    RemoteRequest,
    Role,
    Verb,
    as_json,
    check_role,
    decode,
    encode_refusal,
    encode_reply,
    find_verb,
    request_kind,
)
from rigd.remote.protocol.arguments import ReasonArguments
from rigd.remote.protocol.limits import MAX_REQUEST_BYTES
from rigd.remote.protocol.message import check_size
from rigd.remote.server.lease import Lease
from rigd.remote.server.refused import Refused
from rigd.remote.server.requests import Requests, StoredReply
from rigd.remote.server.service import Result, Service

_log = logging.getLogger(__name__)

#: What whoever has no certificate, and no role of their own in the rig file, may do on loopback.
LOCAL_ROLE: Final = Role.OPERATOR


@dataclass(frozen=True)
class RoutedRequest:
    """A request as it came, sorted by its key alone."""

    key: str
    address: Address
    role: Role
    verb: Verb
    payload: bytes


def role_of(setup: RemoteSetup, identity: str) -> Role | None:
    """Return the role of an identity; None where it may do nothing."""
    given = setup.roles.get(identity)
    if given is not None:
        return Role(given)
    return LOCAL_ROLE if setup.tls is None else None


class Dispatcher:
    """Answers requests with what the service does.

    :meth:`sort` may be called from any thread, :meth:`answer` from one thread per lane.
    """

    def __init__(
        self,
        keys: Keys,
        setup: RemoteSetup,
        service: Service,
        lease: Lease,
        refused: Refused,
        *,
        clock: Callable[[], int] = time.monotonic_ns,
        wall: Callable[[], int] = time.time_ns,
    ) -> None:
        self._keys = keys
        self._setup = setup
        self._service = service
        self._lease = lease
        self._refused = refused
        self._requests: Mapping[Lane, Requests] = {
            lane: Requests(clock=clock, wall=wall) for lane in Lane
        }

    def sort(self, key: str, payload: bytes) -> RoutedRequest:
        """Return the request as a letter, which says in which lane it is to be answered.

        Raises:
            Refusal: the key is that of no request which its sender might make, or it is too large.
        """
        check_size(payload, MAX_REQUEST_BYTES)
        address = self._keys.address(key)
        role = role_of(self._setup, address.identity)
        if role is None:
            raise Refusal(
                Code.FORBIDDEN,
                f"{address.identity} has no role on this rig",
                hint="the rig file gives roles, under 'remote: {roles: ...}'",
            )
        verb = find_verb(address.kind, address.verb)
        check_role(role, verb, address.verb)
        return RoutedRequest(key, address, role, verb, payload)

    def refuse(self, key: str, refusal: Refusal, request_id: str = "") -> StoredReply:
        """Return the answer to what is not carried out, and count it."""
        self._refused.count(key, refusal)
        return StoredReply(False, encode_refusal(request_id, refusal))

    def answer(self, letter: RoutedRequest) -> StoredReply:
        """Carry out a request."""
        request_id = ""
        try:
            request = decode(request_kind(letter.verb.arguments), letter.payload)
            request_id = request.id
            if letter.address.kind is Kind.ASK or letter.verb.repeatable:
                return self._carry_out(letter, request)
            return self._once(letter, request)
        except Refusal as refusal:
            if refusal.code is Code.VERSION and letter.address.kind is Kind.STOP:
                refusal = self._stop_unread(letter, refusal)
            return self.refuse(letter.key, refusal, request_id)
        except Exception:  # noqa: BLE001 - as below: the thread that answers must not end
            return self._bug(letter, request_id)

    def _once(self, letter: RoutedRequest, request: RemoteRequest[Message]) -> StoredReply:
        """Carry out what changes something, unless that was done already.

        A stop is taken whatever the clocks say and however many came before it.
        """
        memory = self._requests[letter.verb.lane]
        identity = letter.address.identity
        digest = hashlib.sha256(letter.key.encode() + b"\0" + letter.payload).digest()
        answer = memory.recall(identity, request.id, digest)
        if answer is None:
            if letter.address.kind is not Kind.STOP:
                memory.admit(identity, request.sent_ns)
            answer = self._carry_out(letter, request)
            memory.remember(identity, request.id, digest, answer)
        return answer

    def _carry_out(self, letter: RoutedRequest, request: RemoteRequest[Message]) -> StoredReply:
        try:
            if letter.verb.needs_lease:
                self._lease.check(letter.address.identity)
            result = self._do(letter, request.args, request.user)
            plain = as_json(result) if isinstance(result, Message) else result
            return StoredReply(True, encode_reply(request.id, plain))
        except Refusal as refusal:
            return self.refuse(letter.key, refusal, request.id)
        except RigdError as error:
            refused = Refusal(Code.REFUSED, error.message, hint=error.hint)
            return self.refuse(letter.key, refused, request.id)
        except Exception:  # noqa: BLE001 - told to the client and logged; the daemon lives on
            return self._bug(letter, request.id)

    def _stop_unread(self, letter: RoutedRequest, refusal: Refusal) -> Refusal:
        """Carry out a stop of another version: its key says all that counts.

        The reply is in the one form that every version reads.
        """
        who, verb = letter.address.identity, letter.address.verb
        self._service.stop(who, verb, "asked for in another version of the protocol", "")
        return Refusal(refusal.code, f"{verb}: carried out; {refusal.message}", hint=refusal.hint)

    def _bug(self, letter: RoutedRequest, request_id: str) -> StoredReply:
        _log.exception("%s failed", letter.key)
        bug = Refusal(
            Code.INTERNAL,
            f"{letter.address.verb} failed in the daemon",
            hint="its log says why; this is a bug",
        )
        return self.refuse(letter.key, bug, request_id)

    def _do(self, letter: RoutedRequest, args: Message, user: str) -> Result:
        address, role = letter.address, letter.role
        if isinstance(args, ReasonArguments):
            return self._service.stop(address.identity, address.verb, args.reason, user)
        if address.kind is Kind.ASK:
            return self._service.ask(address.identity, role, address.verb, args)
        return self._service.command(address.identity, role, address.verb, args, user)
