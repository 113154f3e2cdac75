"""Serves a rig over the network: a zenoh session receives requests, sends replies, and publishes.

For each queryable (a key that takes requests), zenoh calls this module on a separate thread, which
also serves the network. On that thread the server only puts a request into the inbox of its lane,
as the key of the request states. Each lane is a queue with its own thread, which answers the
requests. A stop has its own lane, so that it does not wait for a report.
"""

from __future__ import annotations

import errno
import logging
import re
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import partial
from typing import Final, Self

import zenoh

from rigd.config.remote import RemoteSetup
from rigd.model.errors import LinkError
from rigd.remote.certificates import check_usable
from rigd.remote.network import open_server, server_config
from rigd.remote.protocol import Code, Keys, Kind, Lane, Refusal, encode_refusal
from rigd.remote.protocol.limits import HEARTBEAT_S
from rigd.remote.protocol.status import RefusedCounts
from rigd.remote.server.admission import Admission
from rigd.remote.server.dispatcher import Dispatcher, RoutedRequest
from rigd.remote.server.inbox import Inbox
from rigd.remote.server.lease import Lease
from rigd.remote.server.publisher import RigPublisher
from rigd.remote.server.refusal_log import Refused
from rigd.remote.server.requests import StoredReply
from rigd.remote.server.service import Service

_log = logging.getLogger(__name__)

#: In these lanes a reply takes longer than this only if the thread hangs, in s.
_STUCK_S: Final = 10.0
_QUICK: Final = frozenset({Lane.STOP, Lane.LEASE, Lane.ASK})
#: The lanes whose threads never rest.
_NEVER_RESTING: Final = frozenset({Lane.STOP, Lane.LEASE})
#: In any other lane with waiting requests, the thread sleeps after each request: so many times as
#: long as it has computed, and at most so long, in s. All threads share the interpreter's lock: a
#: thread that answers a flood without a pause would delay a stop.
_REST: Final = 4.0
_LONGEST_REST_S: Final = 0.1
#: How long closing waits for requests in progress, in s; a longer one, such as a dry run, goes on.
_LAST_REQUEST_S: Final = 2.0

#: The place in zenoh's source that found an error: of no use in a message.
_IN_SOURCE: Final = re.compile(r" at /\S+\.rs:\d+\.?")

#: The reply, without a look at the request, to a client that has too many of them waiting.
_BUSY: Final = StoredReply(
    False, encode_refusal("", Refusal(Code.BUSY, "too many of your requests are waiting"))
)


#: Whether the client of the request that a thread carries out is still connected.
_CONNECTED: ContextVar[Callable[[], bool]] = ContextVar("connected", default=lambda: True)


def still_connected() -> bool:
    """Return whether the client of the request that this thread carries out is still connected.

    True if unknown: a client need not name its session, though clients of rigd do.
    """
    return _CONNECTED.get()()


@contextmanager
def working_for(connected: Callable[[], bool]) -> Iterator[None]:
    """Let :func:`still_connected` be answered by ``connected`` within."""
    token = _CONNECTED.set(connected)
    try:
        yield
    finally:
        _CONNECTED.reset(token)


@dataclass(frozen=True)
class _Waiting:
    routed: RoutedRequest
    query: zenoh.Query


