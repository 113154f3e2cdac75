"""The link to an NI card with outputs and counters, over NI's gRPC protocol."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import pytest
from support.cards.ni_card import ServedCard, cycle, ni_card, wait_until_expired

from rigd.sdk import DeviceError, LinkError
from rigd_drivers.cards.counter import EncoderCounter
from rigd_drivers.cards.ni_io.config import NiIoConfig
from rigd_drivers.cards.ni_io.link import NiIo
from rigd_drivers.cards.pulses import CardPulses, CardPulsesConfig


@pytest.fixture
def card() -> Iterator[ServedCard]:
    with ni_card() as found:
        yield found


@pytest.fixture
def link(card: ServedCard) -> Iterator[NiIo]:
    found = card.link()
    found.open()
    yield found
    card.clear()
    with suppress(DeviceError):  # it has lost the tasks of this link
        found.close()


def test_card_is_named_and_stands_at_rest(card: ServedCard) -> None:
    card.block.volts_out[:2] = [3.0, -3.0]
    link = card.link(high_at_rest=[2])
    link.open()
    try:
        assert link.identity == "PCIe-6363, serial number 01C0FFEE, NI-DAQmx 24.5.0"
        assert (card.block.volts_out[:2], card.block.lines_out) == ([0.0, 0.0], 0b100)
    finally:
        link.close()
    assert card.block.lines_out == 0b100
    assert card.state()["tasks"] == 0


def test_cycle_reads_all_inputs_and_sets_all_outputs(card: ServedCard, link: NiIo) -> None:
    link.use_inputs(analog=(0, 5), encoders=(1,), lines=(3,))
    link.take_outputs(analog=(1,), lines=(4,))
    card.block.volts_in[0], card.block.volts_in[5] = 1.25, -9.0
    card.block.counts[1] = -1234
    card.block.lines_in = 0b1000
    link.set_volts(1, 2.5)
    link.set_line(4, high=True)
    cycle(link)
    link.sample()
    assert link.volts[0] == pytest.approx(1.25, abs=2e-4)
    assert link.volts[5] == pytest.approx(-9.0, abs=2e-4)
    assert link.counts[1] == 2**32 - 1234
    assert link.lines & 0b1000
    assert card.block.volts_out[1] == 2.5
    assert card.block.lines_out == 0b1001_0000  # the watchdog's own is up


def test_voltage_beyond_range_is_clipped(card: ServedCard, link: NiIo) -> None:
    link.set_volts(0, -12.0)
    link.put_out()
    assert card.block.volts_out[0] == -10.0


def test_lines_rest_although_analog_outputs_fail(card: ServedCard, link: NiIo) -> None:
    def lose_task() -> None:
        (lost,) = [name for name in card.part._tasks if "ao" in name]
        del card.part._tasks[lost]

    link.set_volts(0, 4.0)
    link.set_line(4, high=True)
    cycle(link)
    card.on_loop(lose_task)
    link.set_volts(0, 0.0)
    link.set_line(4, high=False)
    with pytest.raises(DeviceError):
        link.put_out()
    assert not card.block.lines_out & 0b1_0000


def test_counter_that_wraps_is_counted_on(card: ServedCard, link: NiIo) -> None:
    counter = EncoderCounter(0, fastest=1e12)
    counter.open(link, at_zero=True)
    for position in (2**30, 2**31 - 5, 2**31 + 5, 3 * 2**30, 2**32 + 7, 2**32 - 1):
        card.block.counts[0] = position
        link.sample()
        assert counter.take(link) == position


@pytest.mark.parametrize(("decoding", "counts"), [("x1", 25), ("x2", 50), ("x4", 100)])
def test_decoding_sets_counts_of_a_line(card: ServedCard, decoding: str, counts: int) -> None:
    link = card.link(decoding=decoding)
    link.open()
    link.use_inputs(encoders=(0,))
    card.block.counts[0] = 100
    link.sample()
    link.close()
    assert link.counts[0] == counts


def test_index_pulse_shows_in_the_sample_after_it(card: ServedCard) -> None:
    link = card.link(edge_counters=[3], index_counters={0: 3})
    link.open()
    link.use_inputs(encoders=(0,))
    seen = []
    for pulses in (0, 1, 1, 2):
        card.block.counts[3] = pulses
        link.sample()
        seen.append(link.indexes)
    link.close()
    assert seen == [0, 1, 0, 1]


def test_pulses_give_quantity_since_the_opening(card: ServedCard) -> None:
    link = card.link(edge_counters=[2])
    link.open()
    options = {"counter": 2, "name": "volume", "unit": "m^3", "scale": "0.5 cm^3/count"}
    flow = CardPulses(CardPulsesConfig.model_validate(options), link)
    card.block.counts[2] = 1000
    flow.open()
    card.block.counts[2] += 40
    link.begin(0)
    volume, pulses = flow.read(0)
    assert volume == pytest.approx(20e-6)
    assert pulses == 40.0
    link.close()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"unit": "mm"}, "mm is not an SI unit"),
        ({"unit": "m", "scale": "1 mm"}, "scale '1 mm' is not in m/count"),
        ({"unit": "m", "scale": "0 mm/count"}, "must not be 0"),
    ],
)
def test_pulses_without_meaning_are_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        CardPulsesConfig.model_validate({"counter": 0, **options})


def test_reset_counter_is_no_motion(card: ServedCard, link: NiIo) -> None:
    counter = EncoderCounter(0, fastest=1e6)
    counter.open(link, at_zero=True)
    card.block.counts[0] = 50_000_000
    link.sample()
    with pytest.raises(DeviceError, match="jumped by 50000000 counts"):
        counter.take(link)


def test_watchdog_is_seen_acting_and_starts_again(card: ServedCard, link: NiIo) -> None:
    assert 0.0 < link.prove_one_shot() < 30.0
    assert not card.state()["watchdog_running"]
    assert card.block.lines_out == 0
    cycle(link)
    link.sample()
    assert link.one_shot_up
    assert card.state()["watchdog_running"]


def test_dead_watchdog_is_named(card: ServedCard, link: NiIo) -> None:
    card.inject("watchdog_dead")
    with pytest.raises(DeviceError, match="watchdog of the card was still up"):
        link.prove_one_shot()


def test_open_wire_of_the_watchdog_is_named(card: ServedCard, link: NiIo) -> None:
    card.block.cut = True
    with pytest.raises(DeviceError, match="does not come up") as caught:
        link.prove_one_shot()
    assert "digital output 7 and digital input 7" in str(caught.value.hint)


def test_card_without_guarded_volts_is_named() -> None:
    with ni_card(guards_volts=False) as card:
        link = card.link()
        link.open()
        with pytest.raises(DeviceError, match="start the watchdog"):
            link.prove_one_shot()
        link.close()
        lines_only = card.link(watchdog={"output": 7, "input": 7, "time": "0.4 s", "analog": False})
        lines_only.open()
        lines_only.prove_one_shot()
        lines_only.close()


def test_silence_brings_outputs_to_rest(card: ServedCard, link: NiIo) -> None:
    link.set_volts(0, 5.0)
    link.set_line(0, high=True)
    cycle(link)
    assert (card.block.volts_out[0], card.block.lines_out) == (5.0, 0b1000_0001)
    wait_until_expired(card)
    assert (card.block.volts_out[0], card.block.lines_out) == (0.0, 0)
    link.set_volts(0, 4.0)
    with pytest.raises(DeviceError, match=r"watchdog of NI card Dev1 .* has expired"):
        link.end(0)
    link.sample()
    assert not link.one_shot_up


def test_expired_card_counts_as_safe(card: ServedCard, link: NiIo) -> None:
    link.set_volts(0, 5.0)
    cycle(link)
    card.inject("watchdog_expired")
    with pytest.raises(DeviceError, match="has expired"):
        link.confirm_outputs()
    link.set_volts(0, 0.0)
    link.put_out()
    link.confirm_outputs()


def test_card_opens_after_watchdog_has_expired(card: ServedCard, link: NiIo) -> None:
    link.set_volts(0, 5.0)
    cycle(link)
    card.inject("watchdog_expired")
    other = card.link()
    other.open()  # the tasks of the first one are cleared: it is dead
    other.set_volts(0, 1.0)
    cycle(other)
    assert card.block.volts_out[0] == 1.0
    other.close()


def test_card_that_another_feeds_is_left_alone(card: ServedCard, link: NiIo) -> None:
    card.inject("watchdog_dead")  # as good as fed
    cycle(link)
    with pytest.raises(LinkError, match="kept enabled: another rigd"):
        card.link().open()
    assert card.block.lines_out == 0x80


def test_rescue_brings_held_outputs_to_rest(card: ServedCard, link: NiIo) -> None:
    card.inject("watchdog_dead")
    link.set_volts(0, 5.0)
    link.set_line(0, high=True)
    cycle(link)
    card.link().rescue()
    assert (card.block.volts_out[0], card.block.lines_out) == (0.0, 0)


def test_rescue_of_expired_or_idle_card_succeeds(card: ServedCard, link: NiIo) -> None:
    cycle(link)
    card.inject("watchdog_expired")
    card.link().rescue()
    link.close()
    card.block.volts_out[0] = 3.0
    card.link().rescue()
    assert card.block.volts_out[0] == 0.0


@pytest.mark.parametrize(
    ("fault", "options", "words"),
    [
        ("removal", {}, r"is gone \(NI-DAQmx -201003"),
        ("reset", {}, "NI-DAQmx -200088"),
        ("stall", {"seconds": 2.0}, "the device server fails"),
    ],
)
def test_failing_card_ends_the_cycle(
    card: ServedCard, link: NiIo, fault: str, options: dict[str, Any], words: str
) -> None:
    link.use_inputs(analog=(0,))
    cycle(link)
    card.inject(fault, **options)
    with pytest.raises((DeviceError, LinkError), match=words):
        link.begin(0)


def test_wrong_card_is_refused(card: ServedCard) -> None:
    with pytest.raises(LinkError, match="there is no NI card Dev7"):
        card.link(device="Dev7").open()
    with pytest.raises(DeviceError, match="does not exist: ao4"):
        card.link(analog_outputs=6).open()
    link = card.link()
    with pytest.raises(LinkError, match="no analogue output 2; it has 0 to 1"):
        link.take_outputs(analog=(2,))
    with pytest.raises(LinkError, match="no digital input 8; it has 0 to 7"):
        link.use_inputs(lines=(8,))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"output_lines": "port0"}, "not lines of a port"),
        ({"output_lines": "port0/line7:0"}, "are -6 lines"),
        ({"input_lines": "port0/line7:14"}, "port0/line7 is a digital output and an input"),
        ({"one_shot": {"output": 1, "input": 1, "time": "0.1 s"},
          "watchdog": {"output": 7, "input": 7, "time": "0.1 s"}}, "not both"),
        ({"watchdog": {"output": 8, "input": 7, "time": "0.1 s"}}, "there are 0 to 7"),
        ({"input_lines": None, "watchdog": {"output": 7, "input": 7, "time": "0.1 s"}},
         "`input_lines` names none"),
        ({"watchdog": {"output": 7, "input": 7, "time": "0.1 s"}, "high_at_rest": [7]},
         "stands low at rest"),
        ({"high_at_rest": [9]}, "`high_at_rest` uses digital output 9"),
        ({"index_counters": {0: 1}}, "name it in `edge_counters`"),
        ({"device": "Dev 1"}, "device"),
        ({"analog_outputs": -1}, "analog_outputs"),
    ],
)  # fmt: skip
def test_wiring_that_cannot_be_is_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        NiIoConfig.model_validate({"input_lines": "port0/line8:15", **options})
