"""The transmitter driver against a simulated one, over a real socket and a real pty."""

from __future__ import annotations

import random
import time
from typing import Any

import pytest
from pydantic import ValidationError
from support.faults.stalls import witnessed
from support.instruments.modbus_bench import Physics, TransmitterBench, cycle, rows_of, status

from rigd.sdk import DeviceError, LinkError, ProtocolError
from rigd_drivers.modbus.framing import Trouble
from rigd_drivers.modbus.transmitter import TransmitterConfig
from rigd_sim.wire.modbus.line import SerialLine

TCP = pytest.mark.parametrize("line", ["tcp"], indirect=True)
RTU = pytest.mark.parametrize("line", ["rtu"], indirect=True)


class Overheard:
    """The port of a driver, and the silence it left before each request, in s."""

    def __init__(self, port: Any) -> None:
        self._port = port
        self._heard_s: float | None = None
        self.silences_s: list[float] = []

    def send(self, frame: bytes) -> None:
        if self._heard_s is not None:
            self.silences_s.append(time.monotonic() - self._heard_s)
        self._port.send(frame)

    def receive(self) -> bytes:
        data: bytes = self._port.receive()
        if data:
            self._heard_s = time.monotonic()
        return data

    def __getattr__(self, name: str) -> Any:
        return getattr(self._port, name)


def opened(bench: TransmitterBench, **options: Any) -> Any:
    driver = bench.driver(**options)
    driver.open()
    rows_of(driver, 1)
    return driver


def test_rows_carry_force_counts_and_the_stable_flag(transmitter: TransmitterBench) -> None:
    driver = opened(transmitter)
    assert rows_of(driver, 1)[-1] == (12.5, 1250.0, 1)
    assert "serial 1234" in driver.identity


def test_the_sign_is_taken_from_the_status_register(transmitter: TransmitterBench) -> None:
    transmitter.physics.force = -7.25
    force, count, _ = rows_of(opened(transmitter), 1)[-1]
    assert (force, count) == (-7.25, -725.0)


def test_rows_come_at_requested_rate_and_no_faster(transmitter: TransmitterBench) -> None:
    driver = opened(transmitter, rate="20 Hz")
    began = time.monotonic()
    rows_of(driver, 11)
    assert time.monotonic() - began > 0.45  # ten periods of 50 ms, less one begun before


@pytest.mark.parametrize(
    ("fault", "trouble"),
    [
        ("silent", Trouble.TIMEOUT),
        ("deaf", Trouble.TIMEOUT),
        ("late", Trouble.LATE),
        ("wrong_unit", Trouble.WRONG_UNIT),
        ("wrong_function", Trouble.WRONG_REPLY),
        ("byte_gap", Trouble.GARBLED),
        ("busy", Trouble.REFUSED),
    ],
)
def test_fault_of_line_costs_row_and_is_counted(
    transmitter: TransmitterBench, fault: str, trouble: Trouble
) -> None:
    driver = opened(transmitter)
    transmitter.fault(fault, count=1)
    rows = cycle(driver, lambda rows: bool(rows and status(rows[-1]) >> 8 & 1 << trouble))
    assert {tuple(row[:2]) for row in rows} == {(12.5, 1250.0)}
    assert driver.client.counts[trouble] >= 1
    assert status(rows[-1]) >> 16 & 0xFF == sum(driver.client.counts)
    assert status(rows_of(driver, 1)[-1]) >> 8 & 0xFF == 0  # news are reported once


@RTU
@pytest.mark.parametrize(
    ("fault", "trouble"),
    [("crc", Trouble.CRC), ("truncated", Trouble.GARBLED), ("garbage", Trouble.GARBLED)],
)
def test_a_damaged_frame_is_no_data(
    transmitter: TransmitterBench, fault: str, trouble: Trouble
) -> None:
    driver = opened(transmitter)
    transmitter.fault(fault, count=1)
    rows = cycle(driver, lambda rows: driver.client.counts[trouble] > 0 and len(rows) > 1)
    assert {tuple(row[:2]) for row in rows} == {(12.5, 1250.0)}


@TCP
def test_an_unknown_transaction_is_no_data(transmitter: TransmitterBench) -> None:
    driver = opened(transmitter)
    transmitter.fault("wrong_transaction", count=1)
    cycle(driver, lambda rows: len(rows) > 1)
    assert driver.client.counts[Trouble.WRONG_TRANSACTION] == 1


