"""Connects a simulated Modbus device: by TCP, or by a pty with the timing of a serial line."""

from __future__ import annotations

import asyncio
import errno
import os
import socket
import struct
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

from rigd_sim.wire.modbus.frames import Ask, NotModbus, build_rtu, build_tcp, take_rtu, take_tcp

#: Silence between frames: 3.5 characters, 1.75 ms above 19200 baud (Serial Line V1.02, 2.5.1.1).
_GAP_CHARACTERS = 3.5
_GAP_FIXED_S = 1.75e-3
_FAST_BAUD = 19200
#: Bits of a character: start, 8, parity or second stop, stop (section 2.5.1).
_CHARACTER_BITS = 11
#: A request that has not become whole for so long is thrown away, in s. The standard has 1.5
#: characters; a pty's writer may be held up for longer by its kernel.
_INCOMPLETE_S = 0.05
#: How often bytes are let out, in s, at least one character's time.
_TICK_S = 1e-3

#: Bytes to send, each with the seconds to wait before it.
Pieces = Sequence[tuple[float, bytes]]
#: What a device does with a request.
Handler = Callable[[Ask], Pieces]


class Line(ABC):
    """A way to reach one device."""

    is_serial: ClassVar[bool]

    @abstractmethod
    async def start(self, handle: Handler) -> str:
        """Begin to serve; return the address.

        Raises:
            OSError: the name or port is taken.

        """

    @abstractmethod
    async def stop(self) -> None:
        """Stop serving; stopping twice is silent."""

    @abstractmethod
    def frame(self, unit: int, pdu: bytes, transaction: int) -> bytes:
        """Return the frame of a reply."""

    @abstractmethod
    def cut(self) -> None:
        """Break the connection as a crash or a pulled plug would."""


@dataclass
class TcpLine(Line):
    """A TCP port; 0 takes a free one, then given by ``port``."""

    host: str = "127.0.0.1"
    port: int = 502
    most: int = 1000  #: connections at once; it resets others
    is_serial = False
    _server: asyncio.Server | None = None
    _open: set[_Connection] = field(default_factory=set)

    async def start(self, handle: Handler) -> str:
        """See :class:`Line`."""
        loop = asyncio.get_running_loop()
        self._server = await loop.create_server(
            lambda: _Connection(handle, self._open, self.most), self.host, self.port
        )
        self.port = self._server.sockets[0].getsockname()[1]
        return f"Modbus TCP at {self.host}:{self.port}"

    async def stop(self) -> None:
        """See :class:`Line`."""
        self.cut()
        if self._server is not None:
            await self._server.wait_closed()
            self._server = None

    def frame(self, unit: int, pdu: bytes, transaction: int) -> bytes:
        """See :class:`Line`."""
        return build_tcp(unit, pdu, transaction)

    def cut(self) -> None:
        """Reset every connection (TCP RST), and take no other."""
        if self._server is not None:
            self._server.close()
        self.drop()

    def drop(self) -> None:
        """Reset every connection (TCP RST); others are taken."""
        for connection in list(self._open):
            connection.reset()


class _Connection(asyncio.Protocol):
    def __init__(self, handle: Handler, all_open: set[_Connection], most: int) -> None:
        self._handle = handle
        self._all_open = all_open
        self._most = most
        self._buffer = bytearray()
        self._transport: asyncio.Transport | None = None
        self._loop = asyncio.get_running_loop()
        self._torn = False  # a frame is out in part
        self._held: list[Pieces] = []

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        if isinstance(transport, asyncio.Transport):
            self._transport = transport
            self._all_open.add(self)
            connected = transport.get_extra_info("socket")
            connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            if len(self._all_open) > self._most:
                self.reset()

    def connection_lost(self, exc: Exception | None) -> None:
        self._all_open.discard(self)
        self._transport = None

    def data_received(self, data: bytes) -> None:
        self._buffer += data
        try:
            while (ask := take_tcp(self._buffer)) is not None:
                self._answer(self._handle(ask))
        except NotModbus:
            self.reset()

    def _answer(self, pieces: Pieces) -> None:
        """Send a frame; one that is sent in pieces holds up those behind it, as in any stream."""
        if self._torn:
            self._held.append(pieces)
            return
        self._torn = len(pieces) > 1
        wait_s = 0.0
        for number, (pause_s, piece) in enumerate(pieces, 1):
            wait_s += pause_s
            if wait_s > 0:
                last = number == len(pieces)
                self._loop.call_later(wait_s, self._send, piece, self._torn and last)
            else:
                self._send(piece, False)

    def reset(self) -> None:
        """Close with RST, as a crashed device does."""
        if self._transport is not None:
            connected = self._transport.get_extra_info("socket")
            connected.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            self._transport.abort()

    def _send(self, piece: bytes, is_last: bool) -> None:
        if self._transport is not None:
            self._transport.write(piece)
        if is_last:
            self._torn = False
            held, self._held = self._held, []
            for pieces in held:
                self._answer(pieces)


