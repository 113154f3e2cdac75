"""The simulated NI card: what the unmodified nidaqmx package finds, and the card by itself."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Iterator
from typing import Any

import grpc
import nidaqmx
import numpy as np
import pytest
from nidaqmx.constants import AcquisitionType, TerminalConfiguration
from nidaqmx.errors import DaqError, DaqReadError, RpcError
from nidaqmx.stream_readers import AnalogMultiChannelReader, DigitalSingleChannelReader
from nidaqmx.stream_writers import DigitalSingleChannelWriter
from nidaqmx.system import Device, System
from support.cards.served import served

from rigd_sim.wire.cards.ni import SimNi
from rigd_sim.wire.cards.ni_card import (
    DEFAULT,
    DIFFERENTIAL,
    SINGLE_ENDED,
    Acquisition,
    DaqFault,
    Faults,
    Following,
    Span,
    rate_for,
    span_for,
)
from rigd_sim.wire.cards.ni_lines import Lines

LSB_V = 20.0 / 2**14


class Client:
    """The package's own client of a served card."""

    def __init__(self, part: SimNi, on_loop: Callable[[Callable[[], Any]], Any]) -> None:
        self.part = part
        self.on_loop = on_loop
        self.channel = grpc.insecure_channel(f"127.0.0.1:{part.port}")

    def options(self, session: str = "") -> nidaqmx.GrpcSessionOptions:
        return nidaqmx.GrpcSessionOptions(self.channel, session)

    def task(self, *channels: str, rate: float = 1000.0, buffer: int = 1000) -> nidaqmx.Task:
        task = nidaqmx.Task("test", grpc_options=self.options("test"))
        for channel in channels:
            task.ai_channels.add_ai_voltage_chan(f"Dev1/{channel}", min_val=-10, max_val=10)
        task.timing.cfg_samp_clk_timing(
            rate, sample_mode=AcquisitionType.CONTINUOUS, samps_per_chan=buffer
        )
        return task

    def lines(self, name: str, *, inputs: str = "", outputs: str = "") -> nidaqmx.Task:
        task = nidaqmx.Task(name, grpc_options=self.options(name))
        if inputs:
            task.di_channels.add_di_chan(inputs)
        if outputs:
            task.do_channels.add_do_chan(outputs)
        return task

    def inject(self, fault: str, **options: Any) -> None:
        self.on_loop(lambda: self.part.inject(fault, **options))

    def clear(self, fault: str | None = None) -> None:
        self.on_loop(lambda: self.part.clear(fault))


@pytest.fixture
def client() -> Iterator[Client]:
    part = SimNi("daq", {"ai0": lambda: 1.0, "ai1": lambda: -3.0}, noise_v=0.0)
    with served(part) as on_loop:
        found = Client(part, on_loop)
        yield found
        found.channel.close()


def read(task: nidaqmx.Task, count: int, timeout: float = 30.0) -> np.ndarray[Any, Any]:
    data = np.zeros((task.number_of_channels, count))
    AnalogMultiChannelReader(task.in_stream).read_many_sample(data, count, timeout)
    return data


def read_lines(task: nidaqmx.Task, levels: np.ndarray[Any, Any]) -> None:
    reader = DigitalSingleChannelReader(task.in_stream)
    reader.verify_array_shape = False
    reader.read_one_sample_multi_line(levels)


def write_lines(task: nidaqmx.Task, *levels: bool) -> None:
    writer = DigitalSingleChannelWriter(task.out_stream)
    writer.verify_array_shape = False
    writer.write_one_sample_multi_line(np.array(levels))


def test_client_reads_driver_version_and_device(client: Client) -> None:
    system = System.remote(client.options())
    assert system.devices.device_names == ["Dev1"]
    assert tuple(system.driver_version) == (24, 5, 0)
    device = Device("Dev1", grpc_options=client.options())
    assert (device.product_type, device.serial_num) == ("USB-6009", 0x01C0FFEE)
    with pytest.raises(DaqError) as caught:
        _ = Device("Dev2", grpc_options=client.options()).product_type
    assert caught.value.error_code == -200220


def test_unsimulated_function_raises_an_error(client: Client) -> None:
    device = Device("Dev1", grpc_options=client.options())
    with pytest.raises(DaqError, match="does not serve attribute 0x231D"):
        _ = device.product_num
    with pytest.raises(RpcError, match="UNIMPLEMENTED"):
        device.reset_device()


def test_continuous_task_reads_at_its_rate(client: Client) -> None:
    with client.task("ai0", "ai1", rate=9600.0, buffer=4800) as task:
        assert task.timing.samp_clk_rate == 9600.0
        assert [ai_channel.ai_rng_high for ai_channel in task.ai_channels] == [10.0, 10.0]
        task.start()
        for _ in range(20):
            data = read(task, 96)
            assert np.abs(data[0] - 1.0).max() <= LSB_V / 2
            assert np.abs(data[1] + 3.0).max() <= LSB_V / 2
            assert np.array_equal(data, np.rint(data / LSB_V) * LSB_V)
        assert client.on_loop(client.part.state)["running"]
    assert not client.on_loop(client.part.state)["running"]


