"""The link to a LabJack T7, over Modbus TCP."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import pytest
from support.cards.labjack import ServedLabjack, cycle, labjack
from support.faults.stalls import witnessed

from rigd.model.errors import RigdError
from rigd.sdk import DeviceError, LinkError, ProtocolError
from rigd_drivers.cards.analog_servo import AnalogServo, AnalogServoConfig
from rigd_drivers.cards.counter import EncoderCounter
from rigd_drivers.cards.labjack.connection import Connection
from rigd_drivers.cards.labjack.device import CYCLE_S
from rigd_drivers.cards.labjack.link import Labjack
from rigd_drivers.cards.labjack.registers import SERIAL_NUMBER, packet
from rigd_drivers.cards.pulses import CardPulses, CardPulsesConfig

FED = 0x8000  #: line 15, which stands high while the watchdog is fed


@pytest.fixture
def card() -> Iterator[ServedLabjack]:
    with labjack() as found:
        yield found


@pytest.fixture
def link(card: ServedLabjack) -> Iterator[Labjack]:
    found = card.link()
    found.open()
    yield found
    card.clear()
    with suppress(RigdError):  # a fault has cut its connection
        found.close()


def test_device_is_named_and_stands_at_rest(card: ServedLabjack) -> None:
    card.block.volts_out[:2] = [3.0, -3.0]
    link = card.link(high_at_rest=[10])
    link.open()
    try:
        assert link.identity == "LabJack T7, serial number 470012345, firmware 1.0292"
        assert (card.block.volts_out[:3], card.state()["lines"]) == ([0.0] * 3, 1 << 10)
    finally:
        link.close()
    assert card.state()["lines"] == 1 << 10


def test_cycle_reads_all_inputs_and_sets_all_outputs(card: ServedLabjack, link: Labjack) -> None:
    link.use_inputs(analog=(0, 5), encoders=(2,), lines=(16,))
    link.take_outputs(analog=(1,), lines=(9,))
    card.block.volts_in[0], card.block.volts_in[5] = 1.25, -9.0
    card.block.counts[1] = -1234
    card.block.lines_in = 0b01
    link.set_volts(1, 2.5)
    link.set_line(9, high=True)
    asked = card.state()["asked"]
    cycle(link)
    assert card.state()["asked"] == asked + 2  # packets
    link.sample()
    assert link.volts[0] == pytest.approx(1.25, abs=5e-4)
    assert link.volts[5] == pytest.approx(-9.0, abs=5e-4)
    assert link.counts[2] == 2**32 - 1234
    assert link.lines >> 16 & 0b11 == 0b01
    assert card.block.volts_out[1] == 2.5
    assert card.state()["lines"] == 1 << 9 | FED


def test_differential_input_is_measured_against_the_next(card: ServedLabjack) -> None:
    link = card.link(differential=[2])
    link.open()
    link.use_inputs(analog=(2,))
    card.block.volts_in[2], card.block.volts_in[3] = 3.0, 1.0
    link.sample()
    assert link.volts[2] == pytest.approx(2.0, abs=5e-4)
    with pytest.raises(LinkError, match="analogue input 3 is used twice"):
        link.use_inputs(analog=(3,))
    link.close()


def test_volts_beyond_an_output_are_clipped(card: ServedLabjack, link: Labjack) -> None:
    link.set_volts(0, -12.0)
    link.set_volts(2, -1.0)
    link.put_out()
    assert card.block.volts_out[:3] == [-10.0, 0.0, 0.0]


def servo(link: Labjack, output: int) -> AnalogServo:
    """Return a servo amplifier that needs -10 to 10 V."""
    options = {
        "set_output": output, "set_scale": "0.2 A/V", "current_range": "2 A", "monitor_input": 0,
        "monitor_scale": "2.5 A/V", "enable_output": 8, "behind_one_shot": True,
    }  # fmt: skip
    return AnalogServo(AnalogServoConfig.model_validate(options), link)


def test_drive_on_output_of_one_sign_is_refused(link: Labjack) -> None:
    with pytest.raises(LinkError, match=r"gives 0 to 5 V; -2 to 2 A need -10 to 10 V") as caught:
        servo(link, 2).reserve()
    assert "LJTick-DAC" in str(caught.value.hint)


def test_counter_that_wraps_is_counted_on(card: ServedLabjack, link: Labjack) -> None:
    counter = EncoderCounter(0, fastest=1e15)
    counter.open(link, at_zero=True)
    for position in (2**30, 2**31 - 5, 2**31 + 5, 3 * 2**30, 2**32 + 7, 2**32 - 1):
        card.block.counts[0] = position
        link.sample()
        assert counter.take(link) == position


def test_reset_counters_are_no_motion(card: ServedLabjack, link: Labjack) -> None:
    counter = EncoderCounter(0, fastest=1.0)
    counter.open(link, at_zero=True)
    for position in range(40):
        card.block.counts[0] = position
        link.sample()
        assert counter.take(link) == position
    card.inject("counter_reset")
    link.sample()
    with pytest.raises(DeviceError, match="jumped by -39 counts"):
        counter.take(link)


def test_pulses_and_index_count_edges(card: ServedLabjack) -> None:
    link = card.link(index_counters={0: 7})
    link.open()
    options = {"counter": 6, "name": "volume", "unit": "m^3", "scale": "0.5 cm^3/count"}
    flow = CardPulses(CardPulsesConfig.model_validate(options), link)
    card.block.counts[2] = 1000
    flow.open()
    link.use_inputs(encoders=(0,))
    card.block.counts[2] += 40
    card.block.counts[3] += 1
    link.begin(0)
    assert flow.read(0) == pytest.approx((20e-6, 40.0))
    assert link.indexes == 1
    link.begin(0)
    assert link.indexes == 0
    link.close()


def test_watchdog_is_seen_acting_and_starts_again(card: ServedLabjack, link: Labjack) -> None:
    assert 0.9 < link.prove_one_shot() < 30.0
    assert card.state()["lines"] == 0
    cycle(link)
    link.sample()
    assert link.one_shot_up


def test_dead_watchdog_is_named(card: ServedLabjack) -> None:
    link = card.link(watchdog={"output": 15, "input": 19, "timeout": "1 s", "time": "1 s"})
    link.open()
    card.inject("watchdog_dead")
    with pytest.raises(DeviceError, match="watchdog of the card was still up"):
        link.prove_one_shot()
    link.close()


def test_open_wire_of_the_watchdog_is_named(card: ServedLabjack) -> None:
    link = card.link(watchdog={"output": 15, "input": 19, "timeout": "1 s", "time": "1 s"})
    link.open()
    card.block.cut = True
    with pytest.raises(DeviceError, match="does not come up") as caught:
        link.prove_one_shot()
    assert "digital output 15 and digital input 19" in str(caught.value.hint)
    link.close()


def test_silence_brings_lines_to_rest(card: ServedLabjack, link: Labjack) -> None:
    link.set_volts(0, 5.0)
    link.set_volts(2, 4.0)
    link.set_line(8, high=True)
    cycle(link)
    assert card.state()["lines"] == 1 << 8 | FED
    card.pass_time(0.9)
    assert card.state()["lines"] == 1 << 8 | FED
    card.pass_time(0.2)
    assert card.state()["lines"] == 0
    # It sets the outputs of the device; those of an LJTick-DAC keep their volts.
    assert (card.block.volts_out[0], card.block.volts_out[2]) == (5.0, 0.0)


def test_other_programs_do_not_feed_the_watchdog(card: ServedLabjack, link: Labjack) -> None:
    link.set_line(8, high=True)
    cycle(link)
    other = Connection("127.0.0.1", card.port)
    other.open(1.0)
    for _ in range(4):
        card.pass_time(0.3)
        other.ask(packet(SERIAL_NUMBER), time.monotonic() + 10)
    other.close()
    assert card.state()["lines"] == 0


def test_what_the_watchdog_switched_off_stays_off(card: ServedLabjack, link: Labjack) -> None:
    link.set_volts(0, 5.0)
    link.set_line(8, high=True)
    cycle(link)
    card.inject("watchdog_acts")
    with pytest.raises(DeviceError, match=r"watchdog of LabJack at .* has acted"):
        link.end(0)
    assert (card.block.volts_out[0], card.state()["lines"]) == (0.0, 0)


def test_stalled_program_writes_nothing_more(
    card: ServedLabjack, link: Labjack, monkeypatch: pytest.MonkeyPatch
) -> None:
    link.set_line(8, high=True)
    cycle(link)
    now = time.monotonic
    monkeypatch.setattr("rigd_drivers.cards.labjack.link.time.monotonic", lambda: now() + 1.5)
    with pytest.raises(DeviceError, match="has acted"):
        link.end(0)
    assert card.state()["lines"] == 0


def test_watchdog_is_written_to_flash_once(card: ServedLabjack) -> None:
    for _ in range(3):
        link = card.link()
        link.open()
        cycle(link)
        link.close()
    written = card.state()["watchdog_written"]
    assert 0 < written < 20  # every register once
    assert card.state()["watchdog_running"]
    link = card.link(high_at_rest=[10])
    link.open()
    link.close()
    assert card.state()["watchdog_written"] == 2 * written


def test_watchdog_that_no_file_asks_for_is_named(card: ServedLabjack, link: Labjack) -> None:
    with pytest.raises(DeviceError, match="the rig file has none"):
        card.link(watchdog=None).open()


def test_one_shot_is_toggled_by_every_cycle(card: ServedLabjack) -> None:
    link = card.link(watchdog=None, one_shot={"output": 15, "input": 19, "time": "0.4 s"})
    link.open()
    seen = []
    for _ in range(4):
        cycle(link)
        seen.append(bool(card.state()["lines"] & FED))
    link.close()
    assert seen == [True, False, True, False]


def test_card_that_another_feeds_is_left_alone(card: ServedLabjack, link: Labjack) -> None:
    card.inject("watchdog_dead")  # as good as fed
    cycle(link)
    watchdog = {"output": 15, "input": 19, "timeout": "1 s", "time": "1 s"}
    with pytest.raises(LinkError, match="kept enabled: another program"):
        card.link(watchdog=watchdog).open()
    assert card.state()["lines"] == FED


def test_rescue_brings_held_outputs_to_rest(card: ServedLabjack, link: Labjack) -> None:
    card.inject("watchdog_dead")
    link.set_volts(0, 5.0)
    link.set_line(8, high=True)
    cycle(link)
    card.link().rescue()
    assert (card.block.volts_out[0], card.state()["lines"]) == (0.0, 0)


def test_broken_connection_is_replaced_to_make_safe(card: ServedLabjack, link: Labjack) -> None:
    card.inject("watchdog_dead")
    drive = servo(link, 0)
    drive.open()
    drive.arm()
    drive.write((1.0,))
    cycle(link)
    assert (card.block.volts_out[0], card.state()["lines"]) == (5.0, 1 << 8 | FED)
    card.drop()
    with pytest.raises(LinkError, match="connection"):
        link.begin(0)
    drive.make_safe()
    drive.confirm_safe()
    assert (card.block.volts_out[0], card.state()["lines"]) == (0.0, 0)


def test_mute_card_is_waited_for_once(
    card: ServedLabjack, link: Labjack, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each drive of a card makes it safe: together they may not keep other devices waiting."""
    monkeypatch.setattr("rigd_drivers.cards.labjack.link.AWAY_S", 600.0)
    cycle(link)
    card.inject("silent")
    with pytest.raises(LinkError, match="answer"):
        link.put_out()
    with pytest.raises(LinkError, match="could not be reached again"):
        link.put_out()
    card.clear()
    monkeypatch.setattr(link, "_away_until_s", 0.0)  # the time is over
    link.put_out()


