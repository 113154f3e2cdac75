"""Golden frames: what the standard and the manuals print."""

from __future__ import annotations

import logging

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigd.sdk import ProtocolError
from rigd_drivers.modbus.framing import Framing, RtuFraming, TcpFraming, Trouble
from rigd_drivers.modbus.pdu import (
    READ_INPUT,
    Request,
    read_registers,
    write_register,
    write_registers,
)
from rigd_sim.wire.modbus.frames import check_sum, take_rtu, take_tcp

WATCHED = read_registers(0x0200, 2)


@pytest.mark.parametrize(
    ("request_", "asked", "answered", "words"),
    [
        # MODBUS Application Protocol V1.1b3, section 6.3, example.
        (read_registers(0x006B, 3), "03 00 6B 00 03", "03 06 02 2B 00 00 00 64", (555, 0, 100)),
        # Section 6.4.
        (read_registers(8, 1, READ_INPUT), "04 00 08 00 01", "04 02 00 0A", (10,)),
        # Section 6.6.
        (write_register(1, 3), "06 00 01 00 03", "06 00 01 00 03", ()),
        # Section 6.12.
        (write_registers(1, [10, 0x0102]), "10 00 01 00 02 04 00 0A 01 02", "10 00 01 00 02", ()),
    ],
)
def test_requests_and_answers_of_the_standard(
    request_: Request, asked: str, answered: str, words: tuple[int, ...]
) -> None:
    assert request_.pdu == bytes.fromhex(asked)
    assert request_.words(bytes.fromhex(answered)) == words


@pytest.mark.parametrize(
    ("request_", "asked", "answered", "pdu"),
    [
        # Delta ASDA-B user manual (January 2009), section 8.3, RTU mode: read of 2 words.
        (
            WATCHED,
            "01 03 02 00 00 02 C5 B3",
            "01 03 04 00 B1 1F 40 A3 D4",
            "03 04 00 B1 1F 40",
        ),
        # Delta ASDA-A2 user manual (January 2011), page 9-12: write of 2 words.
        (
            write_registers(0x0112, [0x0BB8, 0]),
            "01 10 01 12 00 02 04 0B B8 00 00 FC EB",
            "01 10 01 12 00 02 E0 31",
            "10 01 12 00 02",
        ),
        # ASDA-B, section 8.3, communication related error code: a refusal of a write.
        (write_register(0x0200, 100), "01 06 02 00 00 64 89 99", "01 86 02 C3 A1", "86 02"),
    ],
)
def test_serial_frames_of_the_delta_manuals(
    request_: Request, asked: str, answered: str, pdu: str
) -> None:
    framing = RtuFraming()
    assert framing.wrap(1, request_) == bytes.fromhex(asked)
    buffer = bytearray.fromhex(answered)
    assert framing.unwrap(buffer, 1, request_) == bytes.fromhex(pdu)
    assert not buffer


def test_the_check_sum_of_the_standard() -> None:
    # MODBUS over Serial Line V1.02, section 6.2.2: 02 07 gives 0x1241, sent as 41 12.
    assert check_sum(b"\x02\x07") == 0x1241  # the witness of the tests below
    assert RtuFraming().wrap(2, Request(b"\x07", 2, "")) == bytes.fromhex("02 07 41 12")


@pytest.mark.parametrize(
    "reply",
    [
        "03 02 00 B1 1F 40",  # a byte count of one register, two came
        "03 03 00 B1 1F 40",
        "03 06 00 B1 1F 40",
        "03 04 00 B1",
        "03 04 00 B1 1F 40 00",
        "04 04 00 B1 1F 40",
        "83",
        "83 02 00",
        "84 02",
        "80 02",
        "2B 0E 01 01 00 00",
        "08 00 00 00 00 00",
        "00",
    ],
)
def test_inconsistent_reply_is_not_decoded(reply: str) -> None:
    pdu = bytes.fromhex(reply)
    assert WATCHED.words(pdu) is None
    assert WATCHED.refusal(pdu) is None


@pytest.mark.parametrize(
    "reply", ["06 00 01 00 04", "06 00 02 00 03", "06 00 01 00", "10 00 01 00 03"]
)
def test_another_echo_acknowledges_no_write(reply: str) -> None:
    assert write_register(1, 3).words(bytes.fromhex(reply)) is None
    assert write_registers(1, [3]).words(bytes.fromhex(reply)) is None


@given(st.binary(min_size=1, max_size=12), st.booleans())
def test_only_the_answer_of_the_standard_is_read(reply: bytes, likely: bool) -> None:
    """Section 6.3 read strictly, as written here once more, decides what is an answer."""
    if likely:
        reply = b"\x03\x04" + reply
    words = None
    if len(reply) == 6 and reply[:2] == b"\x03\x04":
        words = (reply[2] << 8 | reply[3], reply[4] << 8 | reply[5])
    assert WATCHED.words(reply) == words
    code = reply[1] if len(reply) == 2 and reply[0] == 0x83 else None
    assert WATCHED.refusal(reply) == code


@given(
    st.integers(1, 247),
    st.integers(0, 0xFFFF - 123),
    st.lists(st.integers(0, 0xFFFF), min_size=1, max_size=123),
)
def test_frames_are_those_that_the_other_side_reads(
    unit: int, address: int, words: list[int]
) -> None:
    request = write_registers(address, words)
    ask = take_rtu(bytearray(RtuFraming().wrap(unit, request)))
    assert ask is not None
    assert (ask.unit, ask.pdu) == (unit, request.pdu)
    ask = take_tcp(bytearray(TcpFraming().wrap(unit, request)))
    assert ask is not None
    assert (ask.unit, ask.pdu, ask.transaction) == (unit, request.pdu, 1)


