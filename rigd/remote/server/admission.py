"""Limits the number of connections to a daemon that have not authenticated yet.

zenoh accepts every TCP connection and gives its client time to show a certificate and open a
session. Until then the connection is called unauthenticated here. Unauthenticated connections can
keep every new client out, because zenoh's TLS listener (tls-listener 0.11 under eclipse-zenoh
1.10.2) has two properties:

- After each connection that fails, the listener pauses for 0.1 s. A client waits for all
  connections that fail before its own.
- If the process has no descriptor left for another connection, the listener stops looking at its
  connections. It never starts again, even when all these connections are closed.

This module therefore takes four measures:

- The kernel keeps a connection to itself until the other end has sent something (TCP_DEFER_ACCEPT
  of tcp(7)).
- While too many connections are unauthenticated, accepting pauses. The kernel drops the first
  packet of each new connection, and the computer that sent it sends it again. Clients that are
  connected notice nothing.
- While too many connections wait for zenoh to accept them, all that wait are ended. Silent ones
  come to zenoh all at once when the kernel gives up on them or their other ends close them, and
  zenoh would need 0.1 s for each. A client of rigd tries again.
- A connection in zenoh's router or peer mode, instead of client mode, is refused. zenoh sends a
  router half of what a client asks without naming a rig, and the router cannot answer.
"""

from __future__ import annotations

import logging
import os
import select
import socket
import struct
import threading
from array import array
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

import zenoh

from rigd.config.remote import Endpoint

_log = logging.getLogger(__name__)

#: So many connections may be unauthenticated at once; accepting goes on when so few are left, after
#: 1.6 s if all of them fail.
MOST_UNAUTHENTICATED: Final = 32
FEW_UNAUTHENTICATED: Final = 16
#: So many may wait for zenoh to accept them: as many as there may be clients.
MOST_WAITING: Final = 32
#: The kernel keeps a connection that sends nothing for so long, in s, which needs no descriptor. A
#: client of rigd sends at once.
_SILENT_S: Final = 30
#: How often to check whether accepting can go on, in s.
_LOOK_S: Final = 0.05
#: Options of sockets <asm-generic/socket.h>, and the filter that drops everything: `ret #0`
#: (socket(7), "SO_ATTACH_FILTER"; Linux applies it to the packets of a listening socket too).
_ATTACH_FILTER: Final = 26
_DETACH_FILTER: Final = 27
_NOTHING: Final = array("B", struct.pack("@HBBI", 0x06, 0, 0, 0))
_FILTER: Final = struct.pack("@HP", 1, _NOTHING.buffer_info()[0])
#: Of `struct tcp_info`, the first bytes: of a socket that listens, the last four are how many
#: connections wait to be accepted <linux/tcp.h>, "tcpi_unacked".
_WAITING: Final = struct.Struct("@24xI")
#: More connections than ever wait to be accepted (tokio's backlog is 1024).
_ALL_WAITING: Final = 4096


