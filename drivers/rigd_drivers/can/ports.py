"""Sends and receives CAN frames through the simulated bus, SocketCAN or an adapter of python-can.

A port never waits unless the caller asks for it. A port turns every failure into a
:class:`LinkError` that names what to check.
"""

from __future__ import annotations

import errno
import socket
import struct
import time
from abc import ABC, abstractmethod
from collections.abc import Mapping
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Final

from rigd.sdk import LinkError, dropped, readable
from rigd_drivers.can.canopen import frames
from rigd_drivers.wait import looks

if TYPE_CHECKING:
    import can

#: A frame as it came: identifier with the flags of :mod:`frames`, data.
Frame = tuple[int, bytes]

#: Names that rigd serves itself; any other is an interface of python-can.
HUB: Final = "hub"
SOCKETCAN: Final = "socketcan"

#: ``CAN_RAW_ERR_FILTER``, linux/can/raw.h; not every build of Python has it.
_ERROR_FILTER: Final = 2
#: ``CAN_ERR_MASK``: every class of error frame, linux/can.h.
_ALL_ERRORS: Final = 0x1FFF_FFFF
#: The simulated bus reports frames that it could not hand over as a controller does (linux/can/
#: error.h, CAN_ERR_CRTL), with their number in bytes 4 to 7.
_HUB_OVERFLOW: Final = frames.ERROR | 0x0000_0004
#: A queue of 10 frames, which is what SocketCAN has by default, is sent within this at
#: 250 kbit/s; there is no way to wait for that but to try again, in s.
PATIENCE_S: Final = 0.01
_PAUSE_S: Final = 0.0002
#: Room for frames that come while we are set up, or while this host stalls, in bytes.
_RECEIVE_BUFFER: Final = 1 << 20


class Full(Exception):
    """The frame was not sent: the queue behind the port is full."""


class Port(ABC):
    """One open connection to a bus."""

    @abstractmethod
    def receive(self) -> Frame | None:
        """Return the next frame that has come, or None; never waits.

        Raises:
            LinkError: the bus is gone.

        """

    @abstractmethod
    def send(self, identifier: int, data: bytes) -> None:
        """Send a frame; never waits.

        Raises:
            Full: there is no room for it at present.
            LinkError: the bus is gone.

        """

    def press(self, identifier: int, data: bytes) -> None:
        """Send a frame; wait for room in the queue, at most :data:`PATIENCE_S`.

        Raises:
            Full, LinkError: see :meth:`send`.

        """
        for _ in looks(PATIENCE_S):
            with suppress(Full):
                self.send(identifier, data)
                return
            time.sleep(_PAUSE_S)
        self.send(identifier, data)

    def lost(self) -> int:
        """Return how many frames found the queue behind the port full, as far as it knows."""
        return 0

    @abstractmethod
    def wait(self, timeout_s: float) -> None:
        """Wait until there may be a frame to receive, at most ``timeout_s``."""

    @abstractmethod
    def close(self) -> None:
        """Close the connection."""


class SocketPort(Port):
    """A socket that carries one ``struct can_frame`` per packet: SocketCAN, or our hub."""

    def __init__(self, connection: socket.socket, lost: LinkError) -> None:
        connection.setblocking(False)
        self._socket = connection
        self._lost = lost

    def receive(self) -> Frame | None:
        """Return the next frame; see :meth:`Port.receive`."""
        try:
            packet = self._socket.recv(frames.CAN_FRAME.size)
        except BlockingIOError:
            return None
        except OSError as error:
            raise self._gone(error) from error
        if not packet:
            raise self._gone("it was closed")
        try:
            return frames.unpack(packet)
        except ValueError as error:
            raise self._gone(error) from error

    def send(self, identifier: int, data: bytes) -> None:
        """Send a frame; see :meth:`Port.send`."""
        try:
            self._socket.send(frames.pack(identifier, data))
        except BlockingIOError as error:
            raise Full("its queue is full") from error
        except OSError as error:
            if error.errno == errno.ENOBUFS:
                raise Full("its queue is full") from error
            raise self._gone(error) from error

    def lost(self) -> int:
        """Return what the kernel dropped; see :meth:`Port.lost`."""
        return dropped(self._socket)

    def wait(self, timeout_s: float) -> None:
        """Wait for a packet."""
        readable(self._socket, timeout_s)

    def close(self) -> None:
        """Close the socket; what was sent still arrives."""
        # A local socket that is closed with frames unread takes back those under way.
        with suppress(OSError):  # SocketCAN has no shutdown, and the peer may be gone
            self._socket.shutdown(socket.SHUT_RD)
            while self._socket.recv(frames.CAN_FRAME.size):
                pass
        self._socket.close()

    def _gone(self, why: object) -> LinkError:
        return LinkError(f"{self._lost.message}: {why}", hint=self._lost.hint)


