"""The simulated card, register by register (MF 624 User's Manual, tables of BADR0 to BADR2)."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from support.cards.card import Terminals

from rigd_sim.wire.cards.mf624_registers import Mf624Registers, Wires

ADDATA = ADCTRL = (2, 0x00)
DIN = DOUT = (2, 0x10)
ADSTART = DA0 = (2, 0x20)
DA1 = (2, 0x22)
GPIOC = (0, 0x54)
IRC0, IRC3, IRCSTATUS = (4, 0x70), (4, 0x7C), (4, 0x6C)
BASE, EOLC, LDAC, DACEN = 0x024006C0, 1 << 17, 1 << 23, 1 << 26


@pytest.fixture
def terminals() -> Terminals:
    return Terminals()


def scan(card: Mf624Registers, mask: int) -> list[int]:
    """Convert the inputs in ``mask`` and return eight reads of the FIFO."""
    card.w16(ADCTRL, mask)
    card.r16(ADSTART)
    while card.r32(GPIOC) & EOLC:
        pass
    return [card.r16(ADDATA) for _ in range(8)]


@pytest.mark.parametrize(
    ("volts", "word"),
    [(0.0, 0), (5.0, 0x1000), (-5.0, 0x3000), (10.0, 0x1FFF), (99, 0x1FFF), (-10, 0x2000),
     (-99, 0x2000), (-10 / 8192, 0x3FFF)],
)  # fmt: skip
def test_conversion_is_14_bits_in_twos_complement(
    terminals: Terminals, volts: float, word: int
) -> None:
    terminals.volts_in[4] = volts
    assert scan(terminals.card(), 1 << 4)[0] == word


def test_fifo_gives_scan_in_order_then_all_ones(terminals: Terminals) -> None:
    terminals.volts_in = [item * 10 / 8192 for item in range(8)]
    card = terminals.card()
    assert scan(card, 0b10100110) == [1, 2, 5, 7, *[0xFFFF] * 4]
    card.r16(ADSTART)
    card.r32(GPIOC)
    assert card.r16((2, 0x0E)) == 1, "the register is mirrored"
    assert card.r32(ADDATA) == 5 << 16 | 2, "32 bits pop two words"


def test_reading_adstart_converts_and_eolc_shows_the_end(
    terminals: Terminals,
) -> None:
    card = terminals.card()
    card.w16(ADCTRL, 1)
    terminals.volts_in[0] = 5.0
    assert not card.r32(GPIOC) & EOLC
    card.r16(ADSTART)
    terminals.volts_in[0] = 0.0
    assert card.r16(ADDATA) == 0xFFFF, "too early"
    assert card.r32(GPIOC) == BASE | EOLC
    assert card.r32(GPIOC) == BASE
    assert card.r16(ADDATA) == 0x1000


def test_unread_words_come_first(terminals: Terminals) -> None:
    card = terminals.card()
    terminals.volts_in[0] = 5.0
    card.w16(ADCTRL, 1)
    card.r16(ADSTART)
    terminals.volts_in[0] = -5.0
    assert scan(card, 1)[:2] == [0x1000, 0x3000]


def test_writing_and_reading_one_address_are_two_things(terminals: Terminals) -> None:
    card = terminals.card()
    terminals.lines_in = 0x5A
    card.w16(DOUT, 0x1A5)
    assert (terminals.lines_out, card.r16(DIN)) == (0xA5, 0x5A)
    card.w16(ADCTRL, 0xFF)
    card.w16(DA0, 0)
    assert card.r16(ADDATA) == 0xFFFF, "writing DA0 starts no conversion"


def test_outputs_are_grounded_until_dacen_then_full_scale(terminals: Terminals) -> None:
    card = terminals.card()
    assert terminals.volts_out == [0.0] * 8
    card.w32(GPIOC, BASE | DACEN)
    assert terminals.volts_out[0] == pytest.approx(10.0, abs=2e-3)
    card.w16(DA0, 0x0000)
    card.w16(DA1, 0x3000)
    assert terminals.volts_out[:2] == [-10.0, 5.0]
    card.w32(GPIOC, BASE)
    assert terminals.volts_out == [0.0] * 8


def test_outputs_held_by_ldac_change_together(terminals: Terminals) -> None:
    card = terminals.card()
    card.w32(GPIOC, BASE | DACEN | LDAC)
    held = list(terminals.volts_out)
    card.w16(DA0, 0x2000)
    card.w16(DA1, 0x1000)
    assert terminals.volts_out == held
    card.w32(GPIOC, BASE | DACEN)
    assert terminals.volts_out[:2] == [0.0, -5.0]


def test_counters_wrap_and_show_the_index(terminals: Terminals) -> None:
    terminals.counts = [-1, 0, 0, 2**32 + 5]
    terminals.index = [False, True, False, True]
    card = terminals.card()
    assert (card.r32(IRC0), card.r32(IRC3)) == (0xFFFFFFFF, 5)
    assert card.r32(IRCSTATUS) == 0x01000100


def test_physics_advances_to_now_before_a_read() -> None:
    looks: list[str] = []

    def volts() -> float:
        looks.append("volts")
        return 0.0

    def count() -> int:
        looks.append("count")
        return 0

    card = Mf624Registers(
        Wires(volts_in={0: volts}, counts_in={0: count}, advance=lambda: looks.append("now"))
    )
    card.w16(ADCTRL, 1)
    card.r16(ADSTART)
    card.r32(IRC0)
    assert looks == ["now", "volts", "now", "count"]


@pytest.mark.parametrize("rail", ["high", "low"])
def test_saturated_input_reads_its_rail(terminals: Terminals, rail: str) -> None:
    card = terminals.card()
    card.inject("saturation", input=1, rail=rail)
    assert scan(card, 0b11)[:2] == [0, 0x1FFF if rail == "high" else 0x2000]


def test_stuck_input_keeps_its_code(terminals: Terminals) -> None:
    card = terminals.card()
    terminals.volts_in[:2] = [5.0, 5.0]
    scan(card, 0b11)
    card.inject("stuck_code", input=1)
    terminals.volts_in[:2] = [-5.0, -5.0]
    assert scan(card, 0b11)[:2] == [0x3000, 0x1000]


def test_fault_open_input_picks_up_mains() -> None:
    clock = [0]
    card = Mf624Registers(Wires(), lambda: clock[0])
    card.inject("open_input", input=0)
    for t_ns, code in ((0, 0), (5_000_000, 2458), (10_000_000, 0), (15_000_000, -2458)):
        clock[0] = t_ns
        assert scan(card, 1)[0] == code & 0x3FFF, "3 V, 50 Hz"


def test_fault_eolc_stuck_and_fifo_short(terminals: Terminals) -> None:
    card = terminals.card()
    card.inject("fifo_short", words=2)
    assert scan(card, 0b111)[:2] == [0, 0xFFFF]
    card.inject("eolc_stuck")
    card.r16(ADSTART)
    assert all(card.r32(GPIOC) & EOLC for _ in range(1000))
    card.clear("eolc_stuck")
    card.r32(GPIOC)
    assert not card.r32(GPIOC) & EOLC


def test_card_encoder_shows_each_fault(terminals: Terminals) -> None:
    card = terminals.card()
    terminals.counts[0] = 1000
    card.inject("sign_flip", encoder=0)
    terminals.counts[0] = 1010
    assert card.r32(IRC0) == 990
    card.inject("index_reset", encoder=0)
    assert card.r32(IRC0) == 0
    terminals.counts[0] = 1015
    assert card.r32(IRC0) == 2**32 - 5


def test_removed_card_drops_outputs_and_lines(terminals: Terminals) -> None:
    card = terminals.card()
    card.inject("card_removed")
    card.w16(DOUT, 0xFF)
    card.w32(GPIOC, BASE | DACEN)
    assert (terminals.lines_out, terminals.volts_out) == (0, [0.0] * 8)
    assert (card.r32(GPIOC), card.r16(DIN), card.r32(IRC0)) == (2**32 - 1, 0xFFFF, 2**32 - 1)
    card.clear()
    assert card.r32(GPIOC) == BASE


@pytest.mark.parametrize(
    ("inject", "message"),
    [
        (lambda card: card.inject("smoke"), "no fault 'smoke'; it knows eolc_stuck, fifo_short"),
        (
            lambda card: card.inject("stuck_code"),
            "'input' of fault 'stuck_code' is missing; one of",
        ),
        (
            lambda card: card.inject("stuck_code", input=8),
            "'input' of fault 'stuck_code' is 8; one of",
        ),
        (
            lambda card: card.inject("saturation", input=0, rail="up"),
            "'rail' of fault 'saturation' is 'up'; one of",
        ),
        (lambda card: card.inject("eolc_stuck", input=0), "no option 'input'; it takes none"),
    ],
)
def test_faults_it_does_not_know(
    terminals: Terminals, inject: Callable[[Mf624Registers], None], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        inject(terminals.card())