class Admission:
    """Limits connections to the ``endpoints`` of a daemon, from :meth:`watch` to :meth:`close`.

    Any thread may call. A check needs one free descriptor.
    """

    def __init__(self, session: zenoh.Session, endpoints: Sequence[str]) -> None:
        self.pauses = 0  #: how often accepting has paused
        self.waiting_ended = 0  #: connections that this ended before zenoh accepted them
        self._session = session
        read = map(Endpoint.read, endpoints)
        self._ports = frozenset(item.port for item in read if item is not None)
        self._listening: list[int] = []  # descriptors of our own for zenoh's sockets
        self._paused = False
        self._modes_refused = 0
        self._closing = threading.Event()
        self._wake = -1  # an eventfd(2): a client has opened a session, or this closes
        self._opened: zenoh.TransportEventsListener[None] | None = None
        self._thread = threading.Thread(target=self._work, name="admission", daemon=True)

    def watch(self) -> None:
        """Begin to watch."""
        found = [item.fileno() for item, listens in self._sockets() if listens]
        # Not socket.dup(): it lets both block, and zenoh's must not.
        self._listening = [os.dup(number) for number in found]
        self._wake = os.eventfd(0, os.EFD_CLOEXEC | os.EFD_NONBLOCK)
        self._opened = self._session.info.declare_transport_events_listener(self._on_transport)
        self._set(socket.IPPROTO_TCP, socket.TCP_DEFER_ACCEPT, _SILENT_S)
        self._thread.start()

    def close(self) -> None:
        """Watch no more; the ports are free once zenoh has closed them too."""
        self._closing.set()
        if self._opened is None:
            return
        self._opened.undeclare()
        self._opened = None
        os.eventfd_write(self._wake, 1)  # wakes the thread
        self._thread.join()
        for number in (*self._listening, self._wake):
            os.close(number)
        self._listening = []

    def _work(self) -> None:
        with select.epoll() as poll:
            for number in self._listening:
                poll.register(number, select.EPOLLIN | select.EPOLLET)
            poll.register(self._wake, select.EPOLLIN | select.EPOLLET)
            while not self._closing.is_set():
                poll.poll(_LOOK_S if self._paused else 10 * _LOOK_S)
                try:
                    self._look()
                    self._refuse_modes()
                except Exception:  # noqa: BLE001 - a watch that ends watches nothing
                    _log.exception("unauthenticated connections cannot be counted")

    def _look(self) -> None:
        """Pause accepting, or let it go on; end those that wait if they are too many."""
        if any(map(_has_too_many_waiting, self._listening)):
            self._end_waiting()
        clients = self._clients()
        peers = [_peer(item) for item, listens in self._sockets() if not listens]
        unauthenticated = sum(peer not in clients for peer in peers)
        if not self._paused and unauthenticated > MOST_UNAUTHENTICATED:
            self._paused = True
            self.pauses += 1
            self._set(socket.SOL_SOCKET, _ATTACH_FILTER, _FILTER)
            _log.warning(
                "%d connections are unauthenticated: no other is accepted", unauthenticated
            )
        elif self._paused and unauthenticated < FEW_UNAUTHENTICATED:
            self._set(socket.SOL_SOCKET, _DETACH_FILTER, 0)
            self._paused = False

    def _end_waiting(self) -> None:
        """End the connections that zenoh has not accepted yet.

        zenoh cannot end them itself: it does not check its connections while one waits.
        """
        ended = 0
        for item, listens in self._sockets():
            # Each is taken and closed; the listener of zenoh never blocks (O_NONBLOCK).
            while listens and ended < _ALL_WAITING:
                try:
                    item.accept()[0].close()
                except OSError:
                    break
                ended += 1
        self.waiting_ended += ended

    def _set(self, level: int, option: int, value: int | bytes) -> None:
        for number in self._listening:
            with _looked_at(number) as found:
                if found is not None:
                    found.setsockopt(level, option, value)

    def _on_transport(self, event: zenoh.TransportEvent) -> None:
        """Wake the thread after a session was opened or ended; on a thread of zenoh's."""
        if event.transport.whatami != zenoh.WhatAmI.CLIENT:
            os.eventfd_write(self._wake, 1)

    def _refuse_modes(self) -> None:
        """End the connections of sessions that are not in zenoh's client mode."""
        info = self._session.info
        others = [
            transport.zid
            for transport in info.transports()
            if transport.whatami != zenoh.WhatAmI.CLIENT
        ]
        if not others:
            return
        theirs = {_address(link) for link in info.links() if link.zid in others}
        for item, listens in self._sockets():
            if not listens and (peer := _peer(item)) in theirs:
                with suppress(OSError):  # it has gone by itself
                    item.shutdown(socket.SHUT_RDWR)
                if not self._modes_refused:  # they connect again each second
                    _log.warning("%s connected as a router or a peer: refused", peer)
                self._modes_refused += 1

    def _clients(self) -> frozenset[str]:
        """Return the addresses of connected clients."""
        return frozenset(map(_address, self._session.info.links()))

    def _sockets(self) -> Iterator[tuple[socket.socket, bool]]:
        """Yield the sockets on these ports, each with whether it listens."""
        for path in Path("/proc/self/fd").iterdir():
            with _looked_at(int(path.name)) as found:
                if found is None:
                    continue
                try:
                    if found.getsockname()[1] not in self._ports:
                        continue
                    listens = found.getsockopt(socket.SOL_SOCKET, socket.SO_ACCEPTCONN) == 1
                except OSError:  # closed meanwhile
                    continue
                yield found, listens


@contextmanager
def _looked_at(number: int) -> Iterator[socket.socket | None]:
    """Return a descriptor of this process as a socket, if it is TCP; it stays open."""
    try:
        found = socket.socket(fileno=number)
    except OSError:
        yield None
        return
    try:
        internet = found.family in (socket.AF_INET, socket.AF_INET6)
        yield found if internet and found.type == socket.SOCK_STREAM else None
    finally:
        found.detach()


def _has_too_many_waiting(number: int) -> bool:
    """Return whether too many connections wait until a socket that listens accepts them."""
    with _looked_at(number) as found:
        if found is None:
            return False
        told = found.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, _WAITING.size)
        waiting: int = _WAITING.unpack(told)[0]
        return waiting > MOST_WAITING


def _address(link: zenoh.Link) -> str:
    """Return the address of a connection, as :func:`_peer` does."""
    return str(link.dst).rpartition("/")[2]


def _peer(item: socket.socket) -> str:
    """Return the address of the other end as zenoh writes it; "" if it has disconnected."""
    try:
        host, port = item.getpeername()[:2]
    except OSError:
        return ""
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