def test_terminal_configuration_selects_the_input_range(client: Client) -> None:
    with client.task() as task:
        add = task.ai_channels.add_ai_voltage_chan
        add("Dev1/ai0", terminal_config=TerminalConfiguration.RSE, min_val=-1, max_val=1)
        add("Dev1/ai1", terminal_config=TerminalConfiguration.DIFF, min_val=-1.1, max_val=1.1)
        assert [ai_channel.ai_rng_high for ai_channel in task.ai_channels] == [10.0, 1.25]


def test_read_that_times_out_returns_available_samples(client: Client) -> None:
    with client.task("ai0", "ai1") as task:
        task.start()
        data = np.zeros((2, 1000))
        reader = AnalogMultiChannelReader(task.in_stream)
        with pytest.raises(DaqReadError) as caught:
            reader.read_many_sample(data, 1000, 0.1)
        count = caught.value.samps_per_chan_read
        assert caught.value.error_code == -200284
        assert 0 < count < 1000
        packed = data.ravel()
        assert np.abs(packed[:count] - 1.0).max() < LSB_V
        assert np.abs(packed[count : 2 * count] + 3.0).max() < LSB_V
        assert not packed[2 * count :].any()


def test_overrun_stays_until_the_task_restarts(client: Client) -> None:
    with client.task("ai0") as task:
        task.start()
        read(task, 10)
        client.inject("overrun")
        for _ in range(2):
            with pytest.raises(DaqError) as caught:
                read(task, 10)
            assert caught.value.error_code == -200279
        task.stop()
        task.start()
        read(task, 10)


def test_card_that_is_pulled_out_and_plugged_in(client: Client) -> None:
    with client.task("ai0") as task:
        task.start()
        client.inject("removal")
        with pytest.raises(DaqError) as caught:
            read(task, 10)
        assert caught.value.error_code == -201003
        assert System.remote(client.options()).devices.device_names == []
        client.clear("removal")
        read(task, 10)


def test_a_second_task_finds_the_converter_reserved(client: Client) -> None:
    with client.task("ai0") as task:
        task.start()
        with nidaqmx.Task("other", grpc_options=client.options("other")) as other:
            other.ai_channels.add_ai_voltage_chan("Dev1/ai1")
            other.timing.cfg_samp_clk_timing(
                100.0, sample_mode=AcquisitionType.CONTINUOUS, samps_per_chan=100
            )
            with pytest.raises(DaqError) as caught:
                other.start()
            assert caught.value.error_code == -50103


def test_input_shows_each_fault(client: Client) -> None:
    with client.task("ai0", "ai1", rate=1000.0, buffer=60_000) as task:
        task.start()
        read(task, 10)

        def fresh() -> np.ndarray[Any, Any]:
            waiting = task.in_stream.avail_samp_per_chan
            read(task, waiting + 10)  # what was converted before, however long ago
            return read(task, 100)

        client.inject("saturation", channel="ai0")
        assert np.all(fresh()[0] == 8191 * LSB_V)
        client.inject("saturation", channel="ai0", side="low")
        assert np.all(fresh()[0] == -10.0)
        client.clear("saturation")
        client.inject("open_input", channel="ai1")
        data = fresh()
        assert np.abs(data[0] - 1.0).max() < LSB_V
        assert 0.3 < data[1].max() < 0.5
        assert -0.5 < data[1].min() < -0.3
        client.clear()
        assert np.abs(fresh()[1] + 3.0).max() < LSB_V


def test_lines_are_high_until_driven_then_keep_level() -> None:
    told: list[bool] = []
    part = SimNi(
        "daq", {}, lines=Lines({"port0/line2": lambda: False}, {"port0/line0": told.append})
    )
    with served(part) as on_loop:
        client = Client(part, on_loop)
        with client.lines("in", inputs="Dev1/port0/line0:2, Dev1/port1/line3") as task:
            levels = np.zeros(4, dtype=bool)
            read_lines(task, levels)
            assert levels.tolist() == [True, True, False, True]  # one is held low from outside
        with client.lines("out", outputs="Dev1/port0/line0:1") as task:
            write_lines(task, False, True)
        assert told == [True, False]
        client.inject("removal")
        assert told == [True, False, True]
        client.channel.close()


def test_a_running_task_has_its_lines_alone(client: Client) -> None:
    with client.lines("mine", outputs="Dev1/port0/line0:1") as mine:
        mine.start()
        with client.lines("other", outputs="Dev1/port0/line1") as other:
            with pytest.raises(DaqError) as caught:
                write_lines(other, False)
            assert caught.value.error_code == -200587
            mine.stop()
            write_lines(other, False)


