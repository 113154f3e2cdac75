"""Connects a client to the daemon of one rig: requests, replies, status and events.

If a request gets no reply, the client sends the same bytes once more. The daemon recognises the
request by its id and carries it out only once.
"""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import AsyncGenerator, AsyncIterator, Coroutine, Mapping
from contextlib import suppress
from dataclasses import replace
from typing import Any, Final, Generic, Self, TypeVar

import zenoh

from rigd.model.errors import ConfigError, LinkError, ProtocolError
from rigd.remote.client.decoding import decode_or_raise
from rigd.remote.client.payload_queue import PayloadQueue
from rigd.remote.client.queries import query, rigs_alive
from rigd.remote.client.rigs.target import Target
from rigd.remote.client.session import (
    QUESTION_S,
    QueryReply,
    TimedOut,
    close_session,
    doubt,
    is_connected,
    listen,
    open_session,
)
from rigd.remote.protocol import (
    PATIENCE_S,
    Code,
    Keys,
    Kind,
    Message,
    RigEvent,
    Status,
    decode,
    decode_refusal,
    encode_request,
    find_verb,
    new_request,
)
from rigd.remote.protocol.message import Version
from rigd.remote.protocol.request import RequestId

R = TypeVar("R")

#: If the connection is lost, a request waits so long for it and then fails, in s; zenoh tries to
#: connect every second.
RECONNECT_S: Final = 3.0
#: A daemon that has published no status for so long is gone, in s, also while it may take longer
#: for a request: it publishes its status twice a second.
SILENCE_S: Final = 5.0
#: How often to check the connection and the daemon, in s.
_RECONNECTED_S: Final = 0.05
_STILL_THERE_S: Final = 1.0
#: A question that the daemon refuses because others wait is put again after this, in s.
_ASK_AGAIN_S: Final = 0.2
#: How many payloads wait for their reader; beyond that the oldest are dropped.
STATUSES: Final = 32
EVENTS: Final = 1024
FRAMES: Final = 64


class _ReplyOf(Message, Generic[R]):
    """A reply whose result is an ``R``."""

    v: Version
    id: RequestId
    result: R


