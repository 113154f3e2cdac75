"""The NI driver with the unmodified nidaqmx package, against the simulated device server."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError
from support.cards.served import OnLoop, served

from rigd.sdk import Block, DeviceError, LinkError, ProtocolError
from rigd.sdk.check import Peer, background_loop, check_driver
from rigd_drivers.cards.ni_daq import NiDaq
from rigd_drivers.cards.ni_daq.config import Input, NiDaqConfig
from rigd_sim.wire.cards.ni import SimNi

LSB_V = 20.0 / 2**14
VOLTS: dict[str, Callable[[], float]] = {
    "ai0": lambda: 1.5,
    "ai1": lambda: -2.0,
    "ai2": lambda: 12.0,
    "ai3": lambda: 0.0,
}
INPUTS = [
    {"name": "acceleration", "channel": "ai0", "unit": "m/s^2", "scale": "9.8 m/s^2/V",
     "zero": "0.5 V"},
    {"name": "force", "channel": "ai1", "unit": "N", "scale": "-100 N/V", "terminal": "rse"},
    {"name": "too_high", "channel": "ai2"},
    {"name": "shorted", "channel": "ai3", "range": "1 V"},
]  # fmt: skip


def config(**options: Any) -> NiDaqConfig:
    return NiDaqConfig.model_validate({"inputs": INPUTS, "rate": "9600 Hz", **options})


@pytest.fixture
def card() -> Iterator[tuple[SimNi, OnLoop]]:
    part = SimNi("daq", VOLTS, noise_v=0.0)
    with served(part) as on_loop:
        yield part, on_loop


@pytest.fixture
def opened(card: tuple[SimNi, OnLoop]) -> Iterator[Callable[..., NiDaq]]:
    drivers: list[NiDaq] = []

    def make(**options: Any) -> NiDaq:
        driver = NiDaq(config(server=f"127.0.0.1:{card[0].port}", **options))
        drivers.append(driver)
        driver.open()
        return driver

    yield make
    for driver in drivers:
        driver.close()


Opened = Callable[..., NiDaq]


def rows(driver: NiDaq, count: int) -> Block:
    """Return at least ``count`` rows, read as the helper process does."""
    deadline = time.monotonic() + 60
    blocks: list[Block] = []
    while sum(len(item.times_ns) for item in blocks) < count:
        assert time.monotonic() < deadline
        block = driver.read_block(0.1)
        if block is not None:
            blocks.append(block)
    return Block(
        np.concatenate([item.times_ns for item in blocks]),
        np.concatenate([item.values for item in blocks]),
    )


def test_channels_have_names_units_and_raw_partners() -> None:
    driver = NiDaq(config())
    channels = driver.declaration.channels
    assert [(channel.name, channel.unit, channel.raw_of) for channel in channels] == [
        ("acceleration", "m/s^2", None),
        ("acceleration_raw", "V", "acceleration"),
        ("force", "N", None),
        ("force_raw", "V", "force"),
        ("too_high", "V", None),
        ("too_high_raw", "V", "too_high"),
        ("shorted", "V", None),
        ("shorted_raw", "V", "shorted"),
        ("device_time", "s", None),
        ("clock_rate", "Hz", None),
    ]
    assert (channels[0].low, channels[0].high) == pytest.approx((-102.9, 93.1))
    assert (channels[2].low, channels[2].high) == (-1000.0, 1000.0)


def test_opened_card_gives_identity_values_and_status(opened: Opened) -> None:
    driver = opened()
    assert driver.identity == "USB-6009, serial number 01C0FFEE, NI-DAQmx 24.5.0"
    assert driver.rate_hz == 9600.0
    driver.start()
    block = rows(driver, 500)
    row = block.values[-1]
    assert row[1] == pytest.approx(1.5, abs=LSB_V)
    assert row[0] == pytest.approx((row[1] - 0.5) * 9.8, rel=1e-12)
    assert row[2] == pytest.approx(200.0, abs=100 * LSB_V)
    assert row[4] == row[5] == 8191 * LSB_V  # the last code of 14 bits: 9.9988 V
    assert row[6] == 0.0
    assert np.all(block.values[:, -1] == 0b0100)
    assert np.array_equal(block.values[:, -3], np.arange(len(block.times_ns)) / 9600)
    assert np.all(np.diff(block.times_ns) > 0)
    assert block.times_ns[-1] <= time.monotonic_ns()


def test_cycle_sees_last_row_or_median() -> None:
    """A single noisy sample must stop nothing; what is not an input is of the last row."""
    width = 2 * len(INPUTS) + 3
    values = np.arange(8.0)[:, np.newaxis] + np.zeros(width)
    values[6, :] = 1e6  # a spike
    block = Block(np.arange(8), values)
    assert NiDaq(config()).newest_row(block) == [7.0] * width
    seen = NiDaq(config(median=5)).newest_row(block)
    assert seen == [5.0] * (width - 3) + [7.0] * 3  # of 3, 4, 5, 1e6, 7
    assert NiDaq(config(median=5)).newest_row(Block(block.times_ns[:1], values[:1]))[0] == 0.0
    with pytest.raises(ValidationError, match="median of 97 samples"):
        config(median=97)


def test_crystals_drift_is_seen_against_machines_clock(
    card: tuple[SimNi, OnLoop], opened: Opened
) -> None:
    """Figures belong to the clock's own test; here that card and driver mean the same."""
    part, on_loop = card
    on_loop(lambda: part.inject("drift", ppm=20_000))
    driver = opened()
    driver.start()
    block = rows(driver, 30_000)
    passed_s = (block.times_ns[-1] - block.times_ns[9600]) * 1e-9
    card_s = block.values[-1, -3] - block.values[9600, -3]
    # A fast card's samples would be later than their arrival, were they not moved at once.
    assert 1.01 < card_s / passed_s < 1.03


