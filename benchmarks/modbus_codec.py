"""What pymodbus's framers and PDU classes cost, beside the codec written by hand before them.

One exchange: a read of five registers is framed, its reply taken in, the words returned. The old
codec is kept here alone, as the baseline. Both run through the driver's own ``Exchange``, in CPU
time of this thread, interleaved, medians of rounds. Then one cycle of the whole driver with nothing
due or come, which is what most cycles are, and one whole exchange over a real socket.

    python benchmarks/modbus_codec.py
"""

from __future__ import annotations

import socket
import statistics
import struct
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from figures import at_most, noted

from rigd_drivers.modbus import framing, pdu
from rigd_drivers.modbus.client import Client
from rigd_drivers.modbus.exchange import Answer, Exchange, Timing
from rigd_drivers.modbus.transport import TcpTransport

ROUNDS, EXCHANGES = 31, 400
#: The driver asks at most so often, in Hz, in a cycle of 1 kHz.
FASTEST_HZ, CYCLE_HZ = 100, 1000
FIRST, COUNT = 6, 5
PATIENT = Timing(10_000_000_000)
TROUBLE = framing.Trouble


# -- the codec by hand, as it was ------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class OldRequest(pdu.Request):
    """A read, its reply taken apart by `struct`."""

    def words(self, reply: bytes) -> tuple[int, ...] | None:
        """Return the registers read."""
        if len(reply) != self.reply_size or reply[0] != self.function:
            return None
        count = (self.reply_size - 2) // 2
        return struct.unpack_from(f">{count}H", reply, 2) if reply[1] == 2 * count else None

    def refusal(self, reply: bytes) -> int | None:
        """Return the code of an exception."""
        refused = len(reply) == 2 and reply[0] == self.function | pdu.REFUSAL
        return reply[1] if refused else None


def old_read(address: int, count: int) -> OldRequest:
    """Return the request for ``count`` registers."""
    return OldRequest(struct.pack(">BHH", 3, address, count), 2 + 2 * count, "")


class OldTcp(framing.TcpFraming):
    """The MBAP header by `struct`."""

    _STRUCT = struct.Struct(">HHHB")

    def wrap(self, unit: int, request: pdu.Request) -> bytes:
        """Return the frame."""
        self._transaction = (self._transaction + 1) & 0xFFFF
        self._sent += 1
        return self._STRUCT.pack(self._transaction, 0, len(request.pdu) + 1, unit) + request.pdu

    def unwrap(
        self, buffer: bytearray, unit: int, request: pdu.Request
    ) -> bytes | framing.Trouble | None:
        """Return the PDU."""
        if len(buffer) < self._STRUCT.size:
            return None
        transaction, protocol, length, got_unit = self._STRUCT.unpack_from(buffer)
        if protocol != 0 or length not in self._LENGTHS:
            raise ValueError("not Modbus")
        if len(buffer) < 6 + length:
            return None
        reply = bytes(buffer[7 : 6 + length])
        del buffer[: 6 + length]
        if transaction != self._transaction:
            return TROUBLE.LATE
        return reply if got_unit == unit else TROUBLE.WRONG_UNIT


class OldRtu(framing.RtuFraming):
    """The check sum by a table."""

    def wrap(self, unit: int, request: pdu.Request) -> bytes:
        """Return the frame."""
        body = bytes([unit]) + request.pdu
        return body + crc16(body).to_bytes(2, "little")

    def unwrap(
        self, buffer: bytearray, unit: int, request: pdu.Request
    ) -> bytes | framing.Trouble | None:
        """Return the PDU."""
        if len(buffer) < 4 or buffer[0] != unit:
            return None
        refused = buffer[1] == request.function | pdu.REFUSAL
        if not refused and buffer[1] != request.function:
            return None
        size = 5 if refused else request.reply_size + 3
        if len(buffer) != size or crc16(buffer[:-2]) != int.from_bytes(buffer[-2:], "little"):
            return None
        reply = bytes(buffer[1:-2])
        buffer.clear()
        return reply


def crc16(data: bytes | bytearray) -> int:
    """Return the check sum of a frame."""
    crc = 0xFFFF
    for byte in data:
        crc = (crc >> 8) ^ CRC_TABLE[(crc ^ byte) & 0xFF]
    return crc


def crc_of(byte: int) -> int:
    """Return the entry of the table."""
    for _ in range(8):
        byte = (byte >> 1) ^ (0xA001 if byte & 1 else 0)
    return byte