@dataclass
class SerialLine(Line):
    """A pty with a stable name, as slow as the serial line it stands for.

    Bytes leave no sooner than they would at ``baud``. A request is taken only when it comes at
    that baud rate, after the silence between frames; a device ignores all else.
    """

    path: Path
    baud: int = 19200
    strict: bool = True  #: deaf to a request without silence before it; many devices are not
    turnaround_s: float = 2e-3  #: from the end of a request to the begin of its reply
    ignored: int = 0  #: requests not taken: no silence before them, another baud rate, no frame
    is_serial = True
    _master: int = -1
    _slave: int = -1
    _buffer: bytearray = field(default_factory=bytearray)
    _quiet_from: float = 0.0
    _incomplete: asyncio.TimerHandle | None = None
    _queue: asyncio.Queue[tuple[float, Pieces]] = field(default_factory=asyncio.Queue)
    _sender: asyncio.Task[None] | None = None

    @property
    def character_s(self) -> float:
        """Time of one character on the line, in s."""
        return _CHARACTER_BITS / self.baud

    @property
    def gap_s(self) -> float:
        """Silence between frames, in s."""
        return _GAP_FIXED_S if self.baud > _FAST_BAUD else _GAP_CHARACTERS * self.character_s

    async def start(self, handle: Handler) -> str:
        """See :class:`Line`."""
        import tty  # Windows has none

        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        if self.path.is_symlink() and self.path.readlink().is_relative_to("/dev/pts"):
            self.path.unlink()  # left by a process that was killed
        try:
            self.path.symlink_to(os.ttyname(self._slave))
        except OSError:
            self._close()
            raise
        asyncio.get_running_loop().add_reader(self._master, self._hear, handle)
        self._sender = asyncio.create_task(self._send_all())
        return f"Modbus RTU at {self.path} ({self.baud} baud)"

    async def stop(self) -> None:
        """See :class:`Line`."""
        if self._sender is not None:
            self._sender.cancel()
            await asyncio.gather(self._sender, return_exceptions=True)
            self._sender = None
        self.cut()

    def frame(self, unit: int, pdu: bytes, transaction: int) -> bytes:
        """See :class:`Line`."""
        return build_rtu(unit, pdu)

    def cut(self) -> None:
        """Take the port away, as pulling out a USB adapter does."""
        if self._master < 0:
            return
        asyncio.get_running_loop().remove_reader(self._master)
        self._close()
        self.path.unlink(missing_ok=True)

    def _close(self) -> None:
        os.close(self._master)
        os.close(self._slave)
        self._master = self._slave = -1

    def _hear(self, handle: Handler) -> None:
        loop = asyncio.get_running_loop()
        now = loop.time()
        try:
            data = os.read(self._master, 1024)
        except BlockingIOError:
            return
        hasty = self.strict and now < self._quiet_from + self.gap_s
        if hasty or not self._same_baud():
            self.ignored += 1
            self._quiet_from = max(self._quiet_from, now)
            return
        if self._incomplete is not None:
            self._incomplete.cancel()
            self._incomplete = None
        self._buffer += data
        size = len(self._buffer)
        ask = take_rtu(self._buffer)
        if ask is None:
            self._incomplete = loop.call_later(_INCOMPLETE_S, self._forget)
            return
        begin = now + size * self.character_s + self.gap_s + self.turnaround_s
        self._queue.put_nowait((begin, handle(ask)))

    def _forget(self) -> None:
        self.ignored += 1
        self._buffer.clear()

    def _same_baud(self) -> bool:
        """Return whether the other side has set its end to our baud rate."""
        import termios

        return bool(
            termios.tcgetattr(self._master)[4] == getattr(termios, f"B{self.baud}", self.baud)
        )

    async def _send_all(self) -> None:
        loop = asyncio.get_running_loop()
        while True:
            begin, pieces = await self._queue.get()
            begin = max(begin, self._quiet_from + self.gap_s)
            for pause_s, piece in pieces:
                begin += pause_s
                await self._send(begin, piece, loop)
                begin = loop.time()

    async def _send(self, begin: float, piece: bytes, loop: asyncio.AbstractEventLoop) -> None:
        sent = 0
        while sent < len(piece):
            due = int((loop.time() - begin) / self.character_s)
            if due > sent:
                self._quiet_from = loop.time()
                if self._master < 0:
                    return
                try:
                    sent += os.write(self._master, piece[sent:due])
                except OSError as error:
                    if error.errno not in (errno.EAGAIN, errno.EIO):
                        raise
                    return  # no client reads: the bytes are lost, as on a wire
            if sent < len(piece):
                next_due = begin + (sent + 1) * self.character_s
                await asyncio.sleep(max(next_due - loop.time(), _TICK_S))
