"""Codes and addresses of the MF624 (MF 624 User's Manual, tables of BADR0 to BADR2)."""

from __future__ import annotations

import pytest

from rigd_drivers.cards.mf624 import registers as mf


@pytest.mark.parametrize(
    ("word", "volts"),
    [
        (0x0000, 0.0),
        (0x0001, 10 / 8192),
        (0x1FFF, 10 - 10 / 8192),
        (0x2000, -10.0),
        (0x3FFF, -10 / 8192),
        (0x1000, 5.0),
        (0x3000, -5.0),
    ],
)
def test_analogue_inputs_are_14_bits_in_twos_complement(word: int, volts: float) -> None:
    assert mf.volts_of(word) == volts
    assert mf.volts_of(word | 0xC000) == volts, "the upper two bits mean nothing"
    as_the_maker_computes = (word << 2 & 0xFFFF) - (0x10000 if word & 0x2000 else 0)
    assert mf.volts_of(word) == 10 * as_the_maker_computes / 32768


@pytest.mark.parametrize(
    ("volts", "code"),
    [
        (-10.0, 0x0000),
        (0.0, 0x2000),
        (5.0, 0x3000),
        (-5.0, 0x1000),
        (10.0, 0x3FFF),
        (99.0, 0x3FFF),
        (-99.0, 0x0000),
        (20 / 0x4000, 0x2001),
    ],
)
def test_analogue_outputs_clip_at_14_bit_offset_binary(volts: float, code: int) -> None:
    assert mf.code_of(volts) == code


def test_addresses_of_repeated_registers_are_right() -> None:
    assert [mf.da(item) for item in (0, 1, 7)] == [(2, 0x20), (2, 0x22), (2, 0x2E)]
    assert [mf.irc(item) for item in (0, 1, 3)] == [(4, 0x70), (4, 0x74), (4, 0x7C)]


def test_encoders_have_a_byte_each() -> None:
    assert mf.irc_control(filtered=False) == 0
    assert mf.irc_control(filtered=True) == 0x80808080
    assert mf.index_bits(0x00000001) == 0b0001
    assert mf.index_bits(0x01000100) == 0b1010
    assert mf.index_bits(0xFEFEFEFE) == 0
