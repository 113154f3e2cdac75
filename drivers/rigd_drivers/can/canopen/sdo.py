"""Runs the client's side of a CANopen SDO transfer, as a state machine on frames of 8 bytes.

Source: CiA 301 (4.2.0), section 7.2.4.3: expedited and segmented transfer; block transfer is not
used. The caller creates a transfer and sends :attr:`request`. The caller then gives every reply to
:meth:`feed` and sends the frame that :meth:`feed` returns, until :attr:`done` is true.
"""

from __future__ import annotations

import struct
from abc import ABC, abstractmethod
from typing import ClassVar, Final

_MULTIPLEXER: Final = struct.Struct("<BHB4s")
_TOGGLE: Final = 0x10

# Command specifiers, the upper three bits of the first byte.
_CLIENT_DOWNLOAD: Final = 0x20
_CLIENT_SEGMENT: Final = 0x00
_CLIENT_UPLOAD: Final = 0x40
_CLIENT_NEXT: Final = 0x60
_CLIENT_BLOCK_DOWNLOAD: Final = 0xC0
_BLOCK_END: Final = 0xC1
_SERVER_DOWNLOADED: Final = 0x60
_SERVER_SEGMENT_TAKEN: Final = 0x20
_SERVER_UPLOAD: Final = 0x40
_SERVER_SEGMENT: Final = 0x00
_ABORT: Final = 0x80

#: Texts of the abort codes, CiA 301, table 22.
ABORTS: Final = {
    0x05030000: "toggle bit not alternated",
    0x05040000: "SDO protocol timed out",
    0x05040001: "command specifier not valid or unknown",
    0x05040005: "out of memory",
    0x06010000: "unsupported access",
    0x06010001: "it is write only",
    0x06010002: "it is read only",
    0x06020000: "the object does not exist",
    0x06040041: "it cannot be mapped to a PDO",
    0x06040042: "the mapped objects exceed the length of a PDO",
    0x06040043: "general parameter incompatibility",
    0x06040047: "general internal incompatibility",
    0x06060000: "access failed because of a hardware error",
    0x06070010: "the length of the value does not match",
    0x06070012: "the value is too long",
    0x06070013: "the value is too short",
    0x06090011: "the sub-index does not exist",
    0x06090030: "the value is out of range",
    0x06090031: "the value is too high",
    0x06090032: "the value is too low",
    0x06090036: "the maximum is below the minimum",
    0x060A0023: "resource not available",
    0x08000000: "general error",
    0x08000020: "the value cannot be stored",
    0x08000021: "the value cannot be stored because of local control",
    0x08000022: "the value cannot be stored in the present state of the device",
    0x08000023: "no object dictionary is present",
    0x08000024: "no data available",
}

#: The object or the sub-index is not there: what an optional entry may answer.
MISSING: Final = frozenset({0x06020000, 0x06090011})


#: Abort codes of a server that took frames of two clients for those of one.
_MIXED_UP: Final = frozenset({0x05030000, 0x05040001})


def written_by(request: bytes) -> str:
    """Return the object that a client's ``request`` begins to write, as in 6040:00; else ""."""
    if len(request) != 8 or request[0] & 0xE0 not in (_CLIENT_DOWNLOAD, _CLIENT_BLOCK_DOWNLOAD):
        return ""
    return "" if request[0] & 0xE1 == _BLOCK_END else address_of(request)


def address_of(frame: bytes) -> str:
    """Return the object that a frame with index and sub-index is about, as in 6040:00."""
    _, index, sub, _ = _MULTIPLEXER.unpack(frame)
    return f"{index:04X}:{sub:02X}"


class Aborted(Exception):
    """The server ended the transfer; ``code`` is the reason (:data:`ABORTS`)."""

    def __init__(self, code: int) -> None:
        super().__init__(f"abort 0x{code:08X}, {ABORTS.get(code, 'unknown code')}")
        self.code = code

    @property
    def is_mixed_up(self) -> bool:
        """Whether the server may have taken a frame of another client for one of this transfer."""
        return self.code in _MIXED_UP


class Garbled(Exception):
    """The server broke the protocol; the client must then send :attr:`Transfer.abort`."""


