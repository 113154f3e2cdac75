"""The link's accesses, one by one: on this card one too many, or one too wide, is an error."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from support.cards.card import BenchMf624, Terminals

from rigd.sdk import LinkError
from rigd_drivers.cards.mf624.link import Mf624Config

Access = tuple[object, ...]  # what, BAR, offset, and the value written

#: Registers by the manual's names: (BAR, offset).
ADDATA = ADCTRL = (2, 0x00)
DIN = DOUT = (2, 0x10)
ADSTART = (2, 0x20)
GPIOC, INTCSR = (0, 0x54), (0, 0x4C)
IRCCTRL = IRCSTATUS = (4, 0x6C)
HOLD, DRIVE, GROUNDED = 0x06C006C0, 0x064006C0, 0x024006C0
ALL_ZERO_VOLTS = [("w16", 2, 0x20 + 2 * item, 0x2000) for item in range(8)]


class Recorder:
    """Registers that note every access and answer reads as set."""

    def __init__(self) -> None:
        self.log: list[Access] = []
        self.answers: dict[tuple[int, int], Callable[[], int]] = {}
        self.closed = 0

    def r16(self, register: tuple[int, int]) -> int:
        self.log.append(("r16", *register))
        return self.answers.get(register, int)()

    def w16(self, register: tuple[int, int], value: int) -> None:
        self.log.append(("w16", *register, value))

    def r32(self, register: tuple[int, int]) -> int:
        self.log.append(("r32", *register))
        return self.answers.get(register, int)()

    def w32(self, register: tuple[int, int], value: int) -> None:
        self.log.append(("w32", *register, value))

    def close(self) -> None:
        self.closed += 1

    def taken(self) -> list[Access]:
        log, self.log = self.log, []
        return log


@pytest.fixture
def io() -> Recorder:
    return Recorder()


def opened(io: Recorder, **options: object) -> BenchMf624:
    link = BenchMf624(io, **options)
    link.open()
    io.taken()
    return link


def test_opening_checks_and_rests_outputs_before_driving(io: Recorder) -> None:
    link = BenchMf624(io, high_at_rest=[1, 4])
    link.open()
    assert io.taken() == [
        ("r32", *GPIOC),
        ("w16", *DOUT, 0b10010),
        *ALL_ZERO_VOLTS,  # they wake at full scale
        ("w32", *GPIOC, DRIVE),
        ("w32", *INTCSR, 0),
        ("w32", *IRCCTRL, 0x80808080),
        *[("r16", *ADDATA)] * 8,
    ]
    assert link.alone == [True]


def test_scan_is_started_once_and_read_in_order(io: Recorder) -> None:
    link = opened(io)
    link.use_inputs(analog=(5, 0), encoders=(2,))
    link.use_inputs(analog=(3,), encoders=(0,))
    words = iter((0x1000, 0x3000, 0x2000))
    busy = iter((1 << 17, 1 << 17, 0))
    io.answers = {
        ADDATA: lambda: next(words),
        GPIOC: lambda: 0x024006C0 | next(busy),
        (4, 0x70): lambda: 7,
        (4, 0x78): lambda: 0xFFFFFFFE,
        IRCSTATUS: lambda: 0x00010000,
        DIN: lambda: 0xFFA5,
    }
    link.begin(0)
    assert io.taken() == [
        ("w16", *ADCTRL, 0b101001),
        ("r16", *ADSTART),
        ("r32", 4, 0x70),
        ("r32", 4, 0x78),
        ("r32", *IRCSTATUS),
        ("r16", *DIN),
        *[("r32", *GPIOC)] * 3,
        *[("r16", *ADDATA)] * 3,
    ]
    assert [link.volts[item] for item in (0, 3, 5)] == [5.0, -5.0, -10.0]
    assert link.volts[1] != link.volts[1], "an input nobody uses has no value"
    assert [link.counts[0], link.counts[2]] == [7, 0xFFFFFFFE]
    assert (link.indexes, link.lines) == (0b100, 0xA5)


def test_without_inputs_no_conversion_is_started(io: Recorder) -> None:
    link = opened(io)
    link.begin(0)
    assert io.taken() == [("r16", *DIN), ("r32", *GPIOC)]


def test_outputs_change_together_and_lines_after_them(io: Recorder) -> None:
    link = opened(io)
    link.take_outputs(analog=(1, 4), lines=(3,))
    link.set_volts(4, -5.0)
    link.set_volts(1, 99.0)
    link.set_line(3, high=True)
    link.end(0)
    assert io.taken() == [
        ("w32", *GPIOC, HOLD),
        ("w16", 2, 0x22, 0x3FFF),
        ("w16", 2, 0x28, 0x1000),
        ("w32", *GPIOC, DRIVE),
        ("w16", *DOUT, 0b1000),
    ]


def test_one_shot_gets_one_edge_per_cycle(io: Recorder) -> None:
    link = opened(io, one_shot={"output": 6, "time": "20 ms", "input": 2, "active": "low"})
    io.answers[DIN] = lambda: 0b100
    levels = []
    for _ in range(4):
        link.begin(0)
        link.end(0)
        levels += [item[3] for item in io.taken() if item[:3] == ("w16", 2, 0x10)]
    assert levels == [1 << 6, 0, 1 << 6, 0]
    assert not link.one_shot_up, "its output is active low, and high"
    link.put_out()
    assert io.taken() == [("w16", *DOUT, 0)], "only a cycle retriggers it"


def test_closing_rests_card_and_repeats_silently(io: Recorder) -> None:
    link = opened(io, high_at_rest=[0])
    link.take_outputs(analog=(0,), lines=(0,))
    link.set_line(0, high=False)
    link.close()
    assert io.taken() == [("w16", *DOUT, 1), *ALL_ZERO_VOLTS, ("w32", *GPIOC, DRIVE)]
    link.close()
    link.put_out()
    assert (io.taken(), io.closed) == ([], 1)


def test_rescue_grounds_outputs_over_connection_of_its_own(io: Recorder) -> None:
    link = BenchMf624(io, high_at_rest=[2])
    link.rescue()
    assert io.taken() == [
        ("r32", *GPIOC),
        ("w16", *DOUT, 0b100),
        *ALL_ZERO_VOLTS,
        ("w32", *GPIOC, GROUNDED),
        ("r32", *GPIOC),
    ]
    assert (link.alone, io.closed) == ([False], 1)


def test_conversion_that_never_ends_is_not_waited_for(io: Recorder) -> None:
    link = opened(io)
    link.use_inputs(analog=(0,))
    io.answers[GPIOC] = lambda: 0x024006C0 | 1 << 17
    with pytest.raises(LinkError, match=r"converter .* 1 inputs .*100 reads"):
        link.begin(0)
    assert ("r16", *ADDATA) not in io.taken()


def test_lost_card_is_detected_at_every_stage(io: Recorder) -> None:
    link = opened(io)
    io.answers[GPIOC] = lambda: 0xFFFFFFFF
    with pytest.raises(LinkError, match="is gone"):
        link.begin(0)
    for attempt in (BenchMf624(io).open, BenchMf624(io).rescue):
        io.taken()
        with pytest.raises(LinkError, match="is gone"):
            attempt()
        assert io.taken() == [("r32", *GPIOC)], "nothing was written"
    assert io.closed == 2


def test_scan_that_came_short_is_seen_by_reference() -> None:
    terminals = Terminals()
    card = terminals.card()
    terminals.volts_in[:2] = [1.0, -2.0]
    terminals.volts_in[7] = 5.1
    link = BenchMf624(card, reference={"input": 7, "voltage": "5 V", "tolerance": "0.2 V"})
    link.open()
    link.use_inputs(analog=(0, 1))
    link.begin(0)
    assert link.volts[:2] == pytest.approx([1.0, -2.0], abs=1e-3)
    card.inject("fifo_short", words=1)
    with pytest.raises(LinkError, match=r"input 7 reads -0\.001 V, .*5 V"):
        link.begin(0)
    card.clear()
    terminals.volts_in[7] = 4.7
    link.open()
    link.use_inputs(analog=(0, 1))
    with pytest.raises(LinkError, match=r"reads 4\.\d+ V"):
        link.begin(0)


def test_fifo_left_by_killed_master_shifts_nothing() -> None:
    terminals = Terminals()
    card = terminals.card()
    terminals.volts_in[:2] = [1.0, 2.0]
    card.w16(ADCTRL, 0b11)
    card.r16(ADSTART)  # and no further: it was killed here
    link = BenchMf624(card)
    link.open()
    link.use_inputs(analog=(0, 1))
    link.begin(0)
    assert link.volts[:2] == pytest.approx([1.0, 2.0], abs=1e-3)


@pytest.mark.parametrize(
    ("use", "message"),
    [
        (lambda link: link.use_inputs(analog=(8,)), "no analogue input 8; it has 0 to 7"),
        (lambda link: link.use_inputs(encoders=(4,)), "no encoder 4"),
        (lambda link: link.use_inputs(lines=(9,)), "no digital input 9"),
        (lambda link: link.take_outputs(analog=(8,)), "no analogue output 8"),
        (lambda link: link.take_outputs(lines=(8,)), "no digital output 8"),
        (lambda link: link.take_outputs(analog=(3,)), "analogue output 3 is used twice"),
        (lambda link: link.take_outputs(lines=(2,)), "digital output 2 is used twice"),
        (lambda link: link.take_outputs(lines=(7,)), "digital output 7 is used twice"),
        (lambda link: link.use_inputs(analog=(6,)), "input 6 is not below input 6, the reference"),
    ],
)
def test_missing_or_doubly_used_card_inputs_are_refused(
    use: Callable[[BenchMf624], None], message: str
) -> None:
    link = BenchMf624(
        Terminals().card(),
        reference={"input": 6, "voltage": "5 V"},
        one_shot={"output": 7, "time": "20 ms", "input": 7},
    )
    link.open()
    link.take_outputs(analog=(3,), lines=(2,))
    with pytest.raises(LinkError, match=message):
        use(link)


def test_a_closed_card_has_no_readings(io: Recorder) -> None:
    with pytest.raises(LinkError, match="not open"):
        BenchMf624(io).begin(0)


def test_an_interface_that_is_not_installed_is_refused() -> None:
    with pytest.raises(ValueError, match=r"'comedi' .* uio, emulator, lugre"):
        Mf624Config.model_validate({"interface": "comedi"})