@pytest.mark.parametrize(
    "lines", ["Dev1/port0/line8", "Dev1/port2/line0", "Dev1/port0", "Dev1/ai0", "Dev2/port0/line0"]
)
def test_unknown_lines_are_refused(client: Client, lines: str) -> None:
    with client.lines("out") as task, pytest.raises(DaqError, match=r"does not exist|is invalid"):
        task.do_channels.add_do_chan(lines)


def test_faults_it_does_not_know_are_refused() -> None:
    part = SimNi("daq", {})
    for fault, options in (
        ("fire", {}),
        ("saturation", {}),
        ("saturation", {"channel": "ai0", "colour": "red"}),
        ("saturation", {"channel": "ai0", "side": "left"}),
        ("stuck_code", {"channel": "ai8"}),
        ("overrun", {"channel": "ai0"}),
    ):
        with pytest.raises(ValueError, match=r"saturation|it has ai0"):
            part.inject(fault, **options)
    with pytest.raises(ValueError, match="no fault 'fire'"):
        part.clear("fire")
    with pytest.raises(ValueError, match="no input 'ai8'"):
        SimNi("daq", {"ai8": lambda: 0.0})


def test_occupied_port_raises_an_error() -> None:
    part = SimNi("daq", {})
    with served(part):
        other = SimNi("other", {}, address=f"127.0.0.1:{part.port}")
        with pytest.raises(OSError, match="other: cannot serve at 127"):
            asyncio.run(other.start())


# The card by itself, in time of our own.


START_NS = 5_000_000_000


def acquisition(
    volts: Callable[[], float] = lambda: 0.0, *, rate_hz: float = 1000.0, capacity: int = 10_000
) -> Acquisition:
    spans = {"ai0": Span(10.0, 2**14)}
    sampler = Following(spans, rate_hz, START_NS, volts={"ai0": volts}, noise_v=0.0, seed=1)
    return Acquisition(spans, rate_hz, capacity, sampler, {"ai0"})


def test_clock_drift_changes_number_of_samples() -> None:
    found = acquisition(rate_hz=9600.0, capacity=1_000_000)
    for step in range(1, 5001):
        found.advance(START_NS + step * 2_000_000, 100e-6, Faults())
    assert found.made == math.floor(9600 * 10 * 1.0001)


def test_between_two_steps_voltages_move_on_a_line() -> None:
    now = {"v": 0.0}
    found = acquisition(lambda: now["v"])
    found.advance(START_NS, 0.0, Faults())
    now["v"] = 1.0
    found.advance(START_NS + 10_000_000, 0.0, Faults())
    assert found.take(10)[0] == pytest.approx(np.arange(1, 11) / 10, abs=LSB_V / 2)


def test_a_stuck_code_stays_where_it_was() -> None:
    now, faults = {"v": 1.0}, Faults()
    found = acquisition(lambda: now["v"])
    found.advance(START_NS + 10_000_000, 0.0, faults)
    held = found.take(10)[0, -1]
    faults.stuck_code.add("ai0")
    now["v"] = 2.0
    found.advance(START_NS + 20_000_000, 0.0, faults)
    assert np.all(found.take(10) == held)


def test_the_buffer_overflows_by_one_sample() -> None:
    found = acquisition(capacity=10)
    found.advance(START_NS + 10_000_000, 0.0, Faults())
    assert (found.available, found.overrun) == (10, False)
    found.advance(START_NS + 11_000_000, 0.0, Faults())
    with pytest.raises(DaqFault) as caught:
        found.take(1)
    assert caught.value.code == -200279


def test_noise_repeats_for_a_seed() -> None:
    def samples(seed: int) -> np.ndarray[Any, Any]:
        spans = {"ai0": Span(1.0, 2**14)}
        sampler = Following(spans, 1e4, 0, volts={}, noise_v=0.01, seed=seed)
        return np.asarray(sampler.due(100_000_000, 0.0)[0])

    assert np.array_equal(samples(1), samples(1))
    assert not np.array_equal(samples(1), samples(2))
    assert samples(1).std() == pytest.approx(0.01, rel=0.1)


def test_rates_and_ranges_are_those_of_the_6009() -> None:
    assert rate_for(9600.0, 4) == 9600.0
    assert rate_for(7000.0, 1) == 24e6 / 3429
    with pytest.raises(DaqFault):
        rate_for(12_001.0, 4)
    assert span_for("ai0", DIFFERENTIAL, 10.0) == Span(10.0, 2**14)
    assert span_for("ai3", DEFAULT, 1.1) == Span(1.25, 2**14)
    assert span_for("ai4", DEFAULT, 1.1) == Span(10.0, 2**13)
    assert span_for("ai0", SINGLE_ENDED, 0.2) == Span(10.0, 2**13)
    for channel, terminal, asked_v in (
        ("ai0", DIFFERENTIAL, 20.1),
        ("ai0", SINGLE_ENDED, 10.1),
        ("ai4", DIFFERENTIAL, 1.0),  # the other half of a pair
        ("ai0", 10078, 1.0),  # NRSE
    ):
        with pytest.raises(DaqFault) as caught:
            span_for(channel, terminal, asked_v)
        assert caught.value.code == -200077
