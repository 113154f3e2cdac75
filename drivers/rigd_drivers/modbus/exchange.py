"""Sends one Modbus request at a time and accepts only the reply to it; the module does no I/O.

On a serial line a reply has no number. If a reply arrives after rigd has given up the request, the
reply could be taken for the answer to the next request (measured: a read of register 6 got the
value of register 5). So after any failure rigd sends nothing until the device's longest reply time
is over. Bytes that arrive during this time are discarded and counted.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from rigd_drivers.modbus.framing import Framing, Trouble
from rigd_drivers.modbus.pdu import Request

#: Status bits that one :class:`Trouble` each takes, from this one up, and those of their count.
TROUBLE_BIT: Final = 8
COUNT_BIT: Final = 16
#: Unit and check sum, around the PDU of a frame on a serial line.
_AROUND: Final = 3


@dataclass(frozen=True, slots=True)
class Timing:
    """Times of a request and its reply on the wire, in ns."""

    timeout_ns: int  #: the device answers within, once it has the whole request
    settle_ns: int = 0  #: after a failure: from the request until no reply can come any more
    gap_ns: int = 0  #: silence between frames
    byte_ns: int = 0  #: one byte on the wire


@dataclass(frozen=True, slots=True)
class Answer:
    """The answer to ``request``: the registers read, none after a write."""

    request: Request
    words: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Failure:
    """``request`` ended without an answer; ``code`` is the exception code if it was refused."""

    request: Request
    trouble: Trouble
    code: int = 0


class Exchange:
    """The state of one connection: idle, waiting for an answer, or waiting for silence."""

    def __init__(self, framing: Framing, unit: int, timing: Timing) -> None:
        self.timing = timing
        #: How often each :class:`Trouble` was met, in their order.
        self.counts = [0] * len(Trouble)
        self._framing = framing
        self._unit = unit
        self._buffer = bytearray()
        self._request: Request | None = None
        self._give_up_ns = 0
        self._settled_ns = 0  # when no reply to the request under way can come any more
        self._late_until_ns = 0  # the same, of those given up
        self._free_ns = 0
        self._noise = False
        self._seen: Trouble | None = None  # what came, other than the answer waited for
        self._news = 0

    @property
    def waiting(self) -> bool:
        """Whether a request is out."""
        return self._request is not None

    @property
    def next_ns(self) -> int:
        """When time alone changes the state: the request is given up, or the line is free."""
        return self._free_ns if self._request is None else self._give_up_ns

    def free(self, now_ns: int) -> bool:
        """Return whether a request may be sent."""
        return self._request is None and now_ns >= self._free_ns

    def send(self, request: Request, now_ns: int) -> bytes:
        """Return the frame to send now; only while :meth:`free`."""
        frame = self._framing.wrap(self._unit, request)
        wire_ns = self._wire_ns(request)
        self._request = request
        self._give_up_ns = now_ns + wire_ns + self.timing.timeout_ns
        self._settled_ns = now_ns + wire_ns + self.timing.settle_ns
        self._noise, self._seen = False, None
        return frame

    def longest_ns(self, request: Request) -> int:
        """Return how long ``request`` takes at most, in ns: to be sent, acted on and answered."""
        return self._wire_ns(request) + self.timing.timeout_ns

    def receive(self, data: bytes, now_ns: int) -> Answer | Failure | None:
        """Take in what has come (or nothing); return how the request ended, once it has.

        Raises:
            ProtocolError: what comes is not Modbus.

        """
        self._buffer += data
        request = self._request
        if request is None:
            if data:
                self._ignore(now_ns)
            return None
        while self._buffer:
            pdu = self._framing.unwrap(self._buffer, self._unit, request)
            if isinstance(pdu, bytes):
                return self._finish(request, pdu, now_ns)
            if pdu is None:
                break
            self._count(pdu)  # of another request: ours may still come
            if pdu is not Trouble.LATE:
                self._seen = pdu
        if now_ns < self._give_up_ns:
            return None
        trouble = self._framing.leftover(self._buffer, self._unit, request)
        failure = self._fail(request, trouble, now_ns)
        return failure if self._seen is None else Failure(request, self._seen)

    def abandon(self, now_ns: int) -> None:
        """Give up the request under way, if any, and leave the line alone for one gap only.

        For a write that cannot wait: its answer is an echo that no late reply can be taken for.
        Each later request waits again.
        """
        gap_over_ns = now_ns + self.timing.gap_ns
        if self._request is not None:
            self._give_up(now_ns)
            self._free_ns = gap_over_ns
        self._free_ns = min(self._free_ns, gap_over_ns)

    def status(self) -> int:
        """Return the troubles since the last call (bits 8 to 15), and their count (16 to 23)."""
        news, self._news = self._news, 0
        return news << TROUBLE_BIT | (sum(self.counts) & 0xFF) << COUNT_BIT

    def _finish(self, request: Request, pdu: bytes, now_ns: int) -> Answer | Failure:
        code = request.refusal(pdu)
        if code is not None:
            self._rest(now_ns)
            self._count(Trouble.REFUSED)
            return Failure(request, Trouble.REFUSED, code)
        words = request.words(pdu)
        if words is None:
            return self._fail(request, Trouble.WRONG_REPLY, now_ns)
        self._rest(now_ns)
        return Answer(request, words)

    def _fail(self, request: Request, trouble: Trouble, now_ns: int) -> Failure:
        self._give_up(now_ns)
        self._count(trouble)
        return Failure(request, trouble)

    def _give_up(self, now_ns: int) -> None:
        """End the request under way; a reply to it may come yet."""
        if self.timing.settle_ns:
            self._buffer.clear()
            self._late_until_ns = max(self._late_until_ns, self._settled_ns)
        self._rest(now_ns)

    def _rest(self, now_ns: int) -> None:
        self._request = None
        self._free_ns = max(now_ns + self.timing.gap_ns, self._late_until_ns)

    def _ignore(self, now_ns: int) -> None:
        """Discard unsolicited bytes, and wait until they end."""
        if not self.timing.settle_ns:
            return  # on TCP it stays in the buffer, its number will identify it
        self._buffer.clear()
        self._free_ns = max(self._free_ns, now_ns + self.timing.gap_ns)
        if not self._noise:
            self._noise = True
            self._count(Trouble.LATE)

    def _wire_ns(self, request: Request) -> int:
        bytes_on_wire = len(request.pdu) + request.reply_size + 2 * _AROUND
        return bytes_on_wire * self.timing.byte_ns

    def _count(self, trouble: Trouble) -> None:
        self.counts[trouble] += 1
        self._news |= 1 << trouble