class Connection:
    """An open connection to a daemon; made by :meth:`open`, used on one event loop.

    Every request raises :class:`~rigd.model.errors.LinkError` with a hint if no daemon answers;
    :class:`~rigd.remote.protocol.Refusal` if it is not carried out; and
    :class:`~rigd.model.errors.ProtocolError` if the answer is invalid.
    """

    def __init__(self, session: zenoh.Session, keys: Keys, target: Target) -> None:
        self.keys = keys
        self._session = session
        self._target = target
        self._mailboxes: set[PayloadQueue] = set()
        self._heard_s = time.monotonic()
        listen(session, keys.status, self._hear)

    @classmethod
    async def open(cls, target: Target) -> Self:
        """Connect to the daemon of a rig.

        Raises:
            LinkError: no daemon admits this client there, or there is no such rig.
            ConfigError: there are several rigs, and none is named.
        """
        session = await asyncio.to_thread(open_session, target)
        try:
            rig = target.rig or await _only_rig(session, target)
            connection = cls(session, Keys(rig), target)
            # Not decoded: a client can stop a rig whose daemon is of another version.
            await connection.ask_status()
        except BaseException:
            await asyncio.to_thread(close_session, session)
            raise
        return connection

    @property
    def rig(self) -> str:
        """The name of the rig."""
        return self.keys.rig

    @property
    def identity(self) -> str:
        """The name under which the daemon knows this client."""
        return self._target.identity

    @property
    def silent_s(self) -> float:
        """The time since the last message of the daemon."""
        return time.monotonic() - self._heard_s

    async def close(self) -> None:
        """End all subscriptions, and disconnect; closing twice is silent."""
        for mailbox in self._mailboxes:
            mailbox.close()
        await asyncio.to_thread(close_session, self._session)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def status(self) -> Status:
        """Return the newest status.

        Raises:
            LinkError: there is no daemon of that rig, or it gives this client no role.
            ProtocolError: it is of another version.
        """
        return decode_or_raise(Status, await self.ask_status())

    async def ask_status(self) -> bytes:
        """Return the bytes of the newest status; see :meth:`status`."""
        await self._connected()
        try:
            for answer in await query(self._session, self.keys.status, QUESTION_S):
                if answer.ok:
                    return answer.payload
        except TimedOut:
            pass
        alive = await rigs_alive(self._session)
        if alive and self.rig not in alive:
            raise LinkError(
                f"there is no rig {self.rig} at {self._target.endpoint}",
                hint=f"there is {', '.join(alive)}",
            )
        raise LinkError(
            f"no daemon of {self.rig} answers at {self._target.endpoint}",
            hint=f"is it running (rigd serve)? With certificates, {self.identity} also needs a "
            "role in its rig file",
        )

    async def request(
        self, kind: Kind, verb: str, args: Mapping[str, Any], result: type[R], user: str = ""
    ) -> R:
        """Make a request, and return its result.

        ``user`` is the user of the request, if this client acts for several people.

        Raises:
            LinkError: no daemon answered.
            Refusal: it is not carried out, or is not allowed in this form.
            ProtocolError: the answer is invalid.
        """
        wanted = decode(find_verb(kind, verb).arguments, json.dumps(dict(args)).encode())
        request = new_request(wanted, user, self._target.certificate_until_ns)
        found = await self._patiently(kind, verb, encode_request(request))
        if len(found) != 1:
            raise ProtocolError(
                f"{verb} got {len(found)} answers, expected one",
                hint="do two daemons of this name run at one address?",
            )
        [answer] = found
        if not answer.ok:
            raise decode_refusal(answer.payload)
        reply = decode_or_raise(_reply_kind(result), answer.payload)
        if reply.id != request.id:
            raise ProtocolError(f"{verb} got the reply to another request ({reply.id})")
        return reply.result

    async def request_apart(
        self, kind: Kind, verb: str, args: Mapping[str, Any], result: type[R], user: str = ""
    ) -> R:
        """Make a request over a connection of its own; see :meth:`request`.

        If this is cancelled, the connection ends, and the daemon cancels a calculation for it.
        """
        async with await type(self).open(replace(self._target, rig=self.rig)) as connection:
            return await connection.request(kind, verb, args, result, user)

    def listen(self, key: str, size: int) -> AsyncGenerator[bytes, None]:
        """Subscribe; yield payloads until closed. At most ``size`` wait: the oldest are dropped."""
        mailbox = PayloadQueue(size)
        self._mailboxes.add(mailbox)
        return self._deliver(mailbox, listen(self._session, key, mailbox.put))

    async def statuses(self) -> AsyncIterator[Status]:
        """Yield the status at every change and twice a second; goes on after a silence."""
        async for payload in self.listen(self.keys.status, STATUSES):
            yield decode_or_raise(Status, payload)

    async def events(self) -> AsyncIterator[RigEvent]:
        """Yield every event from now on."""
        async for payload in self.listen(self.keys.event, EVENTS):
            yield decode_or_raise(RigEvent, payload)

    async def frames(self) -> AsyncIterator[bytes]:
        """Yield the frames of all streams; those that come too fast are left out."""
        async for payload in self.listen(self.keys.every_live, FRAMES):
            yield payload

    async def _patiently(self, kind: Kind, verb: str, payload: bytes) -> list[QueryReply]:
        """Return the answers to a request; a question that comes too early is put again."""
        found = await self._insist(kind, verb, payload)
        give_up_s = time.monotonic() + PATIENCE_S[find_verb(kind, verb).rule.lane]
        while kind is Kind.ASK and _is_busy(found) and time.monotonic() < give_up_s:
            await asyncio.sleep(_ASK_AGAIN_S)
            found = await self._insist(kind, verb, payload)
        return found

    async def _insist(self, kind: Kind, verb: str, payload: bytes) -> list[QueryReply]:
        """Return the answers to a request; send it again if there were none.

        Raises:
            LinkError: there are none, with the known reasons.
        """
        key = self.keys.request(kind, self.identity, verb)
        patience_s = PATIENCE_S[find_verb(kind, verb).rule.lane]
        timed_out = False
        for again in (False, True):
            try:
                await self._connected()
            except LinkError as error:
                if again:
                    raise self._in_doubt(verb, error.message) from error
                raise
            try:
                found = await self._while_it_speaks(
                    query(self._session, key, patience_s, payload, urgent=kind is Kind.STOP), verb
                )
            except TimedOut:
                timed_out = True
                continue
            if found:
                return found
        if timed_out:
            raise self._in_doubt(verb, f"{self.rig} did not answer in time")
        try:
            await self.status()
        except LinkError as error:  # it answered when this client connected
            raise self._in_doubt(verb, error.message) from error
        raise LinkError(
            f"{self.rig} takes no {verb.replace('_', ' ')} from {self.identity}",
            hint=f"its rig file gives roles, as in remote: {{roles: {{{self.identity}: operator}}}}"
            "; an observer may look on and stop",
        )

    async def _while_it_speaks(
        self, asking: Coroutine[Any, Any, list[QueryReply]], verb: str
    ) -> list[QueryReply]:
        """Return the answers; give up early if the daemon is silent."""
        task = asyncio.create_task(asking)
        try:
            while not (await asyncio.wait([task], timeout=_STILL_THERE_S))[0]:
                if self.silent_s > SILENCE_S:
                    raise self._in_doubt(verb, f"{self.rig} has fallen silent")
            return task.result()
        finally:
            task.cancel()

    def _in_doubt(self, verb: str, what: str) -> LinkError:
        return LinkError(
            f"{what}: whether {verb} was carried out is not known",
            hint="look at the rig itself, and at its status when it answers again",
        )

    async def _connected(self) -> None:
        """Wait until there is a connection.

        Raises:
            LinkError: it stays lost.
        """
        give_up_s = time.monotonic() + RECONNECT_S
        while not is_connected(self._session):
            if time.monotonic() > give_up_s:
                why = await asyncio.to_thread(doubt, self._target)
                raise LinkError(
                    f"the connection to {self.rig} at {self._target.endpoint} is lost",
                    hint=f"{why} The client connects again by itself",
                )
            await asyncio.sleep(_RECONNECTED_S)

    async def _deliver(
        self, mailbox: PayloadQueue, subscriber: zenoh.Subscriber[None]
    ) -> AsyncGenerator[bytes, None]:
        try:
            async for payload in mailbox:
                yield payload
        finally:
            self._mailboxes.discard(mailbox)
            with suppress(zenoh.ZError):  # the session may be closed already
                subscriber.undeclare()

    def _hear(self, _: bytes) -> None:
        self._heard_s = time.monotonic()


def _is_busy(found: list[QueryReply]) -> bool:
    return any(not item.ok and decode_refusal(item.payload).code is Code.BUSY for item in found)


def _reply_kind(result: type[R]) -> type[_ReplyOf[R]]:
    return _ReplyOf[result]  # type: ignore[valid-type]  # made at run time, from the result


async def _only_rig(session: zenoh.Session, target: Target) -> str:
    alive = await rigs_alive(session)
    if not alive:
        raise LinkError(
            f"there is no rig at {target.endpoint}",
            hint=f"its daemon may just be starting; with certificates, {target.identity} also "
            "needs a role in its rig file",
        )
    if len(alive) > 1:
        raise ConfigError(f"which rig? There are {', '.join(alive)}", hint="name one (--rig NAME)")
    return alive[0]