CRC_TABLE = tuple(crc_of(byte) for byte in range(256))


# -- the exchanges ---------------------------------------------------------------------------------


def replies(exchange: Exchange, request: pdu.Request, serial: bool) -> Callable[[], bytes]:
    """Return what begins an exchange and makes the bytes that answer it."""
    values = struct.pack(f">BB{COUNT}H", 3, 2 * COUNT, *range(100, 100 + COUNT))
    body = bytes([1]) + values
    rtu = body + crc16(body).to_bytes(2, "little")

    def answer() -> bytes:
        frame = exchange.send(request, 0)
        return rtu if serial else frame[:5] + bytes([len(body)]) + body

    return answer


def exchanging(kind: framing.Framing, request: pdu.Request) -> Callable[[], None]:
    """Return one exchange through ``kind``."""
    exchange = Exchange(kind, 1, PATIENT)
    answer = replies(exchange, request, isinstance(kind, framing.RtuFraming))

    def once() -> None:
        outcome = exchange.receive(answer(), 0)
        assert isinstance(outcome, Answer)
        assert outcome.words == tuple(range(100, 100 + COUNT))

    return once


def on_a_socket(kind: framing.Framing, request: pdu.Request) -> Callable[[], None]:
    """Return one exchange of a client whose server answers from the same thread."""
    listening = socket.create_server(("127.0.0.1", 0))
    transport = TcpTransport(*listening.getsockname())
    client = Client(transport, Exchange(kind, 1, PATIENT))
    client.open()
    served, _ = listening.accept()
    body = bytes([1]) + struct.pack(f">BB{COUNT}H", 3, 2 * COUNT, *range(COUNT))

    def once() -> None:
        client.start(request)
        frame = served.recv(260)
        served.send(frame[:5] + bytes([len(body)]) + body)
        while client.poll() is None:
            pass

    return once


def waiting(kind: framing.Framing, request: pdu.Request) -> Callable[[], None]:
    """Return a look of the cycle at a connection whose answer has not come."""
    exchange = Exchange(kind, 1, PATIENT)
    exchange.send(request, 0)
    return lambda: _nothing(exchange)


def _nothing(exchange: Exchange) -> None:
    assert exchange.receive(b"", 0) is None


def microseconds(once: Callable[[], None]) -> float:
    """Return the CPU time of one call."""
    begun = time.thread_time_ns()
    for _ in range(EXCHANGES):
        once()
    return (time.thread_time_ns() - begun) / EXCHANGES / 1e3


def interleaved(pair: Sequence[Callable[[], None]]) -> tuple[float, float, float]:
    """Return the medians of both in us, and that of their ratio, round by round."""
    times = [[microseconds(once) for once in pair] for _ in range(ROUNDS)]
    before, after = (statistics.median(each) for each in zip(*times, strict=True))
    return before, after, statistics.median(new / old for old, new in times)


def main() -> None:
    """Compare both codecs, and put the difference beside a cycle."""
    new, old = pdu.read_registers(FIRST, COUNT), old_read(FIRST, COUNT)
    assert new.pdu == old.pdu
    extra_us = 0.0
    for name, before, after in (
        ("TCP", OldTcp(), framing.TcpFraming()),
        ("RTU", OldRtu(), framing.RtuFraming()),
    ):
        old_us, new_us, ratio = interleaved((exchanging(before, old), exchanging(after, new)))
        noted(f"exchange on {name}, codec by hand", old_us, "us")
        noted(f"exchange on {name}, pymodbus", new_us, "us")
        noted(f"exchange on {name}, pymodbus / by hand", ratio, "x")
        extra_us = max(extra_us, new_us - old_us)
        _, _, idle = interleaved((waiting(before, old), waiting(after, new)))
        at_most(f"a cycle in which nothing comes on {name}, after / before", idle, 1.1)
    *_, ratio = interleaved((on_a_socket(OldTcp(), old), on_a_socket(framing.TcpFraming(), new)))
    noted("exchange over a socket, both ends, pymodbus / by hand", ratio, "x")
    share = extra_us * FASTEST_HZ / 1e6
    at_most(f"more CPU of the thread at {FASTEST_HZ} exchanges per second", 100 * share, 0.5, "%")
    noted("that is, per cycle of 1 kHz", extra_us * FASTEST_HZ / CYCLE_HZ, "us")


if __name__ == "__main__":
    main()