def test_closing_twice_is_silent_and_another_may_open(opened: Opened) -> None:
    for _ in range(2):
        driver = opened()
        driver.start()
        rows(driver, 96)
        driver.close()
        driver.close()


def test_task_left_by_killed_client_is_cleared(card: tuple[SimNi, OnLoop], opened: Opened) -> None:
    part, on_loop = card
    killed = opened()
    killed.start()
    assert on_loop(part.state)["running"]
    driver = opened()  # the first one was never closed
    driver.start()
    rows(driver, 96)
    assert on_loop(part.state)["tasks"] == 1


def test_task_in_use_by_client_is_kept(opened: Opened) -> None:
    first = opened()
    first.start()
    ended = threading.Event()

    def read() -> int:
        blocks = 0
        while not ended.is_set():
            blocks += first.read_block(1.0) is not None
        return blocks

    with ThreadPoolExecutor() as pool:
        reading = pool.submit(read)
        try:
            with pytest.raises(LinkError, match=r"another rigd .*reads"):
                opened()
        finally:
            ended.set()
        assert reading.result(10.0) > 0
    rows(first, 96)


def test_there_is_nothing_to_read_before_start(opened: Opened) -> None:
    with pytest.raises(RuntimeError, match="start"):
        opened().read_block(0.1)


def test_short_blocks_lose_nothing(card: tuple[SimNi, OnLoop], opened: Opened) -> None:
    """A partial read is packed tightly; taken for whole rows it would mix the inputs."""
    part, on_loop = card
    on_loop(lambda: part.inject("short_block"))
    driver = opened()
    driver.start()
    block = driver.read_block(1.0)
    assert block is not None
    assert len(block.times_ns) == 48
    block = rows(driver, 1000)
    assert np.all(np.abs(block.values[:, 1] - 1.5) <= LSB_V)
    assert np.all(np.abs(block.values[:, 3] + 2.0) <= LSB_V)
    index = np.rint(block.values[:, -3] * 9600).astype(int)
    assert np.array_equal(index, 48 + np.arange(len(index)))


def test_read_without_timely_block_returns_none(opened: Opened) -> None:
    driver = opened(rate="0.5 Hz", block=1)
    driver.start()
    assert driver.read_block(0.05) is None