class HubPort(SocketPort):
    """Our place on the simulated bus, which tells how many frames it could not hand over."""

    def __init__(self, connection: socket.socket, lost: LinkError) -> None:
        super().__init__(connection, lost)
        self._frames_lost = 0

    def receive(self) -> Frame | None:
        """Return the next frame; see :meth:`Port.receive`."""
        frame = super().receive()
        while frame is not None and frame[0] == _HUB_OVERFLOW:
            self._frames_lost += int.from_bytes(frame[1][4:8], "little")
            frame = super().receive()
        return frame

    def lost(self) -> int:
        """Return what the bus has told; see :meth:`Port.lost`."""
        return self._frames_lost


class LibraryPort(Port):
    """An adapter that python-can supports, used without its threads."""

    def __init__(self, bus: can.BusABC, message: type[can.Message], name: str) -> None:
        from can import CanError

        self._bus = bus
        self._message = message
        self._name = name
        self._errors = (CanError, OSError)
        self._waiting: can.Message | None = None

    def receive(self) -> Frame | None:
        """Return the next frame; see :meth:`Port.receive`."""
        message, self._waiting = self._waiting, None
        if message is None:
            message = self._take(0.0)
        if message is None:
            return None
        identifier = message.arbitration_id
        if message.is_error_frame:
            # What the identifier then means is each adapter's own; that something is wrong is not.
            return frames.ERROR | frames.DESTROYED, bytes(message.data)
        if message.is_extended_id:
            identifier |= frames.EXTENDED
        if message.is_remote_frame:
            identifier |= frames.REMOTE
        return identifier, bytes(message.data)

    def send(self, identifier: int, data: bytes) -> None:
        """Send a frame; see :meth:`Port.send`."""
        message = self._message(arbitration_id=identifier, data=data, is_extended_id=False)
        try:
            self._bus.send(message, timeout=0)
        except self._errors as error:
            # The library has no error of its own for a full queue: it is one as long as it passes.
            raise Full(str(error)) from error

    def wait(self, timeout_s: float) -> None:
        """Wait for a message."""
        if self._waiting is None:
            self._waiting = self._take(timeout_s)

    def close(self) -> None:
        """Shut the adapter down."""
        self._bus.shutdown()

    def _take(self, timeout_s: float) -> can.Message | None:
        try:
            return self._bus.recv(timeout_s)
        except self._errors as error:
            raise LinkError(
                f"CAN adapter {self._name} failed: {error}",
                hint="check that it is still plugged in, and its driver",
            ) from error


def open_port(
    interface: str, channel: str, bitrate: int, adapter: Mapping[str, str] | None = None
) -> Port:
    """Open ``channel`` of ``interface``; ``adapter`` has further options of python-can, as text.

    Raises:
        LinkError: there is no such interface, or it cannot be opened.

    """
    if interface == HUB:
        return _open_hub(channel)
    if interface == SOCKETCAN:
        return _open_socketcan(channel, bitrate)
    return _open_adapter(interface, channel, bitrate, adapter or {})


def _open_hub(path: str) -> Port:
    hint = "start the simulated devices first: rigd sim RIG.yaml"
    connection = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    try:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER)
        connection.connect(path)
    except OSError as error:
        connection.close()
        found = error.strerror or error
        raise LinkError(f"no simulated CAN bus at {path}: {found}", hint=hint) from error
    return HubPort(connection, LinkError(f"the simulated CAN bus at {path} is gone", hint=hint))


def _open_socketcan(channel: str, bitrate: int) -> Port:
    up = f"ip link set {channel} up type can bitrate {bitrate}"
    try:
        connection = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    except OSError as error:
        raise LinkError(
            f"this kernel has no SocketCAN: {error}", hint="load the modules can and can_raw"
        ) from error
    try:
        everything = struct.pack("=I", _ALL_ERRORS)
        connection.setsockopt(socket.SOL_CAN_RAW, _ERROR_FILTER, everything)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER)
        connection.bind((channel,))
    except OSError as error:
        connection.close()
        raise LinkError(
            f"no CAN interface {channel!r}: {error}", hint=f"'ip -d link' lists them; then: {up}"
        ) from error
    return SocketPort(connection, LinkError(f"the CAN interface {channel} failed", hint=up))


def _open_adapter(interface: str, channel: str, bitrate: int, options: Mapping[str, str]) -> Port:
    import can
    from can.util import cast_from_string

    name = f"{interface} {channel}".strip()
    values: dict[str, Any] = {key: cast_from_string(text) for key, text in options.items()}
    try:
        bus = can.Bus(interface=interface, channel=channel, bitrate=bitrate, **values)
    except (
        can.CanError,
        OSError,
        ImportError,
        ValueError,
        TypeError,
        NotImplementedError,
    ) as error:
        known = ", ".join(sorted(can.VALID_INTERFACES))
        raise LinkError(
            f"the CAN adapter {name} cannot be opened: {error}",
            hint=f"check its driver, channel and options; known interfaces: hub, {known}",
        ) from error
    return LibraryPort(bus, can.Message, name)
