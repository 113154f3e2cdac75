"""Frames, identifiers, NMT, emergencies: bytes of linux/can.h and CiA 301 (4.2.0)."""

from __future__ import annotations

import pytest

from rigd_drivers.can.canopen import emcy, frames, nmt


def test_a_frame_is_laid_out_as_linux_does() -> None:
    # struct can_frame of linux/can.h: u32 identifier, u8 length, 3 bytes, 8 bytes.
    packet = bytes.fromhex("81 01 00 00 03 00 00 00 37 12 4D 00 00 00 00 00")
    assert frames.pack(0x181, b"\x37\x12\x4d") == packet
    assert frames.unpack(packet) == (0x181, b"\x37\x12\x4d")


@pytest.mark.parametrize("packet", [b"", bytes(15), bytes(17), b"\x81\x01\x00\x00\x09" + bytes(11)])
def test_a_packet_that_is_no_frame_is_refused(packet: bytes) -> None:
    with pytest.raises(ValueError, match="CAN frame"):
        frames.unpack(packet)


@pytest.mark.parametrize(
    ("identifier", "words"),
    [
        (0x000, "0x000 (NMT command)"),
        (0x080, "0x080 (SYNC)"),
        (0x081, "0x081 (EMCY of node 1)"),
        (0x1FF, "0x1FF (TPDO1 of node 127)"),
        (0x282, "0x282 (TPDO2 of node 2)"),
        (0x581, "0x581 (SDO reply of node 1)"),
        (0x70B, "0x70B (heartbeat of node 11)"),
        (0x7FF, "0x7FF"),
        (frames.EXTENDED | 0x181, "0x00000181 (29 bits, not CANopen)"),
    ],
)
def test_identifier_is_described_in_words(identifier: int, words: str) -> None:
    assert frames.describe(identifier) == words


@pytest.mark.parametrize(
    ("identifier", "detail", "words"),
    [
        (0x2000_0040, 0, "bus-off"),
        (0x2000_0020, 0, "no node acknowledges"),
        (0x2000_0088, 0, "frames are destroyed"),
        (0x2000_0004, 0x01, "receive overflow"),
        (0x2000_0004, 0x20, "error passive"),
    ],
)
def test_error_frame_is_described_in_words(identifier: int, detail: int, words: str) -> None:
    # Classes and details of linux/can/error.h.
    data = bytes([0, detail, 0, 0, 0, 0, 0, 0])
    assert words in frames.describe_error(identifier, data)
    unread = words == "receive overflow"
    assert frames.is_only_news(identifier, data) is frames.is_overflow(identifier, data) is unread


def test_a_restarted_controller_is_no_error() -> None:
    assert frames.is_only_news(0x2000_0100, bytes(8))


def test_nmt_commands_and_heartbeats_match_the_standard() -> None:
    # CiA 301, tables of the NMT command specifiers and of the NMT states.
    assert nmt.command(nmt.Command.START, 1) == bytes.fromhex("01 01")
    assert nmt.command(nmt.Command.PRE_OPERATIONAL, 127) == bytes.fromhex("80 7F")
    assert nmt.command(nmt.Command.RESET_NODE, 2) == bytes.fromhex("81 02")
    assert nmt.heartbeat() == b"\x05"
    assert nmt.read_heartbeat(b"\x00") is nmt.State.BOOT_UP
    assert nmt.read_heartbeat(b"\x7f") is nmt.State.PRE_OPERATIONAL
    assert nmt.read_heartbeat(b"\x85") is nmt.State.OPERATIONAL  # bit 7 is reserved
    assert nmt.read_heartbeat(b"\x42") is None
    assert nmt.read_heartbeat(b"\x05\x00") is None


def test_an_emergency_of_a_lost_heartbeat() -> None:
    # Error code, error register with bits generic and communication, 5 bytes of the maker.
    found = emcy.decode(bytes.fromhex("30 81 11 00 00 00 00 00"))
    assert found is not None
    assert found.code == emcy.HEARTBEAT_LOST
    assert not found.is_reset
    assert str(found) == (
        "emergency 0x8130 (heartbeat of the master lost) (error register: generic, communication)"
    )


def test_bytes_of_manufacturer_are_shown_as_they_are() -> None:
    found = emcy.decode(bytes.fromhex("10 23 03 DE AD 00 00 01"))
    assert str(found).endswith("(overcurrent at the output) "
                               "(error register: generic, current) [de ad 00 00 01]")  # fmt: skip


def test_an_emergency_reset_and_a_short_frame() -> None:
    gone = emcy.decode(bytes(8))
    assert gone is not None
    assert gone.is_reset
    assert emcy.decode(bytes(7)) is None


@pytest.mark.parametrize(
    ("code", "words"),
    [
        (0x8210, "a PDO was too short and not processed"),
        (0x8250, "RPDO timed out"),
        (0x3220, "supply undervoltage"),
        (0x7305, "encoder 1 error"),
        (0x7399, "sensor"),  # the class of the upper byte
        (0x2999, "current"),  # of the upper nibble
        (0xFF01, "device specific"),
        (0x0100, "not in the standard"),
    ],
)
def test_emergency_codes_are_described_in_words(code: int, words: str) -> None:
    assert emcy.describe(code) == f"0x{code:04X} ({words})"