def test_overrun_error_names_option_to_change(card: tuple[SimNi, OnLoop], opened: Opened) -> None:
    part, on_loop = card
    driver = opened()
    driver.start()
    rows(driver, 96)
    on_loop(lambda: part.inject("overrun"))
    with pytest.raises(DeviceError, match=r"overran: samples were lost .*-200279") as caught:
        rows(driver, 96)
    assert "`buffer`" in str(caught.value.hint)


def test_samples_not_fetched_in_time_overrun(opened: Opened) -> None:
    driver = opened(buffer="1 s", block=10)
    driver.start()
    rows(driver, 10)
    time.sleep(1.5)  # what a reader that hangs looks like to the card
    with pytest.raises(DeviceError, match=r"within 1 s"):
        rows(driver, 10)


def test_removed_card_raises_device_error(card: tuple[SimNi, OnLoop], opened: Opened) -> None:
    part, on_loop = card
    driver = opened()
    driver.start()
    rows(driver, 96)
    on_loop(lambda: part.inject("removal"))
    with pytest.raises(DeviceError, match=r"NI card Dev1 on .* is gone .*-201003"):
        rows(driver, 1000)


def test_ended_device_server_raises_link_error() -> None:
    part = SimNi("daq", VOLTS)
    with served(part):
        driver = NiDaq(config(server=f"127.0.0.1:{part.port}"))
        driver.open()
        driver.start()
        rows(driver, 96)
    with pytest.raises(LinkError, match=r"NI card .*StatusCode\.UNAVAILABLE"):
        rows(driver, 100_000)
    driver.close()  # silent: the loss has been reported
    driver.close()


def test_server_that_hangs_does_not_hold_driver(
    card: tuple[SimNi, OnLoop], opened: Opened, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rigd_drivers.cards.ni_card.CALL_S", 1.0)
    part, on_loop = card
    driver = opened()
    driver.start()
    rows(driver, 96)
    on_loop(lambda: part.inject("stall", seconds=3600))
    with pytest.raises(LinkError, match="DEADLINE_EXCEEDED"):
        rows(driver, 96)


@pytest.mark.parametrize(
    ("options", "words", "hint"),
    [
        ({"device": "Dev2"}, "there is no NI card Dev2 .*: NI-DAQmx has Dev1", "`device`"),
        ({"product": "USB-6001"}, "is a USB-6009, expected a USB-6001", "`product`"),
        ({"serial": "BEEF"}, "serial number 01C0FFEE, expected BEEF", "`serial`"),
        ({"rate": "20 kHz"}, "cannot open NI card .*-200081", "lower `rate`"),
        ({"inputs": [{"name": "x", "channel": "ai9"}]}, "-200170", "`channel`"),
        ({"inputs": [{"name": "x", "channel": "ai0", "range": "30 V"}]}, "-200077", "`range`"),
        (
            {"inputs": [{"name": "x", "channel": "ai0", "range": "20 V", "terminal": "rse"}]},
            "-200077",
            "`terminal`",
        ),
    ],
)
def test_wrong_card_or_unsupported_options_are_refused(
    opened: Opened, options: dict[str, Any], words: str, hint: str
) -> None:
    kinds = (LinkError, ProtocolError, DeviceError)
    with pytest.raises(kinds, match=words) as caught:
        opened(**options)
    assert hint in str(caught.value.hint)


def test_without_nidaqmx_on_this_machine() -> None:
    with pytest.raises(LinkError, match="NI-DAQmx is not installed") as caught:
        NiDaq(config()).open()
    assert "server: HOST:PORT" in str(caught.value.hint)


def test_without_the_python_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "nidaqmx", None)
    with pytest.raises(LinkError, match=r"rigd\[ni\]"):
        NiDaq(config()).open()


