"""The simulated multifunction NI card, as the unmodified nidaqmx package and its wires see it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import grpc
import nidaqmx
import numpy as np
import pytest
from nidaqmx.constants import AcquisitionType, AngleUnits, Level, WatchdogAOExpirState
from nidaqmx.errors import DaqError
from nidaqmx.stream_readers import AnalogMultiChannelReader, CounterReader
from nidaqmx.stream_writers import AnalogMultiChannelWriter, DigitalSingleChannelWriter
from nidaqmx.system import Device
from nidaqmx.system.watchdog import WatchdogTask
from nidaqmx.types import AOExpirationState, DOExpirationState
from support.cards.ni_card import ServedCard, ni_card

from rigd_sim.wire.cards.ni_terminals import Terminals, Timer

Options = Callable[[str], nidaqmx.GrpcSessionOptions]


@pytest.fixture
def card() -> Iterator[ServedCard]:
    with ni_card() as found:
        yield found


@pytest.fixture
def options(card: ServedCard) -> Iterator[Options]:
    with grpc.insecure_channel(f"127.0.0.1:{card.part.port}") as channel:
        yield lambda session: nidaqmx.GrpcSessionOptions(channel, session)


def error_code(call: Callable[[], Any]) -> int:
    with pytest.raises(DaqError) as caught:
        call()
    return int(caught.value.error_code)


def test_package_finds_the_card_and_its_ranges(options: Options) -> None:
    device = Device("Dev1", grpc_options=options(""))
    assert device.product_type == "PCIe-6363"
    assert list(device.ao_voltage_rngs) == [-5.0, 5.0, -10.0, 10.0]


def give_volts(task: nidaqmx.Task, *volts: float) -> None:
    writer = AnalogMultiChannelWriter(task.out_stream)
    writer.verify_array_shape = False  # it would ask for attributes
    writer.write_one_sample(np.array(volts))


def give_lines(task: nidaqmx.Task, *levels: bool) -> None:
    writer = DigitalSingleChannelWriter(task.out_stream)
    writer.verify_array_shape = False
    writer.write_one_sample_multi_line(np.array(levels))


def test_single_samples_go_in_and_out(card: ServedCard, options: Options) -> None:
    card.block.volts_in[2] = 3.21
    card.block.counts[1] = 77
    with nidaqmx.Task("ai", grpc_options=options("ai")) as task:
        task.ai_channels.add_ai_voltage_chan("Dev1/ai2")
        task.start()
        reader = AnalogMultiChannelReader(task.in_stream)
        reader.verify_array_shape = False
        data = np.zeros(1)
        reader.read_one_sample(data)
        assert data[0] == pytest.approx(3.21, abs=2e-4)
    with nidaqmx.Task("ao", grpc_options=options("ao")) as task:
        task.ao_channels.add_ao_voltage_chan("Dev1/ao0:1")
        task.start()
        give_volts(task, 1.5, -2.5)
        assert card.block.volts_out[:2] == [1.5, -2.5]
    with nidaqmx.Task("ci", grpc_options=options("ci")) as task:
        task.ci_channels.add_ci_ang_encoder_chan("Dev1/ctr1", units=AngleUnits.TICKS)
        task.start()
        card.block.counts[1] += 12
        assert CounterReader(task.in_stream).read_one_sample_double() == 12.0
    assert card.block.volts_out[:2] == [1.5, -2.5]  # a task that is gone leaves them


@pytest.fixture
def stopped() -> Iterator[ServedCard]:
    """A card whose clock goes on by :meth:`ServedCard.pulse` alone."""
    with ni_card(clock_ns=1) as found:
        yield found


def pulse_task(card: ServedCard, channel: grpc.Channel, kind: str, buffer: int) -> nidaqmx.Task:
    task = nidaqmx.Task("ci", grpc_options=nidaqmx.GrpcSessionOptions(channel, "ci"))
    getattr(task.ci_channels, f"add_ci_{kind}")("Dev1/ctr1", max_val=20.0)
    task.timing.cfg_implicit_timing(AcquisitionType.CONTINUOUS, buffer)
    task.start()
    return task


@pytest.fixture
def channel(stopped: ServedCard) -> Iterator[grpc.Channel]:
    with grpc.insecure_channel(f"127.0.0.1:{stopped.part.port}") as found:
        yield found


def test_periods_of_pulses_are_read(stopped: ServedCard, channel: grpc.Channel) -> None:
    with pulse_task(stopped, channel, "period_chan", 10) as task:
        assert task.in_stream.avail_samp_per_chan == 0
        stopped.pulse(1, 1, 0.5)  # the first period begins with the task
        stopped.pulse(1, 4, 1.0)
        assert task.in_stream.avail_samp_per_chan == 5
        periods = np.zeros(5)
        assert CounterReader(task.in_stream).read_many_sample_double(periods, 5, 0.0) == 5
        assert periods == pytest.approx([0.5, 0.25, 0.25, 0.25, 0.25])
        assert task.in_stream.avail_samp_per_chan == 0


def test_high_and_low_times_are_read(stopped: ServedCard, channel: grpc.Channel) -> None:
    with pulse_task(stopped, channel, "pulse_chan_time", 10) as task:
        stopped.block.duty = 0.2
        stopped.pulse(1, 2, 0.1)
        high, low = np.zeros(2), np.zeros(2)
        CounterReader(task.in_stream).read_many_sample_pulse_time(high, low, 2, 0.0)
        assert high == pytest.approx([0.01, 0.01])
        assert low == pytest.approx([0.04, 0.04])


def test_period_beyond_32_bits_wraps(stopped: ServedCard, channel: grpc.Channel) -> None:
    with pulse_task(stopped, channel, "period_chan", 10) as task:
        stopped.pulse(1, 1, 2**32 * 1e-8 + 0.003)
        periods = np.zeros(1)
        CounterReader(task.in_stream).read_many_sample_double(periods, 1, 0.0)
        assert periods[0] == pytest.approx(0.003)


def test_full_buffer_fails_the_read(stopped: ServedCard, channel: grpc.Channel) -> None:
    with pulse_task(stopped, channel, "period_chan", 10) as task:
        stopped.pulse(1, 11, 1.0)
        reader = CounterReader(task.in_stream)
        assert error_code(lambda: reader.read_many_sample_double(np.zeros(10), 10, 0.0)) == -200279


def test_pulse_that_has_not_come_is_refused(stopped: ServedCard, channel: grpc.Channel) -> None:
    with pulse_task(stopped, channel, "period_chan", 10) as task:
        reader = CounterReader(task.in_stream)
        assert error_code(lambda: reader.read_many_sample_double(np.zeros(1), 1, 0.0)) == -200284


def test_two_tasks_cannot_have_one_output(options: Options) -> None:
    with (
        nidaqmx.Task("first", grpc_options=options("first")) as first,
        nidaqmx.Task("second", grpc_options=options("second")) as second,
    ):
        for task in (first, second):
            task.ao_channels.add_ao_voltage_chan("Dev1/ao0")
        first.start()
        assert error_code(second.start) == -50103


@pytest.mark.parametrize("channel", ["Dev1/ao4", "Dev1/ao0:4", "Dev1/ai0", "Dev1/x", "Dev2/ao0"])
def test_unknown_outputs_are_refused(options: Options, channel: str) -> None:
    with nidaqmx.Task("ao", grpc_options=options("ao")) as task:
        code = error_code(lambda: task.ao_channels.add_ao_voltage_chan(channel))
        assert code == (-200220 if channel.startswith("Dev2") else -200170)


def test_watchdog_takes_outputs_to_their_states(card: ServedCard, options: Options) -> None:
    with (
        nidaqmx.Task("do", grpc_options=options("do")) as lines,
        WatchdogTask("Dev1", "dog", timeout=0.3, grpc_options=options("dog")) as dog,
    ):
        lines.do_channels.add_do_chan("Dev1/port0/line0:1")
        lines.start()
        give_lines(lines, True, False)
        assert card.block.lines_out == 0b01
        dog.cfg_watchdog_do_expir_states(
            [
                DOExpirationState("Dev1/port0/line0", Level.LOW),
                DOExpirationState("Dev1/port0/line1", Level.HIGH),
            ]
        )
        dog.cfg_watchdog_ao_expir_states(
            [AOExpirationState("Dev1/ao0", 1.0, WatchdogAOExpirState.VOLTAGE)]
        )
        dog.start()
        began = time.monotonic()
        while not dog.expired:
            assert time.monotonic() - began < 30.0
        assert time.monotonic() - began >= 0.29
        assert (card.block.lines_out, card.block.volts_out[0]) == (0b10, 1.0)
        assert error_code(lambda: give_lines(lines, True, False)) == -200678
        dog.clear_expiration()
        give_lines(lines, True, True)
        assert card.block.lines_out == 0b11


def test_timer_that_is_reset_never_expires() -> None:
    now = [0]
    timer = Timer(lambda: now[0])
    timer.start(0.1)
    for _ in range(100):
        now[0] += 90_000_000
        assert not timer.has_just_expired()
        timer.reset()
    now[0] += 100_000_000
    assert timer.has_just_expired()
    assert not timer.has_just_expired()
    assert timer.expired


@pytest.mark.parametrize(("fault", "code"), [("reset", -200088), ("removal", -201003)])
def test_reset_and_removal_take_power_and_tasks(
    card: ServedCard, options: Options, fault: str, code: int
) -> None:
    task = nidaqmx.Task("ao", grpc_options=options("ao"))
    task.ao_channels.add_ao_voltage_chan("Dev1/ao0")
    task.start()
    give_volts(task, 4.0)
    card.inject(fault)
    assert card.block.volts_out[0] == 0.0
    assert error_code(lambda: give_volts(task, 4.0)) == code
    assert card.state()["tasks"] == 0


@pytest.mark.parametrize(
    ("fault", "options"),
    [("fire", {}), ("saturation", {}), ("saturation", {"input": 40}), ("reset", {"hard": 1}),
     ("counter_reset", {"counter": 4}), ("stall", {}), ("stall", {"seconds": -1})],
)  # fmt: skip
def test_faults_it_does_not_know_are_refused(
    card: ServedCard, fault: str, options: dict[str, Any]
) -> None:
    with pytest.raises(ValueError, match="fault"):
        card.inject(fault, **options)


def test_inputs_and_counters_show_their_faults(card: ServedCard) -> None:
    terminals = Terminals(card.block.wires(), (), ())
    card.block.volts_in[1] = 2.0
    card.block.counts[0] = 10
    assert terminals.volts_at(1) == pytest.approx(2.0, abs=2e-4)
    terminals.inject("stuck_code", input=1)
    card.block.volts_in[1] = 3.0
    assert terminals.volts_at(1) == pytest.approx(2.0, abs=2e-4)
    terminals.clear()
    terminals.inject("saturation", input=1, rail="low")
    assert terminals.volts_at(1) == -10.0
    terminals.clear()
    terminals.inject("sign_flip", counter=0)
    card.block.counts[0] = 15
    assert terminals.counted(0) == 5
    terminals.inject("counter_reset", counter=0)
    assert terminals.counted(0) == 0
