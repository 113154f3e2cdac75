"""Authorises, validates and executes requests; a repeated command is not executed twice.

The dispatcher checks, in this order:

1. the key, which states the client and its request;
2. the role of the client;
3. of a question: whether the client asks too many;
4. the message itself;
5. whether the request was carried out before;
6. the age of the request;
7. the lease (the right to command the rig).
"""

from __future__ import annotations

import hashlib
import logging
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
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
    Requester,
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
from rigd.remote.protocol.limits import ASK_BURST, ASK_PER_S, MAX_REQUEST_BYTES
from rigd.remote.protocol.message import check_size
from rigd.remote.protocol.verbs import PATIENCE_S
from rigd.remote.request_rates import BucketByClient
from rigd.remote.server.lease import Lease
from rigd.remote.server.refusal_log import Refused, TooManyQuestions
from rigd.remote.server.requests import Requests, StoredReply
from rigd.remote.server.service import Service

_log = logging.getLogger(__name__)

#: The role, on loopback, of a client without certificate that the rig file gives none.
LOCAL_ROLE: Final = Role.OPERATOR
#: How long the requests of a lane may wait for one another, as their clients do.
_WAIT_S: Final = {Lane.LONG: PATIENCE_S[Lane.LONG]}


@dataclass(frozen=True)
class RoutedRequest:
    """A request as received; only its key has been read."""

    key: str
    address: Address
    role: Role
    verb: Verb
    payload: bytes
    came_ns: int  #: on the monotonic clock
    stops: int  #: how many stops had been carried out when it came


@lru_cache
def _refusal_of_flood(identity: str) -> bytes:
    """Return the reply to a question that is beyond the rate of a client: it is made once."""
    return encode_refusal("", TooManyQuestions(identity))


def role_of(setup: RemoteSetup, identity: str) -> Role | None:
    """Return the role of an identity; None if it has no rights."""
    given = setup.roles.get(identity)
    if given is not None:
        return Role(given)
    return LOCAL_ROLE if setup.tls is None else None


class Dispatcher:
    """Checks requests, lets the service carry them out, and returns the replies.

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
        self._clock = clock
        self._questions = BucketByClient(ASK_PER_S, ASK_BURST, lambda: clock() * 1e-9)
        self._requests: Mapping[Lane, Requests] = {
            lane: Requests(wait_s=_WAIT_S.get(lane, 0.0), clock=clock, wall=wall) for lane in Lane
        }

    def sort(self, key: str, payload: bytes, session: str = "") -> RoutedRequest:
        """Return the parsed request, with the lane in which it must be answered.

        ``session`` is the id of the session from which it came, if that is known. Without
        certificates it stands for the client, which can give itself any name.

        Raises:
            TooManyQuestions: its sender asks more than it may.
            Refusal: the key is not one that its sender may use, or the request is too large.
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
        check_role(role, verb)
        if address.kind is Kind.ASK:
            self.check_rate(address.identity, session)
        stops = self._service.stops
        return RoutedRequest(key, address, role, verb, payload, self._clock(), stops)

    def check_rate(self, identity: str, session: str) -> None:
        """Count a question, of ``identity`` or of its session if it has no certificate.

        Raises:
            TooManyQuestions: it asks more than it may.
        """
        sender = session if session and self._setup.tls is None else identity
        if not self._questions.take(sender):
            raise TooManyQuestions(identity)

    def refuse(self, key: str, refusal: Refusal, request_id: str = "") -> StoredReply:
        """Return the answer to a refused request, and count it."""
        self._refused.count(key, refusal)
        if isinstance(refusal, TooManyQuestions) and not request_id:
            return StoredReply(False, _refusal_of_flood(refusal.identity))
        return StoredReply(False, encode_refusal(request_id, refusal))

    def answer(self, routed: RoutedRequest) -> StoredReply:
        """Carry out a request."""
        request_id = ""
        try:
            request = decode(request_kind(routed.verb.arguments), routed.payload)
            request_id = request.id
            if routed.address.kind is Kind.ASK or routed.verb.rule.repeatable:
                return self._carry_out(routed, request)
            return self._once(routed, request)
        except Refusal as refusal:
            if routed.address.kind is Kind.STOP:
                return self._stop_unread(routed, request_id, refusal)
            return self.refuse(routed.key, refusal, request_id)
        except Exception:  # noqa: BLE001 - as below: the thread that answers must not end
            return self._bug(routed, request_id)

    def _once(self, routed: RoutedRequest, request: RemoteRequest[Message]) -> StoredReply:
        """Carry out a verb that changes something, unless it was carried out already.

        A stop is accepted at any age and after any number of stops.
        """
        memory = self._requests[routed.verb.rule.lane]
        identity = routed.address.identity
        digest = hashlib.sha256(routed.key.encode() + b"\0" + routed.payload).digest()
        answer = memory.recall(identity, request.id, digest)
        if answer is None:
            if routed.address.kind is not Kind.STOP:
                memory.admit(identity, request.sent_ns, self._clock() - routed.came_ns)
            answer = self._carry_out(routed, request)
            memory.remember(identity, request.id, digest, answer)
        return answer

    def _carry_out(self, routed: RoutedRequest, request: RemoteRequest[Message]) -> StoredReply:
        try:
            identity = routed.address.identity
            requester = Requester(
                identity, request.user, routed.role, routed.stops, request.certificate_until_ns
            )
            if routed.verb.rule.needs_lease:
                self._lease.check(requester.client)
            result = self._service.answer(routed.verb, requester, request.args)
            return StoredReply(True, encode_reply(request.id, as_json(result)))
        except Refusal as refusal:
            return self.refuse(routed.key, refusal, request.id)
        except RigdError as error:
            refused = Refusal(Code.REFUSED, error.message, hint=error.hint)
            return self.refuse(routed.key, refused, request.id)
        except Exception:  # noqa: BLE001 - reported to the client and logged; the daemon goes on
            return self._bug(routed, request.id)

    def _stop_unread(self, routed: RoutedRequest, request_id: str, refusal: Refusal) -> StoredReply:
        """Carry out a stop with an invalid message: its key contains all required data.

        The reply has the form that every version can read.
        """
        requester = Requester(routed.address.identity, role=routed.role)
        reason = ReasonArguments(reason=f"by a message that is refused: {refusal.message}")
        try:
            self._service.answer(routed.verb, requester, reason)
        except Exception:  # noqa: BLE001 - the thread that answers must not end
            return self._bug(routed, request_id)
        done = f"{routed.verb.name}: carried out; {refusal.message}"
        return self.refuse(routed.key, Refusal(refusal.code, done, hint=refusal.hint), request_id)

    def _bug(self, routed: RoutedRequest, request_id: str) -> StoredReply:
        _log.exception("%s failed", routed.key)
        bug = Refusal(
            Code.INTERNAL,
            f"{routed.address.verb} failed in the daemon",
            hint="its log has the reason; this is a bug",
        )
        return self.refuse(routed.key, bug, request_id)
