"""The in-process devices: rows, blocks, the relay's obedience, and the driver suite's rules."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from support.approach_angle.plant import MS, make_plant, pass_time, shipped, truth

from rigd.sdk import Block, DeviceError, DriverConfig
from rigd.sdk.check import check_driver
from rigd_sim.approach_angle import layout
from rigd_sim.approach_angle.acquisition import Acquisition
from rigd_sim.approach_angle.daq import AngleDaq, DaqConfig
from rigd_sim.approach_angle.plant import AnglePlant
from rigd_sim.approach_angle.relay import AngleRelay
from rigd_sim.approach_angle.sensors import AngleScale, AngleTruth


def started(plant: AnglePlant, **options: object) -> AngleDaq:
    daq = AngleDaq(DaqConfig.model_validate(options), plant)
    daq.open()
    daq.start()
    return daq


def blocks(daq: AngleDaq, cycles: int) -> list[tuple[int, Block]]:
    """Return each block with the plant's time at which a cycle of 1 kHz got it."""
    got = []
    for _ in range(cycles):
        daq.link.advance(daq.link.now_ns + MS)
        while (block := daq.read_block(0.0)) is not None:
            got.append((daq.link.now_ns, block))
    return got


@pytest.mark.parametrize("driver", [AngleDaq, AngleRelay, AngleScale, AngleTruth])
def test_conforms(driver: type) -> None:
    check_driver(driver, {})


def test_compilation_is_done_at_opening() -> None:
    # In a cycle it would be a silence for which the cycle is taken for dead.
    code = """
from support.approach_angle.plant import make_plant
from rigd_sim.approach_angle.daq import AngleDaq, DaqConfig
AngleDaq(DaqConfig(), make_plant()).open()
from rigd_sim.approach_angle.sampling import sample
assert sample.signatures, "it compiles with the first block"
"""
    subprocess.run([sys.executable, "-c", code], check=True, cwd=Path(__file__).parents[2])


@pytest.mark.parametrize("load_cell", [False, True])
def test_block_has_quantities_beside_volts_and_gapless_times(load_cell: bool) -> None:
    daq = started(make_plant(), load_cell=load_cell)
    inputs = 5 if load_cell else 4
    names = [channel.name for channel in daq.declaration.channels]
    expected = [name for signal in layout.SIGNALS[:inputs] for name in (signal, f"{signal}_raw")]
    assert names == [*expected, "device_time", "clock_rate"]
    got = [block for _, block in blocks(daq, 500)]
    times = np.concatenate([block.times_ns for block in got])
    rows = np.concatenate([block.values for block in got])
    assert rows.shape == (len(times), 2 * inputs + 3)
    np.testing.assert_array_equal(times, np.rint(np.arange(len(times)) * 1e9 / 9600))
    np.testing.assert_allclose(rows[:, -3], np.arange(len(times)) / 9600)
    assert not rows[:, -1].any()
    mean = dict(zip(names, rows.mean(axis=0)[:-1], strict=True))
    assert mean["gauge_a"] == pytest.approx(mean["gauge_a_raw"] / 0.02e6, rel=1e-9)
    assert abs(mean["gauge_a"]) < 10e-6
    assert mean["wheel_angle"] == pytest.approx(0.0, abs=1.0)
    assert mean["platform_position"] == pytest.approx(0.0, abs=4e-3)
    if load_cell:
        assert mean["normal_force"] == pytest.approx(39.2, abs=4.0)


@pytest.mark.parametrize(("block", "latency_ms"), [(96, 8.0), (480, 15.0)])
def test_block_arrives_after_latency_with_exponential_tail(block: int, latency_ms: float) -> None:
    daq = started(make_plant(), block=block, latency=f"{latency_ms} ms")
    late = [(now - int(item.times_ns[-1])) * 1e-6 - 1e3 / 9600 for now, item in blocks(daq, 6000)]
    assert min(late) >= latency_ms - 3.0
    # A cycle later on average by half of one.
    assert np.mean(late) == pytest.approx(latency_ms + 0.5, abs=1.2)


def test_no_newest_row_grows_older_than_declared() -> None:
    """With this seed a block of the first second is drawn 44 ms late; a card holds none so long."""
    daq = started(make_plant(seed=835))
    got = blocks(daq, 1000)
    came, newest = zip(*((now, int(block.times_ns[-1])) for now, block in got), strict=True)
    oldest_s = max(np.subtract(came[1:], newest[:-1])) * 1e-9
    declared_s = daq.declaration.oldest_s
    assert declared_s - 0.5e-3 < oldest_s <= declared_s + 1e-3  # cycles are 1 ms apart