class Server:
    """Serves one rig: reachable when constructed, replies after :meth:`start`, until :meth:`close`.

    ``lease`` is checked here for the verbs that need it, and changed by the service. Construct it
    first: a second daemon of the rig then fails before it opens a device.

    Raises:
        LinkError: an address cannot be listened on.
        ConfigError: a certificate cannot be used.
    """

    def __init__(self, rig: str, setup: RemoteSetup, lease: Lease) -> None:
        self._keys = Keys(rig)
        self._setup = setup
        self._lease = lease
        self._refused = Refused()
        self._inboxes = {lane: Inbox[_Waiting]() for lane in Lane}
        self._closing = threading.Event()
        self._threads: list[threading.Thread] = []
        self._begun_s: dict[Lane, float] = {}  # when the request in progress began, monotonic
        self._publishing = threading.Lock()  # of two statuses, the newer one goes out last
        self._declared = ExitStack()  # undone in the reverse order
        self._session = _open(self._keys, setup)
        self.publisher = RigPublisher(self._session, self._keys)
        self._admission = Admission(self._session, setup.listen)

    def refused(self) -> RefusedCounts:
        """Return how many messages were refused so far."""
        return self._refused.counts()

    def crowding(self) -> dict[str, int]:
        """Return what was done so far about unauthenticated connections, for the status."""
        return {
            "unauthenticated_ended": self._admission.waiting_ended,
            "accept_pauses": self._admission.pauses,
        }

    def start(self, service: Service) -> None:
        """Answer requests, publish the status as a heartbeat, and declare the liveliness token."""
        dispatcher = Dispatcher(self._keys, self._setup, service, self._lease, self._refused)
        self.publish_status(service)
        for lane in Lane:
            self._thread(f"remote-{lane.value}", partial(self._work, dispatcher, lane))
        self._thread("remote-beat", partial(self._beat, service))
        self._answer(self._keys.status, partial(self._show, dispatcher))
        for kind in Kind:
            self._answer(self._keys.every_request(kind), partial(self._receive, dispatcher, kind))
        self._admission.watch()
        token = self._session.liveliness().declare_token(self._keys.alive)
        self._declared.callback(token.undeclare)

    def publish_status(self, service: Service) -> None:
        """Publish the status now; if that fails, it is logged."""
        try:
            with self._publishing:
                self.publisher.status(service.status())
        except Exception:  # noqa: BLE001 - without the heartbeat, clients take it for dead
            _log.exception("the status cannot be published")

    @property
    def hangs(self) -> str:
        """The thread that hangs, in words; "" if none does."""
        for thread in self._threads:
            if not thread.is_alive():
                return f"{thread.name} has ended"
        stuck_s = time.monotonic() - _STUCK_S
        for lane, begun_s in self._begun_s.copy().items():
            if lane in _QUICK and begun_s < stuck_s:
                return f"remote-{lane.value} has not answered for {_STUCK_S:g} s"
        return ""

    @property
    def zid(self) -> str:
        """The id of its session in zenoh."""
        return str(self._session.info.zid())

    def transports(self) -> Sequence[str]:
        """Return the mode of zenoh in which each session is connected; only ``client`` stays."""
        return [str(transport.whatami) for transport in self._session.info.transports()]

    def close(self) -> None:
        """Admit no more requests; complete the present requests, discard those that wait."""
        self._closing.set()
        try:
            self._declared.close()
            self._admission.close()
            for inbox in self._inboxes.values():
                for waiting in inbox.close():
                    waiting.query.drop()
            deadline_s = time.monotonic() + _LAST_REQUEST_S
            for thread in self._threads:
                thread.join(max(0.0, deadline_s - time.monotonic()))
        finally:
            self._session.close()  # its threads would keep the process from ending

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _thread(self, name: str, target: Callable[[], None]) -> None:
        thread = threading.Thread(target=target, name=name, daemon=True)
        self._threads.append(thread)
        thread.start()

    def _answer(self, key: str, callback: Callable[[zenoh.Query], None]) -> None:
        queryable = self._session.declare_queryable(key, callback, complete=True)
        self._declared.callback(queryable.undeclare)

    def _receive(self, dispatcher: Dispatcher, kind: Kind, query: zenoh.Query) -> None:
        """Sort a request; runs on a thread of zenoh's for each kind, so it must be quick."""
        begun_s = time.thread_time()
        if not self._sort(dispatcher, query) and kind is not Kind.STOP:
            _rest(begun_s)

    def _sort(self, dispatcher: Dispatcher, query: zenoh.Query) -> bool:
        """Put a request into its inbox; return False if it was refused."""
        key = str(query.key_expr)
        payload = b"" if query.payload is None else query.payload.to_bytes()
        try:
            routed = dispatcher.sort(key, payload, _session_of(query))
        except Refusal as refusal:
            _reply(query, key, dispatcher.refuse(key, refusal))
            return False
        if not self._inboxes[routed.verb.rule.lane].put(
            routed.address.identity, _Waiting(routed, query)
        ):
            _reply(query, key, _BUSY)
            return False
        return True

    def _show(self, dispatcher: Dispatcher, query: zenoh.Query) -> None:
        """Send the newest status to a client that has just connected; on zenoh's thread."""
        begun_s = time.thread_time()
        session = _session_of(query) or "a client"
        try:
            dispatcher.check_rate(session, session)
        except Refusal as refusal:
            _reply(query, self._keys.status, dispatcher.refuse(self._keys.status, refusal))
            _rest(begun_s)
            return
        _reply(query, self._keys.status, StoredReply(True, self.publisher.newest_status))

    def _work(self, dispatcher: Dispatcher, lane: Lane) -> None:
        inbox = self._inboxes[lane]
        while (waiting := inbox.take()) is not None:
            self._begun_s[lane], begun_s = time.monotonic(), time.thread_time()
            with working_for(partial(self._is_connected, waiting.query)):
                answer = dispatcher.answer(waiting.routed)
            _reply(waiting.query, waiting.routed.key, answer)
            del self._begun_s[lane]
            if inbox.has_items and lane not in _NEVER_RESTING:
                _rest(begun_s)

    def _is_connected(self, query: zenoh.Query) -> bool:
        """Return whether the session of the client is connected, if the request names it."""
        source = query.source_info
        if source is None:
            return True
        return source.source_id.zid in [link.zid for link in self._session.info.links()]

    def _beat(self, service: Service) -> None:
        while not self._closing.wait(HEARTBEAT_S):
            self.publish_status(service)


def _open(keys: Keys, setup: RemoteSetup) -> zenoh.Session:
    if setup.tls is not None:
        check_usable(setup.tls)  # with unusable files zenoh listens, but no client can connect
    try:
        return open_server(server_config(keys, setup))
    except zenoh.ZError as error:
        addresses = ", ".join(setup.listen)
        if f"os error {errno.EADDRINUSE}" in str(error):
            raise LinkError(
                f"cannot listen on {addresses}: another program listens there, such as the daemon "
                "of another rig",
                hint="rigs of one computer need a port each, as in the rig file: "
                "remote: {listen: [tcp/127.0.0.1:7448]}",
            ) from error
        raise LinkError(
            f"cannot listen on {addresses}: {_IN_SOURCE.sub('', str(error))}",
            hint="look at 'remote' in the rig file: the address, and the certificates",
        ) from error


def _session_of(query: zenoh.Query) -> str:
    """Return the id of the session from which a request came, if it names it; or ""."""
    source = query.source_info
    return "" if source is None else str(source.source_id.zid)


def _rest(begun_s: float) -> None:
    """Give other threads time to compute, after this thread has computed since ``begun_s``."""
    time.sleep(min(_REST * (time.thread_time() - begun_s), _LONGEST_REST_S))


def _reply(query: zenoh.Query, key: str, answer: StoredReply) -> None:
    """Send a reply; a client that has gone gets none."""
    with query:
        try:
            if answer.ok:
                query.reply(key, answer.payload)
            else:
                query.reply_err(answer.payload)
        except zenoh.ZError as error:
            _log.info("no reply to %s: %s", key, error)