def test_lines_rest_though_the_tick_fails(card: ServedLabjack, link: Labjack) -> None:
    link.set_volts(0, 5.0)
    link.set_line(8, high=True)
    cycle(link)
    card.inject("no_tick")
    link.set_volts(0, 0.0)
    link.set_line(8, high=False)
    with pytest.raises(DeviceError, match="error 2764, TDAC_NOT_FOUND"):
        link.put_out()
    assert card.state()["lines"] == FED
    with pytest.raises(DeviceError, match="TDAC4"):
        card.link().rescue()
    assert card.state()["lines"] == 0


def test_shorted_enable_line_is_not_taken_for_safe(
    card: ServedLabjack, link: Labjack, monkeypatch: pytest.MonkeyPatch
) -> None:
    cycle(link)
    link.confirm_outputs()
    found = card.part.registers.driven
    monkeypatch.setattr(type(card.part.registers), "driven", property(lambda _: found | 1 << 8))
    with pytest.raises(DeviceError, match=r"digital output 8 of .* stands high"):
        link.confirm_outputs()


@pytest.mark.parametrize(
    ("fault", "options", "words"),
    [
        ("silent", {}, "has not answered within 1[45][0-9] ms"),
        ("late", {"delay_s": 0.6}, "has not answered within"),
        ("cut", {}, "LabJack|127.0.0.1"),
        ("truncated", {}, "has not answered"),
        ("garbage", {}, "expected protocol 0"),
        ("wrong_transaction", {}, "was never asked"),
        ("wrong_function", {}, "answered with function 75"),
        ("exception", {"count": 1}, "refuses a packet of DIO_STATE, AIN0: error 0"),
        ("failed_input", {}, "AIN0 reads -9999 V"),
    ],
)
def test_failing_device_ends_the_cycle_in_time(
    card: ServedLabjack, link: Labjack, fault: str, options: dict[str, Any], words: str
) -> None:
    link.use_inputs(analog=(0,))
    cycle(link)
    card.inject(fault, **options)
    with witnessed() as lost_s:
        began_s = time.monotonic()
        with pytest.raises((DeviceError, LinkError, ProtocolError), match=words):
            link.begin(0)
        took_s = time.monotonic() - began_s
        stalled_s = lost_s()
    assert took_s < CYCLE_S + 0.1 + stalled_s