def test_missing_device_server_raises_link_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rigd_drivers.cards.ni_card.CONNECT_S", 0.3)
    driver = NiDaq(config(server="127.0.0.1:9"))
    with pytest.raises(LinkError, match=r"gRPC .* 127\.0\.0\.1:9"):
        driver.open()
    driver.close()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"scale": "9.8 m/s"}, r"scale '9\.8 m/s' of input x is in m/s, expected m/s\^2/V"),
        ({"scale": "0 m/s^2/V"}, "is 0"),
        ({"scale": "5 V s^2/m"}, r"it is upside down: write '0\.2 m/s\^2/V'"),
        ({"scale": "9.8"}, r"write '9\.8 m/s\^2/V'"),
        ({"unit": "C"}, "did you mean 'degC'"),
        ({"low": "5 m/s^2", "high": "4 m/s^2"}, "can measure nothing: 5 m/s"),
        ({"low": "5 N"}, "'5 N' is in N"),
        ({"range": "10"}, "has no unit"),
        ({"name": "Acceleration"}, "string"),
    ],
)
def test_inputs_that_mean_nothing_are_refused(change: dict[str, str], words: str) -> None:
    given = {"name": "x", "channel": "ai0", "unit": "m/s^2", "scale": "1 m/s^2/V", **change}
    with pytest.raises(ValidationError, match=words):
        Input.model_validate(given)


def test_celsius_is_counted_from_its_own_zero(opened: Opened) -> None:
    given = {
        "name": "t", "channel": "ai0", "unit": "degC", "scale": "200 K/V", "high": "350 degC"
    }  # fmt: skip
    driver = opened(inputs=[given])
    channel = driver.declaration.channels[0]
    assert (channel.unit, channel.shown_in) == ("K", "degC")
    assert (channel.low, channel.high) == (0.0, 623.15)  # -10 V would be 2000 K below 0 degC
    driver.start()
    row = rows(driver, 100).values[-1]
    assert row[0] == pytest.approx(273.15 + 200 * row[1], rel=1e-12)
    assert row[1] == pytest.approx(1.5, abs=LSB_V)


@pytest.mark.parametrize(
    ("names", "channels", "words"),
    [
        (("a", "a"), ("ai0", "ai1"), "two inputs have the name 'a'"),
        (("a", "b"), ("ai0", "ai0"), "two inputs have the channel 'ai0'"),
        (("a", "a_raw"), ("ai0", "ai1"), "'a_raw'"),
        (("a", "device_time"), ("ai0", "ai1"), "'device_time'"),
    ],
)
def test_inputs_that_clash_are_refused(
    names: tuple[str, ...], channels: tuple[str, ...], words: str
) -> None:
    pairs = zip(names, channels, strict=True)
    with pytest.raises(ValidationError, match=words):
        config(inputs=[{"name": name, "channel": channel} for name, channel in pairs])


def test_the_buffer_holds_whole_blocks() -> None:
    assert config(buffer="5 s", block=96).buffer_samples == 48_000
    assert config(buffer="1 s", block=700).buffer_samples == 14 * 700
    assert config(buffer="0.1 s", rate="10 Hz", block=96).buffer_samples == 192


@contextmanager
def simulated() -> Iterator[Peer]:
    """Start a card for the conformance suite."""
    part = SimNi("daq", VOLTS)
    with background_loop() as run:

        async def inject(fault: str, **options: float) -> None:
            part.inject(fault, **options)

        run(part.start())
        try:
            yield Peer(
                options={"server": f"127.0.0.1:{part.port}"},
                faults={
                    "dead": lambda: run(part.stop()),
                    "silent": lambda: run(inject("stall", seconds=3600)),
                    "lossy": lambda: run(inject("overrun")),
                },
            )
        finally:
            run(part.stop())


def test_it_keeps_what_a_block_driver_promises(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rigd_drivers.cards.ni_card.CONNECT_S", 1.0)
    monkeypatch.setattr("rigd_drivers.cards.ni_card.CALL_S", 1.0)
    report = check_driver(NiDaq, {"inputs": INPUTS}, peer=simulated)
    # Packets are the library's matter.
    assert report.skipped.keys() == {
        "garbled", "garbled at open", "frozen", "another at open",
    }  # fmt: skip