@TCP
@pytest.mark.parametrize("fault", ["truncated", "garbage"])
def test_stream_out_of_step_raises_protocol_error(
    transmitter: TransmitterBench, fault: str
) -> None:
    driver = opened(transmitter)
    transmitter.fault(fault, count=1)
    with pytest.raises(ProtocolError, match="expected protocol 0"):
        rows_of(driver, 100)


def test_late_reply_never_becomes_a_value(transmitter: TransmitterBench) -> None:
    """The force changes after each late reply was made: none of the old values may come up."""
    driver = opened(transmitter)
    for step in range(3):
        transmitter.fault("late", count=1)
        asked = transmitter.state()["asked"]
        cycle(driver, lambda rows, asked=asked: transmitter.state()["asked"] > asked)  # type: ignore[misc]
        transmitter.physics.force = 20.0 + step
        rows = rows_of(driver, 3)
        rows += cycle(driver, lambda rows, n=step + 1: driver.client.counts[Trouble.LATE] == n)  # type: ignore[misc]
        assert {row[0] for row in rows} == {20.0 + step}


@RTU
def test_no_request_follows_failure_before_longest_reply(transmitter: TransmitterBench) -> None:
    driver = opened(transmitter, longest_reply="0.4 s")
    began = time.monotonic()  # the request comes later: a stall does not shorten what is measured
    transmitter.fault("silent", count=1)
    before = driver.client.counts[Trouble.TIMEOUT]
    cycle(driver, lambda rows: driver.client.counts[Trouble.TIMEOUT] > before)
    rows_of(driver, 1)
    assert time.monotonic() - began >= 0.4


def test_refusal_ends_run_with_what_it_means(transmitter: TransmitterBench) -> None:
    driver = opened(transmitter)
    transmitter.fault("exception", code=2)
    with pytest.raises(DeviceError, match="exception 2, illegal data address"):
        rows_of(driver, 10)


def test_lost_connection_raises_link_error(transmitter: TransmitterBench) -> None:
    driver = opened(transmitter)
    transmitter.fault("cut")
    with pytest.raises(LinkError, match=r"lost|closed"):
        rows_of(driver, 100)


def test_a_broken_cell_ends_the_run(transmitter: TransmitterBench) -> None:
    driver = opened(transmitter)
    transmitter.fault("broken")
    with pytest.raises(DeviceError, match="reports a fault"):
        rows_of(driver, 10)


def test_overload_is_flag_and_value_goes_on(transmitter: TransmitterBench) -> None:
    driver = opened(transmitter)
    transmitter.physics.force = 620.0
    rows = cycle(driver, lambda rows: bool(rows and rows[-1][0] == 620.0))
    assert status(rows[-1]) & 2


@pytest.mark.parametrize(
    ("instrument", "options"),
    [
        ("laumas-tlb4", {}),
        ("seneca-z-sg2", {"map": "seneca-z-sg2", "scale": "1 N/count"}),
        ("tuna-id551", {"map": "tuna-id551", "scale": "1 N/count"}),
    ],
)
def test_swapped_words_at_opening_are_found_with_remedy(
    transmitter: TransmitterBench, options: dict[str, Any]
) -> None:
    transmitter.fault("word_order")
    with pytest.raises(ProtocolError, match="try 'word_order: low-first'"):
        transmitter.driver(**options).open()
    driver = opened(transmitter, word_order="low-first", **options)
    assert rows_of(driver, 1)[-1][0] == 12.5


def test_swapped_words_are_found_when_leaving_zero(
    transmitter: TransmitterBench,
) -> None:
    transmitter.physics.force = 0.0  # both words are zero: no order to find
    transmitter.fault("word_order")
    driver = opened(transmitter)
    transmitter.physics.force = 3.0
    with pytest.raises(ProtocolError, match="try 'word_order: low-first'"):
        rows_of(driver, 100)