class Transfer(ABC):
    """One transfer to or from the entry ``index``:``sub``; see the module for its use."""

    #: Command specifiers of the reply to the first request, and of those to segments.
    _first: ClassVar[int]
    _further: ClassVar[int]

    def __init__(self, index: int, sub: int, request: bytes) -> None:
        self.index = index
        self.sub = sub
        self.request = request
        self.done = False
        self._started = False
        self._toggle = 0

    def is_answer(self, reply: bytes) -> bool:
        """Return whether ``reply`` can be the answer to the last request.

        Every client of a node gets all its replies: one about another entry, or of another kind,
        answers another client. A reply that is not of eight bytes answers nobody, see :meth:`feed`.
        """
        if len(reply) != 8:
            return True
        specifier = reply[0] & 0xE0
        if self._started and specifier == self._further:
            return True  # segments have no index
        expected = (_ABORT,) if self._started else (_ABORT, self._first)
        return specifier in expected and reply[1:4] == self.request[1:4]

    def feed(self, reply: bytes) -> bytes | None:
        """Take a reply of the server; return the next request, or None at the end.

        Raises:
            Aborted: the server refuses.
            Garbled: the reply is none to the last request.

        """
        if len(reply) != 8:
            raise Garbled(f"the reply has {len(reply)} bytes, expected 8")
        if reply[0] == _ABORT:
            raise Aborted(int.from_bytes(reply[4:], "little"))
        return self._step(reply)

    @abstractmethod
    def _step(self, reply: bytes) -> bytes | None:
        """Take a reply of eight bytes that is no abort; as :meth:`feed`."""

    def abort(self, code: int) -> bytes:
        """Return the frame that ends the transfer from this side."""
        return _MULTIPLEXER.pack(_ABORT, self.index, self.sub, code.to_bytes(4, "little"))

    def _expect(self, reply: bytes, specifier: int, mask: int = 0xE0) -> None:
        if reply[0] & mask != specifier:
            raise Garbled(
                f"the reply begins with 0x{reply[0]:02X}, expected 0x{specifier:02X} "
                f"under the mask 0x{mask:02X}"
            )

    def _expect_entry(self, reply: bytes) -> None:
        _, index, sub, _ = _MULTIPLEXER.unpack(reply)
        if (index, sub) != (self.index, self.sub):
            raise Garbled(
                f"the reply is for {index:04X}:{sub:02X}, expected {self.index:04X}:{self.sub:02X}"
            )

    def _expect_toggle(self, reply: bytes, specifier: int) -> None:
        self._expect(reply, specifier)
        if reply[0] & _TOGGLE != self._toggle:
            raise Garbled("the toggle bit of a segment is wrong")


class Download(Transfer):
    """Writes ``data``: expedited up to 4 bytes, else in segments of 7."""

    _first, _further = _SERVER_DOWNLOADED, _SERVER_SEGMENT_TAKEN

    def __init__(self, index: int, sub: int, data: bytes) -> None:
        if not data:
            raise ValueError("an SDO download carries at least one byte")
        if len(data) <= 4:  # expedited, size indicated
            head = _CLIENT_DOWNLOAD | (4 - len(data)) << 2 | 0b11
            body = data
        else:  # segmented, size indicated
            head, body = _CLIENT_DOWNLOAD | 0b01, struct.pack("<I", len(data))
        super().__init__(index, sub, _MULTIPLEXER.pack(head, index, sub, body))
        self._rest = data if len(data) > 4 else b""

    def _step(self, reply: bytes) -> bytes | None:
        if not self._started:
            self._expect(reply, _SERVER_DOWNLOADED)
            self._expect_entry(reply)
            self._started = True
        else:
            self._expect_toggle(reply, _SERVER_SEGMENT_TAKEN)
            self._toggle ^= _TOGGLE
        if not self._rest:
            self.done = True
            return None
        part, self._rest = self._rest[:7], self._rest[7:]
        head = _CLIENT_SEGMENT | self._toggle | (7 - len(part)) << 1 | (not self._rest)
        return bytes([head]) + part.ljust(7, b"\0")


class Upload(Transfer):
    """Reads the value into :attr:`data`; at most ``limit`` bytes."""

    _first, _further = _SERVER_UPLOAD, _SERVER_SEGMENT

    def __init__(self, index: int, sub: int, limit: int = 1024) -> None:
        super().__init__(index, sub, _MULTIPLEXER.pack(_CLIENT_UPLOAD, index, sub, b""))
        self.data = b""
        self._limit = limit
        self._size: int | None = None
        self._unsized = False  # expedited, without a size: data may have more than the value

    def value(self, size: int) -> bytes:
        """Return the value of an entry of ``size`` bytes.

        A reply in one frame need not state its size; what it has beyond ``size`` is then left out.
        """
        return self.data[:size] if self._unsized else self.data

    def _step(self, reply: bytes) -> bytes | None:
        if not self._started:
            self._started = True
            return self._begin(reply)
        self._expect_toggle(reply, _SERVER_SEGMENT)
        self._toggle ^= _TOGGLE
        self.data += reply[1 : 8 - ((reply[0] >> 1) & 0b111)]
        if len(self.data) > self._limit:
            raise Garbled(f"the value is longer than {self._limit} bytes")
        if not reply[0] & 1:
            return self._next()
        if self._size not in (None, len(self.data)):
            raise Garbled(f"{len(self.data)} bytes came, {self._size} were announced")
        self.done = True
        return None

    def _begin(self, reply: bytes) -> bytes | None:
        self._expect(reply, _SERVER_UPLOAD)
        self._expect_entry(reply)
        expedited, sized = reply[0] & 0b10, reply[0] & 0b01
        if expedited:
            self.data = reply[4 : 8 - ((reply[0] >> 2) & 0b11)] if sized else reply[4:]
            self._unsized = not sized
            self.done = True
            return None
        if sized:
            self._size = int.from_bytes(reply[4:], "little")
        return self._next()

    def _next(self) -> bytes:
        return bytes([_CLIENT_NEXT | self._toggle]) + bytes(7)
