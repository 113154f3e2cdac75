"""Packets of function 76 against bytes and addresses that are not from rigd's own map."""

from __future__ import annotations

import struct

import pytest

from rigd_drivers.cards.labjack import registers as lj
from rigd_drivers.cards.labjack.registers import Register, Write, packet

#: Addresses and types as LabJack's `ljm_constants.json` (2025.12.18) lists them.
PUBLISHED = {
    "AIN0": (0, "FLOAT32"), "AIN13": (26, "FLOAT32"), "AIN3_RANGE": (40006, "FLOAT32"),
    "AIN3_NEGATIVE_CH": (41003, "UINT16"), "AIN3_RESOLUTION_INDEX": (41503, "UINT16"),
    "DAC0": (1000, "FLOAT32"), "DAC1": (1002, "FLOAT32"), "TDAC0": (30000, "FLOAT32"),
    "TDAC21": (30042, "FLOAT32"), "DIO_STATE": (2800, "UINT32"),
    "DIO_DIRECTION": (2850, "UINT32"), "DIO_ANALOG_ENABLE": (2880, "UINT32"),
    "DIO_INHIBIT": (2900, "UINT32"), "DIO6_EF_READ_A": (3012, "UINT32"),
    "DIO6_EF_ENABLE": (44012, "UINT32"), "DIO6_EF_INDEX": (44112, "UINT32"),
    "LAST_ERR_DETAIL": (55000, "UINT16"), "PRODUCT_ID": (60000, "FLOAT32"),
    "FIRMWARE_VERSION": (60004, "FLOAT32"), "SERIAL_NUMBER": (60028, "UINT32"),
    "WATCHDOG_ENABLE_DEFAULT": (61600, "UINT32"), "WATCHDOG_ADVANCED_DEFAULT": (61602, "UINT32"),
    "WATCHDOG_TIMEOUT_S_DEFAULT": (61604, "UINT32"),
    "WATCHDOG_STARTUP_DELAY_S_DEFAULT": (61606, "UINT32"),
    "WATCHDOG_STRICT_ENABLE_DEFAULT": (61610, "UINT32"),
    "WATCHDOG_STRICT_KEY_DEFAULT": (61612, "UINT32"), "WATCHDOG_STRICT_CLEAR": (61614, "UINT32"),
    "WATCHDOG_RESET_ENABLE_DEFAULT": (61620, "UINT32"),
    "WATCHDOG_DIO_ENABLE_DEFAULT": (61630, "UINT32"),
    "WATCHDOG_DIO_STATE_DEFAULT": (61632, "UINT32"),
    "WATCHDOG_DIO_DIRECTION_DEFAULT": (61634, "UINT32"),
    "WATCHDOG_DIO_INHIBIT_DEFAULT": (61636, "UINT32"),
    "WATCHDOG_DAC0_ENABLE_DEFAULT": (61640, "UINT32"), "WATCHDOG_DAC0_DEFAULT": (61642, "FLOAT32"),
    "WATCHDOG_DAC1_ENABLE_DEFAULT": (61650, "UINT32"), "WATCHDOG_DAC1_DEFAULT": (61652, "FLOAT32"),
}  # fmt: skip
TYPES = {"UINT16": "H", "UINT32": "I", "FLOAT32": "f"}


def used() -> list[Register]:
    fixed = [item for item in vars(lj).values() if isinstance(item, Register)]
    return [
        *fixed, lj.ain(0), lj.ain(13), lj.ain_range(3), lj.ain_negative(3), lj.ain_resolution(3),
        lj.dac(0), lj.dac(1), lj.tdac(0), lj.tdac(21), lj.counted(6), lj.feature_enable(6),
        lj.feature_index(6), *map(lj.watchdog_dac_enable, (0, 1)), *map(lj.watchdog_dac, (0, 1)),
    ]  # fmt: skip


def test_every_register_is_as_published() -> None:
    found = {item.name: (item.address, item.kind) for item in used()}
    assert found == {name: (at, TYPES[kind]) for name, (at, kind) in PUBLISHED.items()}


def test_packet_has_the_bytes_of_its_frames() -> None:
    # As the tests of the crate async_labjack (mbfb.rs) have a write and two reads.
    asked = packet(Write(Register("A", 3, "I"), 0x12345678), Register("B", 1, "H"),
                   Register("C", 2, "I"))  # fmt: skip
    assert asked.data == bytes.fromhex("01 0003 02 12345678  00 0001 01  00 0002 02")
    assert asked.answer.unpack(bytes.fromhex("0007 0000002a")) == (7, 42)
    assert asked.names == ("A", "B", "C")


@pytest.mark.parametrize(("volts", "words"), [(0.0, "00000000"), (-10.0, "c1200000")])
def test_volts_are_big_endian_floats(volts: float, words: str) -> None:
    asked = packet(Write(lj.tdac(4), volts))
    assert asked.data == bytes.fromhex("01") + struct.pack(">HB", 30008, 2) + bytes.fromhex(words)