@pytest.mark.parametrize("framing", [TcpFraming(), RtuFraming()])
def test_an_answer_in_single_bytes_counts_once_whole(framing: Framing) -> None:
    framing.wrap(1, WATCHED)
    rtu = "01 03 04 00 B1 1F 40 A3 D4"
    tcp = "00 01 00 00 00 07 01 03 04 00 B1 1F 40"
    frame = bytes.fromhex(rtu if isinstance(framing, RtuFraming) else tcp)
    buffer = bytearray()
    for byte in frame[:-1]:
        buffer.append(byte)
        assert framing.unwrap(buffer, 1, WATCHED) is None
    buffer.append(frame[-1])
    assert framing.unwrap(buffer, 1, WATCHED) == bytes.fromhex("03 04 00 B1 1F 40")
    assert not buffer


def test_nothing_is_printed_about_what_cannot_be_read(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(logging.getLogger(), "handlers", [])  # as without logging set up
    assert WATCHED.words(b"\x03\x06\x00\xb1\x1f\x40") is None
    assert capsys.readouterr() == ("", "")


def test_tcp_frames_of_the_guide() -> None:
    # Messaging on TCP/IP Implementation Guide V1.0b, section 4.4.2.1: transaction 0x15 01, unit FF,
    # read of one register at 4.
    framing = TcpFraming()
    request = read_registers(4, 1)
    for _ in range(0x1501):
        frame = framing.wrap(0xFF, request)
    assert frame == bytes.fromhex("15 01 00 00 00 06 FF 03 00 04 00 01")
    buffer = bytearray.fromhex("15 01 00 00 00 05 FF 03 02 00 05")
    pdu = framing.unwrap(buffer, 0xFF, request)
    assert isinstance(pdu, bytes)
    assert request.words(pdu) == (5,)


@pytest.mark.parametrize(
    ("reply", "trouble"),
    [
        ("", Trouble.TIMEOUT),
        ("01 03 04 00 B1 1F 40 A3 D5", Trouble.CRC),
        ("01 03 04 00 B1", Trouble.GARBLED),
        ("55 01 03 04 00 B1 1F 40 A3 D4", Trouble.GARBLED),
        ("01 03 04 00 B1 1F 40 A3 D4 55", Trouble.GARBLED),
        ("01 06 02 00 00 64 89 99", Trouble.WRONG_REPLY),
        ("02 03 04 00 B1 1F 40 E7 D4", Trouble.WRONG_UNIT),
    ],
)
def test_inexact_answer_is_named_and_never_accepted(reply: str, trouble: Trouble) -> None:
    framing = RtuFraming()
    buffer = bytearray.fromhex(reply)
    if trouble is Trouble.WRONG_UNIT:
        buffer[-2:] = check_sum(buffer[:-2]).to_bytes(2, "little")
    assert framing.unwrap(buffer, 1, WATCHED) is None
    assert framing.leftover(buffer, 1, WATCHED) is trouble


@given(st.integers(0, 8 * 9 - 1), st.integers(1, 0xFFFF))
def test_burst_up_to_16_wrong_bits_is_rejected(position: int, pattern: int) -> None:
    """What a CRC-16 promises: every burst of at most 16 bits is found."""
    good = int.from_bytes(bytes.fromhex("01 03 04 00 B1 1F 40 A3 D4"), "big")
    spoiled = good ^ (pattern << position) & ((1 << 72) - 1)
    if spoiled == good:
        return
    buffer = bytearray(spoiled.to_bytes(9, "big"))
    assert RtuFraming().unwrap(buffer, 1, WATCHED) is None


@given(st.binary(max_size=300))
def test_noise_on_serial_line_is_never_answer(noise: bytes) -> None:
    framing = RtuFraming()
    buffer = bytearray(noise)
    assert framing.unwrap(buffer, 1, WATCHED) is None or check_sum(noise[:-2]) == int.from_bytes(
        noise[-2:], "little"
    )


def test_late_and_unknown_transactions_give_different_trouble() -> None:
    framing = TcpFraming()
    framing.wrap(1, WATCHED)
    framing.wrap(1, WATCHED)
    answer = "00 00 00 07 01 03 04 00 B1 1F 40"
    assert framing.unwrap(bytearray.fromhex("00 01" + answer), 1, WATCHED) is Trouble.LATE
    never = framing.unwrap(bytearray.fromhex("80 02" + answer), 1, WATCHED)
    assert never is Trouble.WRONG_TRANSACTION
    other = framing.unwrap(
        bytearray.fromhex("00 02" + answer.replace("07 01", "07 09")), 1, WATCHED
    )
    assert other is Trouble.WRONG_UNIT
    assert isinstance(framing.unwrap(bytearray.fromhex("00 02" + answer), 1, WATCHED), bytes)


def test_bytes_that_are_not_modbus_are_reported() -> None:
    framing = TcpFraming()
    framing.wrap(1, WATCHED)
    with pytest.raises(ProtocolError, match="does not speak Modbus TCP"):
        framing.unwrap(bytearray(b"HTTP/1.1 400"), 1, WATCHED)


@pytest.mark.parametrize("count", [0, 126])
def test_more_registers_than_the_standard_allows_are_refused(count: int) -> None:
    with pytest.raises(ValueError, match=f"cannot read {count} registers"):
        read_registers(0, count)
