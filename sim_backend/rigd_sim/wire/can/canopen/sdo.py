"""Simulates the SDO server of a node: expedited and segmented transfers (CiA 301, 7.2.4.3)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from rigd_sim.wire.can.canopen.dictionary import Abort, AbortCode, Dictionary, Entry

#: Command specifiers of the client, bits 7 to 5 of the first byte.
DOWNLOAD_SEGMENT: Final = 0
INITIATE_DOWNLOAD: Final = 1
INITIATE_UPLOAD: Final = 2
UPLOAD_SEGMENT: Final = 3
ABORT: Final = 4
#: First byte of the server's answers: its command specifier in bits 7 to 5.
DOWNLOAD_INITIATED: Final = 0x60
SEGMENT_DOWNLOADED: Final = 0x20
UPLOAD_INITIATED: Final = 0x40
ABORTED: Final = 0x80
#: Bits of the first byte that begins a transfer: the data are in this frame; the size is stated.
EXPEDITED: Final = 0x02
SIZED: Final = 0x01
#: Bit of the first byte of a segment: no more segments follow.
LAST: Final = 0x01
#: An SDO is always 8 bytes long.
LENGTH: Final = 8
SEGMENT: Final = 7
#: Longest download taken, in bytes; no object of these nodes is longer.
LONGEST: Final = 1024


@dataclass
class _Transfer:
    """A segmented transfer under way."""

    entry: Entry
    upload: bool
    data: bytearray
    announced: int | None = None
    toggle: int = 0
    sent: int = field(default=0)


def abort_frame(index: int, sub: int, code: int) -> bytes:
    """Return the abort of a transfer."""
    return (
        bytes([ABORTED]) + index.to_bytes(2, "little") + bytes([sub]) + code.to_bytes(4, "little")
    )


def is_segment(request: bytes) -> bool:
    """Return whether a client continues a transfer; the answer then bears a toggle bit."""
    return request[0] >> 5 in (DOWNLOAD_SEGMENT, UPLOAD_SEGMENT)


def is_upload(request: bytes) -> bool:
    """Return whether a client begins to read."""
    return request[0] >> 5 == INITIATE_UPLOAD


def is_download(request: bytes) -> bool:
    """Return whether a client writes."""
    return request[0] >> 5 in (DOWNLOAD_SEGMENT, INITIATE_DOWNLOAD)


class SdoServer:
    """Answers one request after the other; free of I/O."""

    def __init__(self, dictionary: Dictionary, *, segmented: bool = False) -> None:
        self._dictionary = dictionary
        self._segmented = segmented  #: answers short uploads in segments, too
        self._transfer: _Transfer | None = None

    def reset(self) -> None:
        """Forget a transfer under way."""
        self._transfer = None

    def answer(self, request: bytes) -> bytes | None:
        """Return the answer to a request of 8 bytes; None if there is none."""
        if len(request) != LENGTH:
            return None
        command = request[0] >> 5
        index, sub = int.from_bytes(request[1:3], "little"), request[3]
        transfer = self._transfer
        if transfer is not None and command in (DOWNLOAD_SEGMENT, UPLOAD_SEGMENT):
            index, sub = transfer.entry.index, transfer.entry.sub
        try:
            if command == INITIATE_DOWNLOAD:
                return self._begin_download(request, index, sub)
            if command == INITIATE_UPLOAD:
                return self._begin_upload(index, sub)
            if command == DOWNLOAD_SEGMENT and transfer is not None and not transfer.upload:
                return self._take_segment(transfer, request)
            if command == UPLOAD_SEGMENT and transfer is not None and transfer.upload:
                return self._give_segment(transfer, request)
            self._transfer = None
            if command == ABORT:
                return None
            raise Abort(AbortCode.UNKNOWN_COMMAND)
        except Abort as refused:
            self._transfer = None
            return abort_frame(index, sub, refused.code)

    def _begin_download(self, request: bytes, index: int, sub: int) -> bytes:
        """Write a value of up to 4 bytes, or begin a segmented download; return the answer."""
        self._transfer = None
        entry = self._dictionary.find(index, sub)
        expedited, sized = request[0] & EXPEDITED, request[0] & SIZED
        if expedited:
            length = 4 - (request[0] >> 2 & 0x03) if sized else entry.kind.bits // 8
            entry.write(request[4 : 4 + length])
        else:
            announced = int.from_bytes(request[4:8], "little") if sized else None
            if announced is not None and announced > LONGEST:
                raise Abort(AbortCode.TOO_LONG)
            self._transfer = _Transfer(entry, False, bytearray(), announced)
        return bytes([DOWNLOAD_INITIATED]) + request[1:4] + bytes(4)

    def _take_segment(self, transfer: _Transfer, request: bytes) -> bytes:
        """Add a segment to a download, and write the value with the last; return the answer."""
        self._check_toggle(transfer, request)
        transfer.data += request[1 : LENGTH - (request[0] >> 1 & 0x07)]
        if len(transfer.data) > LONGEST:
            raise Abort(AbortCode.TOO_LONG)
        reply = bytes([SEGMENT_DOWNLOADED | transfer.toggle << 4]) + bytes(SEGMENT)
        transfer.toggle ^= 1
        if request[0] & LAST:
            self._transfer = None
            if transfer.announced not in (None, len(transfer.data)):
                raise Abort(AbortCode.WRONG_LENGTH)
            transfer.entry.write(bytes(transfer.data))
        return reply

    def _begin_upload(self, index: int, sub: int) -> bytes:
        """Return a value of up to 4 bytes, or begin a segmented upload and return its size."""
        self._transfer = None
        entry = self._dictionary.find(index, sub)
        data = entry.pack()
        head = index.to_bytes(2, "little") + bytes([sub])
        if 0 < len(data) <= 4 and not self._segmented:
            first = UPLOAD_INITIATED | (4 - len(data)) << 2 | EXPEDITED | SIZED
            return bytes([first]) + head + data.ljust(4, b"\0")
        self._transfer = _Transfer(entry, True, bytearray(data))
        return bytes([UPLOAD_INITIATED | SIZED]) + head + len(data).to_bytes(4, "little")

    def _give_segment(self, transfer: _Transfer, request: bytes) -> bytes:
        """Return the next segment of an upload."""
        self._check_toggle(transfer, request)
        data = transfer.data[transfer.sent : transfer.sent + SEGMENT]
        transfer.sent += len(data)
        last = transfer.sent >= len(transfer.data)
        first = transfer.toggle << 4 | (SEGMENT - len(data)) << 1 | last
        transfer.toggle ^= 1
        if last:
            self._transfer = None
        return bytes([first]) + bytes(data).ljust(SEGMENT, b"\0")

    def _check_toggle(self, transfer: _Transfer, request: bytes) -> None:
        if request[0] >> 4 & 0x01 != transfer.toggle:
            raise Abort(AbortCode.TOGGLE)