def test_swapped_words_are_found_despite_flicker_around_zero(
    transmitter: TransmitterBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    # At random: a stalled machine makes several conversions between two readings, at times a whole
    # period of anything regular.
    rng = random.Random(1)
    monkeypatch.setattr(Physics, "force", property(lambda _: rng.choice((0.0, 0.03))))
    transmitter.fault("word_order")
    with pytest.raises(ProtocolError, match="try 'word_order: low-first'"):
        transmitter.driver().open()


def test_single_overload_that_looks_swapped_is_only_withheld(
    transmitter: TransmitterBench,
) -> None:
    """655.36 N is 65536 counts, words 1 and 0; as 0 and 1 they would be 0.01 N."""
    driver = opened(transmitter)
    transmitter.physics.force = 655.36
    cycle(driver, lambda rows: driver._suspects > 0)
    transmitter.physics.force = 655.35
    rows = cycle(driver, lambda rows: bool(rows and rows[-1][0] > 500))
    assert [row[0] for row in rows if row[0] > 500] == [pytest.approx(655.35)]
    assert driver._suspects == 0


def test_force_that_cannot_be_is_refused_at_opening(transmitter: TransmitterBench) -> None:
    transmitter.physics.force = 510.0
    with pytest.raises(ProtocolError, match="reads 510 N, beyond -500 N to 500 N"):
        transmitter.driver().open()


@pytest.mark.parametrize("instrument", ["laumas-tlb4", "tuna-id551"])
def test_tare_is_done_between_rows(transmitter: TransmitterBench, instrument: str) -> None:
    driver = opened(transmitter, map=instrument, scale=_SCALES[instrument])
    driver.act("tare")
    with pytest.raises(DeviceError, match="still under way"):
        driver.act("zero")
    said: list[str | None] = []

    def done(rows: Any) -> bool:
        said.append(driver.acted())
        return said[-1] is not None

    cycle(driver, done)
    assert said[-1] == "tare: accepted"
    assert driver.acted() is None
    assert rows_of(driver, 2)[-1][0] == pytest.approx(0.0, abs=1e-9)
    with pytest.raises(ValueError, match="known: tare, zero, untare"):
        driver.act("dance")


_SCALES = {"laumas-tlb4": "0.01 N/count", "tuna-id551": "1 N/count"}


class CountingBank:
    """The registers of a transmitter, and how often they were written."""

    def __init__(self, bank: Any) -> None:
        self._bank = bank
        self.writes = 0

    def answer(self, pdu: bytes) -> bytes:
        self.writes += pdu[0] in (6, 16)
        answer: bytes = self._bank.answer(pdu)
        return answer


def test_action_that_is_being_processed_is_not_repeated(transmitter: TransmitterBench) -> None:
    driver = opened(transmitter)
    bank = transmitter.part.bank = CountingBank(transmitter.part.bank)
    transmitter.fault("exception", code=5)
    driver.act("tare")
    said: list[str | None] = []

    def done(rows: Any) -> bool:
        said.append(driver.acted())
        return said[-1] is not None

    cycle(driver, done)
    transmitter.clear()
    assert said[-1] == "tare: accepted"
    assert bank.writes == 1
    assert rows_of(driver, 2)[-1][0] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("repeats", [False, True])
def test_action_without_answer_is_repeated_if_harmless(
    transmitter: TransmitterBench, repeats: bool
) -> None:
    step: dict[str, Any] = {"doc": "?", "writes": [{"address": 5, "value": 7}]}
    custom = {
        "title": "TLB4",
        "source": "none",
        "write_function": 16,
        "force": {"address": 9, "type": "uint32"},
        "actions": {"step": step | ({"repeats": True} if repeats else {})},
    }
    driver = opened(transmitter, map=custom)

    class Losing(CountingBank):
        def answer(self, pdu: bytes) -> bytes:
            answer = super().answer(pdu)
            if pdu[0] == 16 and self.writes == 1:
                transmitter.part.inject("silent", count=1)
            return answer

    bank = transmitter.part.bank = Losing(transmitter.part.bank)
    driver.act("step")
    if repeats:
        cycle(driver, lambda rows: driver.acted() is not None)
    else:
        with pytest.raises(DeviceError, match=r"step: no answer to the .* it may be done or not"):
            cycle(driver, lambda rows: driver.acted() is not None)
    assert bank.writes == 1 + repeats


def test_refused_action_is_reported_and_measuring_continues(transmitter: TransmitterBench) -> None:
    custom = {
        "title": "TLB4 with a command it has not",
        "source": "none",
        "write_function": 16,
        "force": {"address": 9, "type": "uint32"},
        "actions": {"polish": {"doc": "?", "writes": [{"address": 5, "value": 77}]}},
    }
    driver = opened(transmitter, map=custom)
    driver.act("polish")
    with pytest.raises(DeviceError, match="polish: refused: illegal data value"):
        cycle(driver, lambda rows: driver.acted() is not None)
    assert rows_of(driver, 1)[-1][0] == 12.5


@RTU
def test_wrong_baud_rate_gives_no_answer_but_hint(
    transmitter: TransmitterBench,
) -> None:
    with pytest.raises(LinkError, match="no answer to the read") as caught:
        transmitter.driver(baud=9600).open()
    assert caught.value.hint is not None
    assert "baud rate" in caught.value.hint


def test_another_unit_is_no_answer(transmitter: TransmitterBench) -> None:
    with pytest.raises(LinkError, match="no answer"):
        transmitter.driver(unit=7).open()


@pytest.mark.parametrize(
    ("fault", "words"),
    [("wrong_unit", "from another unit"), ("wrong_function", "to something else")],
)
def test_opening_names_device_that_answers_instead(
    transmitter: TransmitterBench, fault: str, words: str
) -> None:
    transmitter.fault(fault)
    with pytest.raises(LinkError, match=f"an answer {words}"):
        transmitter.driver().open()


@RTU
def test_serial_port_refuses_second_opening(transmitter: TransmitterBench) -> None:
    opened(transmitter)
    with pytest.raises(LinkError, match="another program holds"):
        transmitter.driver().open()


@RTU
def test_port_without_parity_is_reported(transmitter: TransmitterBench) -> None:
    for _ in range(2):  # at the first opening as at every other
        with pytest.raises(LinkError, match="'parity: none'"):
            transmitter.driver(parity="even").open()


@RTU
def test_the_silence_between_frames_is_kept(transmitter: TransmitterBench) -> None:
    driver = opened(transmitter, rate="1 kHz")  # as fast as the line allows
    port = driver.client._transport = Overheard(driver.client._transport)
    assert isinstance(transmitter.line, SerialLine)
    before = transmitter.line.ignored
    with witnessed() as lost_s:
        rows_of(driver, 20)
        ignored, stalled_s = transmitter.line.ignored - before, lost_s()
    assert len(port.silences_s) > 15
    assert min(port.silences_s) >= transmitter.line.gap_s
    # If this machine stalled for longer than a reply may take, the device answered too late.
    assert ignored == 0 or stalled_s > driver.config.timeout


@pytest.mark.parametrize("instrument", ["seneca-z-sg2"])
def test_another_unit_of_measurement_is_refused(transmitter: TransmitterBench) -> None:
    part = transmitter.part
    transmitter.call(lambda: part.bank.constant(2, 0x0000))
    with pytest.raises(ProtocolError, match=r"unit .* 0x0000, expected 0x0500"):
        transmitter.driver(map="seneca-z-sg2", scale="1 N/count").open()


def test_slow_device_on_tcp_may_take_its_time() -> None:
    options = {"host": "h", "map": "laumas-tlb4", "scale": "1 N/count", "low": "0 N", "high": "9 N"}
    config = TransmitterConfig.model_validate(options | {"timeout": "0.5 s"})
    assert config.lost_reply_s() == 0.5


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"map": "laumas-tlb5"}, "did you mean 'laumas-tlb4'"),
        ({"map": "delta-asda-b"}, "no shipped modbus-transmitter map"),
        ({"scale": None}, "has no scale: give 'scale'"),
        ({"scale": "0 N/count"}, "'scale' must not be zero"),
        ({"map": "seneca-z-sg2", "scale": "0 N/count"}, "'scale' must not be zero"),
        ({"low": "1 kg"}, "expected N"),
        ({"low": "600 N"}, r"must be below 'high' \(9 N\)"),
        ({"host": None}, "either 'host'"),
        ({"baud": 9600}, "'baud' belongs to 'serial_port'"),
        ({"unit": 300}, "less than or equal to 255"),
        (
            {
                "map": {
                    "title": "t",
                    "source": "s",
                    "force": {"address": 9, "type": "uint32"},
                    "negative": {"address": 6},
                }
            },
            "raise 'bridge'",
        ),
    ],
)
def test_error_on_wrong_option_names_right_value(options: dict[str, Any], message: str) -> None:
    right = {"host": "h", "map": "laumas-tlb4", "scale": "1 N/count", "low": "0 N", "high": "9 N"}
    with pytest.raises(ValidationError, match=message):
        TransmitterConfig.model_validate(right | options)
