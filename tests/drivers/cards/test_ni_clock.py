"""The times of samples: drift, delays, stalls, from arrivals made up with a known truth."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import linprog

from rigd_drivers.cards.ni_daq.sample_clock import MOST_SLEW, SampleClock, line_below

RATE_HZ, BLOCK, START_NS = 9600.0, 96, 7_000_000_000


def stamped(
    seconds: float, ppm: float, *, stall_s: float = 0.0
) -> tuple[SampleClock, NDArray[np.int64], NDArray[np.int64]]:
    """Return the clock, its times and the true ones (ns) of a card that runs fast by ``ppm``.

    A block arrives 0.3 ms late, and by another 1 ms on average.
    """
    random = np.random.default_rng(7)
    period_ns = 1e9 / (RATE_HZ * (1 + ppm * 1e-6))
    first_ns = START_NS + 3_000_000
    clock = SampleClock(RATE_HZ, START_NS)
    times, truth, arrived = [], [], 0.0
    for number in range(int(seconds * RATE_HZ / BLOCK)):
        true = first_ns + (number * BLOCK + np.arange(BLOCK)) * period_ns
        delay_ns = 0.3e6 + random.exponential(1e6)
        if number % 1000 == 500:
            delay_ns += stall_s * 1e9
        arrived = max(arrived, true[-1] + delay_ns)  # blocks come one after the other
        times.append(clock.stamp(BLOCK, int(arrived)))
        assert times[-1][-1] <= int(arrived)
        truth.append(true.astype(np.int64))
    return clock, np.concatenate(times), np.concatenate(truth)


@pytest.mark.parametrize("ppm", [-100.0, 0.0, 40.0, 100.0])
def test_times_follow_true_ones_and_rate_is_found(ppm: float) -> None:
    clock, times, truth = stamped(120, ppm, stall_s=0.1)
    error_ns = times - truth
    settled = error_ns[len(error_ns) // 4 :]
    assert 0.1e6 < settled.mean() < 0.6e6  # the smallest delay cannot be determined
    assert np.abs(settled - settled.mean()).max() < 0.3e6
    assert clock.rate_hz == pytest.approx(RATE_HZ * (1 + ppm * 1e-6), rel=3e-6)
    assert clock.count == len(times)


def test_times_increase_and_are_smooth_after_start() -> None:
    _, times, _ = stamped(30, 40.0, stall_s=0.1)
    steps = np.diff(times) * RATE_HZ * 1e-9
    assert steps.min() > 0.5
    settled = steps[len(steps) // 2 :]
    assert np.abs(settled - 1.0).max() < MOST_SLEW + 1e-4


def test_no_sample_precedes_start_or_follows_arrival() -> None:
    clock = SampleClock(1000.0, START_NS)
    times = clock.stamp(10, START_NS + 1_000_000)  # 10 samples of 1 ms in 1 ms
    assert times[0] == START_NS
    assert times[-1] == pytest.approx(START_NS + 1_000_000, abs=1)
    assert np.all(np.diff(times) > 0)


def test_single_first_sample_gets_its_arrival_time() -> None:
    clock = SampleClock(10.0, START_NS)
    assert clock.stamp(1, START_NS + 7).tolist() == [START_NS + 7]
    assert clock.stamp(1, START_NS + 100_000_007).tolist() == [START_NS + 100_000_007]


def test_late_first_block_is_worked_off_at_once() -> None:
    clock = SampleClock(1000.0, START_NS)
    clock.stamp(10, START_NS + 9_000_000 + 8_000_000)
    times = clock.stamp(10, START_NS + 19_000_000)
    assert times[0] > START_NS + 17_000_000
    assert times[-1] == pytest.approx(START_NS + 19_000_000, abs=1)
    assert np.all(np.diff(times) > 0)


def test_line_below_is_the_linear_programme() -> None:
    random = np.random.default_rng(3)
    for _ in range(50):
        x = np.sort(random.uniform(0, 10, 20))
        y = 2 - 0.3 * x + random.exponential(1.0, 20)
        level, slope = line_below(list(zip(x.tolist(), y.tolist(), strict=True)))
        # Highest sum of the line over all points, with every point on or above it.
        solved = linprog(
            [-len(x), -x.sum()],
            A_ub=np.column_stack([np.ones_like(x), x]),
            b_ub=y,
            bounds=[(None, None), (None, None)],
        )
        assert solved.x is not None
        assert [level, slope] == pytest.approx(solved.x.tolist(), abs=1e-6)


def test_line_below_one_point_is_level() -> None:
    assert line_below([(5.0, 3.0)]) == (3.0, 0.0)
