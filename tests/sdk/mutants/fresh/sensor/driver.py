"""The driver of an encoder with a load cell on UDP, asked in every cycle; it takes no setpoints."""

from __future__ import annotations

import contextlib
import socket
import struct
import time
import zlib
from typing import Annotated, ClassVar, Final

from annotated_types import Ge, Gt, Le

from rigd.sdk import Channel, Declaration, Driver, DriverConfig, In, LinkError, Row, readable

#: Longest wait for an answer outside the cycle, in s, and number of tries.
REPLY_S: Final = 0.2
TRIES: Final = 3
#: Most frames that one cycle takes.
MOST_FRAMES: Final = 16
NEWTONS_PER_COUNT: Final = 1.25e-3
REPLY: Final = struct.Struct("<cBBih")


class GaugeConfig(DriverConfig):
    """The address of the sensor, and its scale."""

    host: str = "127.0.0.1"
    """Address of the sensor."""
    port: Annotated[int, Ge(1), Le(65535)]
    """UDP port of the sensor."""
    resolution: Annotated[float, In("m"), Gt(0), Le(1e-3)] = 1e-6
    """Travel per count."""


class GaugeRow(Row):
    """Position in m, force in N; status: force at the end of its range 1, referenced 2."""

    position: float
    force: float
    status: int


class Gauge(Driver[GaugeConfig, None]):
    """An encoder with a load cell; it moves nothing, so it is always safe."""

    Config: ClassVar[type[DriverConfig]] = GaugeConfig
    title: ClassVar[str] = "an encoder with a load cell on UDP"

    def __init__(self, config: GaugeConfig, link: None) -> None:
        super().__init__(config, link)
        self._socket: socket.socket | None = None
        self._sequence = 0
        self._answered: int | None = None

    @classmethod
    def declare(cls, config: GaugeConfig) -> Declaration:
        """Return position and force."""
        return Declaration(
            channels=(
                Channel("position", "m", "position of the slider"),
                Channel("force", "N", "traction", -41.0, 41.0),
            ),
            row=GaugeRow,
            status_bits={"force_at_rail": 1, "referenced": 2},
        )

    def open(self) -> None:
        """Find the sensor.

        Raises:
            LinkError: it does not answer, or is open already.
        """
        where = f"{self.config.host}:{self.config.port}"
        if self._socket is not None:
            raise LinkError(f"{where} is open already", hint="close it first")
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._socket.connect((self.config.host, self.config.port))
            self._find()
        except (OSError, LinkError) as error:
            self.close()
            raise LinkError(
                f"no sensor answers at {where} ({error})", hint="check its supply and its cable"
            ) from error
        self.identity = f"encoder at {where}"

    def arm(self) -> None:
        """Do nothing: it only measures."""

    def read(self, t_ns: int) -> GaugeRow | None:
        """Return the newest answer that has come, and ask for the next.

        Raises:
            LinkError: the connection is lost.
        """
        newest = None
        for _ in range(MOST_FRAMES):
            frame = self._receive()
            if frame is None:
                break
            reply = parsed(frame)
            if reply is not None and reply[0] != self._answered:
                newest = reply
                self._answered = reply[0]
        self._send()
        if newest is None:
            return None
        _, status, counts, raw = newest
        return GaugeRow.of(
            position=counts * self.config.resolution,
            force=raw * NEWTONS_PER_COUNT,
            status=status,
        )

    def make_safe(self) -> None:
        """Do nothing: it only measures."""

    def close(self) -> None:
        """Close the socket; closing twice is silent."""
        link, self._socket = self._socket, None
        if link is not None:
            link.close()

    def _send(self) -> None:
        self._sequence = (self._sequence + 1) % 256
        try:
            with contextlib.suppress(BlockingIOError):  # the next cycle asks again
                self._opened().send(b"Q" + bytes([self._sequence]))
        except OSError as error:
            raise self._lost(error) from error

    def _receive(self) -> bytes | None:
        try:
            return self._opened().recv(64)
        except BlockingIOError:
            return None
        except OSError as error:
            raise self._lost(error) from error

    def _find(self) -> None:
        """Ask until an answer comes; too slow for the cycle."""
        for _ in range(TRIES):
            self._send()
            deadline = time.monotonic() + REPLY_S
            while (left := deadline - time.monotonic()) > 0:
                readable(self._opened(), left)
                reply = parsed(self._receive() or b"")
                if reply is not None and reply[0] == self._sequence:
                    return
        raise LinkError(f"no answer to {TRIES} questions within {REPLY_S:g} s each")

    def _opened(self) -> socket.socket:
        if self._socket is None:
            raise LinkError("the sensor is not open")
        return self._socket

    def _lost(self, error: OSError) -> LinkError:
        return LinkError(
            f"the connection to {self.config.host}:{self.config.port} is lost ({error.strerror})",
            hint="check the cable and the supply of the sensor",
        )


def parsed(frame: bytes) -> tuple[int, int, int, int] | None:
    """Return sequence, status, counts and raw force of an answer; None if it is damaged."""
    if len(frame) != REPLY.size + 4:
        return None
    body, check = frame[: REPLY.size], int.from_bytes(frame[REPLY.size :], "little")
    head, sequence, status, counts, raw = REPLY.unpack(body)
    if head != b"P" or check != zlib.crc32(body):
        return None
    return sequence, status, counts, raw