def test_late_answer_is_not_taken_for_the_next(card: ServedLabjack, link: Labjack) -> None:
    link.use_inputs(analog=(0,))
    card.block.volts_in[0] = 1.0
    card.inject("late", delay_s=0.3, count=1)
    with pytest.raises(LinkError):
        link.begin(0)
    card.block.volts_in[0] = 2.0
    seen = []
    for _ in range(60):  # beyond the late answer
        link.sample()
        seen.append(link.volts[0])
        card.on_loop(lambda: time.sleep(0.005))
    assert seen == pytest.approx([2.0] * len(seen), abs=1e-3)


def test_wrong_device_is_refused(card: ServedLabjack) -> None:
    with pytest.raises(ProtocolError, match="has the serial number 470012345"):
        card.link(serial=470000001).open()
    card.inject("other_product")
    with pytest.raises(ProtocolError, match="is a T8; the rig file has a T7"):
        card.link().open()
    with pytest.raises(ProtocolError, match="is a T8"):
        card.link().rescue()
    card.inject("cut")
    with pytest.raises(LinkError, match="cannot connect"):
        card.link().open()


def test_input_that_is_not_there_is_refused(card: ServedLabjack, link: Labjack) -> None:
    with pytest.raises(LinkError, match="no analogue output 3; it has 0, 1, 2"):
        link.take_outputs(analog=(3,))
    with pytest.raises(LinkError, match="no digital input 18; it has 16, 17, 19"):
        link.use_inputs(lines=(18,))
    with pytest.raises(LinkError, match="no encoder 4; it has 0, 2, 6"):
        link.use_inputs(encoders=(4,))
    encoder_on_edges = card.link(edge_counters=[7])
    with pytest.raises(LinkError, match="encoder 6 needs lines 6 and 7"):
        encoder_on_edges.use_inputs(encoders=(6,))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"host": ""}, "host"),
        ({"analog_outputs": ["DAC2"]}, "'DAC2' is no output"),
        ({"analog_outputs": ["TDAC22"]}, "'TDAC22' is no output"),
        ({"analog_outputs": ["DAC0", "DAC0"]}, "names an output twice"),
        ({"analog_outputs": ["TDAC8"]}, "line 8 is in `outputs` and in `analog_outputs`"),
        ({"inputs": [8, 19]}, "line 8 is in `outputs` and in `inputs`"),
        ({"edge_counters": [4]}, "line 4 of a T7 cannot be that; lines 0, 1, 2, 3, 6, 7 can"),
        ({"product": "T4", "analog_outputs": ["TDAC2"]}, "line 2 of a T4 cannot be that"),
        ({"product": "T4", "edge_counters": [], "resolution": 6}, "is at most 5"),
        ({"product": "T4", "edge_counters": [], "differential": [0]}, "cannot be differential"),
        ({"differential": [3]}, "those of even number of a T7 can"),
        ({"high_at_rest": [11]}, "`high_at_rest` has line 11"),
        ({"high_at_rest": [15]}, "stands low at rest"),
        ({"index_counters": {0: 3}}, "name it in `edge_counters`"),
        ({"one_shot": {"output": 8, "input": 16, "time": "0.1 s"}}, "not both"),
        ({"watchdog": {"output": 11, "input": 19}}, "line 11, which is not in `outputs`"),
        ({"watchdog": {"output": 15, "input": 18}}, "line 18, which is not in `inputs`"),
        ({"watchdog": {"output": 15, "input": 19, "timeout": "0.5 s"}}, "timeout"),
        ({"watchdog": {"output": 15, "input": 19, "timeout": "1.5 s"}}, "not a whole number"),
        ({"watchdog": {"output": 15, "input": 19, "timeout": "2 s", "time": "1 s"}},
         "between 2 s, the `timeout` of the device, and 6 s"),
    ],
)  # fmt: skip
def test_wiring_that_cannot_be_is_refused(
    card: ServedLabjack, options: dict[str, Any], words: str
) -> None:
    with pytest.raises(ValueError, match=words):
        card.config(**options)