def test_no_block_overtakes_the_one_before_it() -> None:
    """Though it may be ready before it: 10 ms lie between two, and the latency varies by more."""
    card = Acquisition(make_plant(), start_ns=0, latency_s=0.05, jitter_s=0.05)
    due = []
    for _ in range(100):
        due.append(card.due_ns)
        card.read_due()
    assert min(np.diff(due)) == 0


def test_samples_unread_in_time_are_lost_and_reported() -> None:
    daq = started(make_plant())
    pass_time(daq.link, 8.0)
    with pytest.raises(DeviceError, match=r"were not read for 6\.8 s and are lost"):
        daq.read_block(0.0)


def test_cycle_sees_median_of_last_samples() -> None:
    daq = started(make_plant(), median=5)
    rows = np.zeros((96, 11))
    rows[-5:, 6] = [0.1, 0.2, 99.0, 0.3, -99.0]
    rows[-1, 8] = 7.0
    seen = daq.newest_row(Block(np.arange(96, dtype=np.int64), rows))
    assert seen[6] == 0.2
    assert seen[8] == 7.0
    even = started(make_plant(), median=4)
    assert even.newest_row(Block(np.arange(96, dtype=np.int64), rows))[6] == pytest.approx(0.25)


def test_input_at_rail_is_in_status_word() -> None:
    plant = make_plant()
    daq = started(plant)
    pass_time(plant, 0.05)
    plant.history[:, 1] = 12.0
    plant.history[:, 3] = -12.0
    block = daq.read_block(0.0)
    assert block is not None
    assert set(block.values[:, -1]) == {0b1010}
    assert set(block.values[:, 3]) == {10.0}
    assert daq.declaration.status_bits == {
        "gauge_a_at_rail": 1,
        "gauge_b_at_rail": 2,
        "wheel_angle_at_rail": 4,
        "platform_position_at_rail": 8,
    }


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"rate": "20 kHz"}, "less than or equal to 9600"),
        ({"block": 4}, "a median of 5 samples needs more than a block of 4"),
        ({"latency": "1 ms"}, "jitter 0.003 s is a part of latency 0.001 s"),
        ({"rate": 9600}, "has no unit"),
    ],
)
def test_options_that_cannot_be_are_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        DaqConfig.model_validate(options)


def relay(plant: AnglePlant) -> AngleRelay:
    device = AngleRelay(DriverConfig(), plant)
    device.open()
    return device


def test_armed_relay_obeys_and_shows_its_contact() -> None:
    plant = make_plant()
    device = relay(plant)
    device.write([1.0])
    pass_time(plant, 0.05)
    assert device.read(plant.now_ns) == (0.0,)
    device.arm()
    device.write([1.0])
    assert device.read(plant.now_ns + 5 * MS) == (0.0,)
    assert device.read(plant.now_ns + 10 * MS) == (1.0,)
    assert truth(plant, "wheel_speed") > 0.0
    device.make_safe()
    assert device.read(plant.now_ns + 10 * MS) == (0.0,)
    device.write([1.0])
    assert device.read(plant.now_ns + 20 * MS) == (0.0,)


def test_relay_refuses_nan_and_unknown_values() -> None:
    plant = make_plant()
    device = relay(plant)
    device.arm()
    with pytest.raises(DeviceError, match="'closed' is NaN"):
        device.write([math.nan])
    plant.change("wheel", "coated")
    plant.change("angle", math.pi / 4)
    with pytest.raises(DeviceError, match=r"friction .*coated wheel at 45"):
        device.write([1.0])


def test_scale_has_one_row_for_each_reading() -> None:
    plant = make_plant()
    scale = AngleScale(DriverConfig(), plant)
    rows = [scale.read(k * 10 * MS) for k in range(1, 701)]
    taken = [row for row in rows if row is not None]
    assert len(taken) == 28
    assert taken[-1][1] == scale.declaration.status_bits["stable"]
    assert taken[-1][0] == pytest.approx(4.0, abs=0.2)
    plant.change("scale_weight", 50.0)
    late = [row for k in range(701, 1401) if (row := scale.read(k * 10 * MS)) is not None]
    assert math.isnan(late[-1][0])
    assert late[-1][1] == scale.declaration.status_bits["overload"]


def test_truth_device_reports_the_hidden_state() -> None:
    plant = make_plant()
    plant.command(True)
    truth = AngleTruth(DriverConfig(), plant)
    row, channels = truth.read(300 * MS), truth.declaration.channels
    assert row == plant.truth
    radius = shipped().wheel.radius * shipped().wheel.effective_radius
    named = dict(zip((channel.name for channel in channels), row, strict=True))
    assert named["platform_speed"] > 0.1
    assert named["sliding_speed"] == pytest.approx(
        radius * named["wheel_speed"] - named["platform_speed"]
    )
