"""The exchange by itself: when it may send, and what it takes for an answer, on a clock by hand."""

from __future__ import annotations

from rigd_drivers.modbus.exchange import Answer, Exchange, Failure, Timing
from rigd_drivers.modbus.framing import RtuFraming, TcpFraming, Trouble
from rigd_drivers.modbus.pdu import read_registers, write_register
from rigd_sim.wire.modbus.frames import check_sum

MS = 1_000_000
RTU = Timing(50 * MS, settle_ns=200 * MS, gap_ns=2 * MS, byte_ns=MS // 10)
READ_5, READ_6 = read_registers(5, 1), read_registers(6, 1)
#: Request of 8 bytes and answer of 7 at 0.1 ms each.
WIRE = 15 * MS // 10


def answer(value: int) -> bytes:
    body = bytes([1, 3, 2, value >> 8, value & 0xFF])
    return body + check_sum(body).to_bytes(2, "little")


def test_serial_line_waits_for_gap_after_answer() -> None:
    exchange = Exchange(RtuFraming(), 1, RTU)
    exchange.send(READ_5, 0)
    assert not exchange.free(1 * MS)
    assert exchange.receive(answer(55)[:3], 3 * MS) is None
    assert exchange.receive(answer(55)[3:], 4 * MS) == Answer(READ_5, (55,))
    assert not exchange.free(5 * MS)
    assert exchange.free(6 * MS)


def test_late_answer_is_not_taken_for_next_ones() -> None:
    """The measured trap: register 6 read as the value of register 5."""
    exchange = Exchange(RtuFraming(), 1, RTU)
    exchange.send(READ_5, 0)
    given_up = 50 * MS + WIRE
    assert exchange.receive(b"", given_up - 1) is None
    assert exchange.receive(b"", given_up) == Failure(READ_5, Trouble.TIMEOUT)
    assert not exchange.free(200 * MS + WIRE - 1)
    assert exchange.receive(answer(55), 150 * MS) is None
    assert exchange.counts[Trouble.LATE] == 1
    assert exchange.free(200 * MS + WIRE)
    exchange.send(READ_6, 210 * MS)
    assert exchange.receive(answer(66), 214 * MS) == Answer(READ_6, (66,))


def test_late_bytes_delay_the_next_request() -> None:
    exchange = Exchange(RtuFraming(), 1, RTU)
    exchange.send(READ_5, 0)
    exchange.receive(b"", 60 * MS)
    late = 200 * MS + WIRE
    exchange.receive(answer(55)[:4], late)
    assert not exchange.free(late + MS)
    exchange.receive(answer(55)[4:], late + MS)
    assert exchange.free(late + 3 * MS)
    assert exchange.counts[Trouble.LATE] == 1  # one burst


def test_late_tcp_answer_does_not_delay_next_request() -> None:
    exchange = Exchange(TcpFraming(), 1, Timing(50 * MS))
    exchange.send(READ_5, 0)
    assert exchange.receive(b"", 50 * MS) == Failure(READ_5, Trouble.TIMEOUT)
    assert exchange.free(50 * MS)
    exchange.send(READ_6, 50 * MS)
    first = bytes.fromhex("00 01 00 00 00 05 01 03 02 00 37")
    second = bytes.fromhex("00 02 00 00 00 05 01 03 02 00 42")
    assert exchange.receive(first + second[:5], 60 * MS) is None
    assert exchange.receive(second[5:], 61 * MS) == Answer(READ_6, (66,))
    assert exchange.counts[Trouble.LATE] == 1


def test_status_reports_news_once_and_keeps_counting() -> None:
    exchange = Exchange(TcpFraming(), 1, Timing(50 * MS))
    for start in (0, 100 * MS):
        exchange.send(READ_5, start)
        exchange.receive(b"", start + 50 * MS)
    assert exchange.status() == 1 << 8 + Trouble.TIMEOUT | 2 << 16
    assert exchange.status() == 2 << 16


def test_abandoned_request_frees_line_after_one_gap() -> None:
    exchange = Exchange(RtuFraming(), 1, RTU)
    exchange.send(READ_5, 0)
    exchange.abandon(10 * MS)
    assert not exchange.free(11 * MS)
    assert exchange.free(12 * MS)


def test_reply_to_abandoned_request_never_answers_later_one() -> None:
    exchange = Exchange(RtuFraming(), 1, RTU)
    exchange.send(READ_5, 0)
    exchange.abandon(10 * MS)
    urgent = write_register(7, 0)
    frame = exchange.send(urgent, 12 * MS)
    assert exchange.receive(frame, 20 * MS) == Answer(urgent, ())  # a write is echoed
    assert not exchange.free(200 * MS + WIRE - 1)
    assert exchange.free(200 * MS + WIRE)


def test_a_refusal_carries_its_code() -> None:
    exchange = Exchange(TcpFraming(), 1, Timing(50 * MS))
    exchange.send(READ_5, 0)
    refused = exchange.receive(bytes.fromhex("00 01 00 00 00 03 01 83 06"), MS)
    assert refused == Failure(READ_5, Trouble.REFUSED, 6)