def test_t4_drives_and_counts_on_its_own_lines(card: ServedLabjack) -> None:
    card.part.registers.become_a_t4()
    link = card.link(product="T4", analog_outputs=["TDAC6"], edge_counters=[8], outputs=[10, 15])
    link.open()
    link.use_inputs(analog=(3,), encoders=(4, 8))
    card.block.volts_in[3] = -2.0
    link.set_line(10, high=True)
    cycle(link)
    link.sample()
    assert link.volts[3] == pytest.approx(-2.0, abs=5e-4)
    assert card.state()["lines"] == 1 << 10 | FED
    with pytest.raises(LinkError, match="no encoder 0; it has 4, 6, 8"):
        link.use_inputs(encoders=(0,))
    with pytest.raises(LinkError, match="no analogue input 4; it has 0, 1, 2, 3"):
        link.use_inputs(analog=(4,))
    link.close()


def test_third_connection_is_refused_with_its_reason(card: ServedLabjack, link: Labjack) -> None:
    second = Connection("127.0.0.1", card.port)
    second.open(1.0)
    second.ask(packet(SERIAL_NUMBER), time.monotonic() + 10)
    with pytest.raises(LinkError, match=r"reset|lost|closed") as caught:
        card.link().open()
    assert "two connections" in str(caught.value.hint)
    second.close()
