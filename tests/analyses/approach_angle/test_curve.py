"""The pooled curve: it finds a known hump, keeps outliers out, and admits what it did not see."""

from __future__ import annotations

import numpy as np
import pytest

from rigd_analyses.approach_angle.curve import pool
from rigd_analyses.approach_angle.raw.run_data import FloatArray

MU, PEAK, HUMP = 0.45, 0.5, 0.08


def made(
    rng: np.random.Generator, runs: int = 25, slow: float = 0.15, fast: float = 1.5,
    between: float = 0.015, within: float = 0.01,
) -> tuple[list[FloatArray], list[FloatArray]]:  # fmt: skip
    """Return speeds and friction of runs that each accelerate through a part of the range."""
    speeds, frictions = [], []
    for _ in range(runs):
        start = slow * (fast / slow) ** rng.uniform(0.0, 0.7)
        speed = np.linspace(start, min(fast, 2.0 * start), 12)
        limit = MU * np.exp(-HUMP * np.log10(speed / PEAK) ** 2)
        offset = 1.0 + between * rng.standard_normal()
        speeds.append(speed)
        frictions.append(limit * offset * (1.0 + within * rng.standard_normal(12)))
    return speeds, frictions


def test_exact_blocks_give_the_exact_maximum() -> None:
    speeds, frictions = made(np.random.default_rng(1), between=0.0, within=0.0)
    found = pool(speeds, frictions, range(25))
    assert found.maximum == pytest.approx(MU, rel=1e-6)
    assert found.curve.peak_speed_m_s == pytest.approx(PEAK, rel=1e-4)
    assert found.at_edge == ""
    assert found.maximum_u < 1e-6


@pytest.mark.parametrize("runs", [5, 15])
def test_interval_holds_true_maximum_as_often_as_stated(runs: int) -> None:
    rng = np.random.default_rng(2)
    held = 0
    for _ in range(150):
        found = pool(*made(rng, runs=runs), range(runs))
        held += abs(found.maximum - MU) <= 2.0 * found.maximum_u
    assert held >= 0.88 * 150  # 95 %, less four standard deviations of the count


def test_scatter_of_curve_equals_spread_between_runs() -> None:
    found = pool(*made(np.random.default_rng(3), runs=80, between=0.02), range(80))
    assert found.scatter == pytest.approx(0.02, rel=0.35)


def test_fifth_of_bad_runs_hardly_moves_maximum() -> None:
    speeds, frictions = made(np.random.default_rng(4))
    clean = pool(speeds, frictions, range(25))
    spoilt = [m * (1.4 if k % 5 == 0 else 1.0) for k, m in enumerate(frictions)]
    found = pool(speeds, spoilt, range(25))
    assert found.maximum == pytest.approx(clean.maximum, rel=0.01)
    bad = np.isin(found.curve.block_run, range(0, 25, 5))
    assert np.all(found.curve.block_weight[bad] == 0.0)


def test_maximum_of_curve_is_not_that_of_points() -> None:
    speeds, frictions = made(np.random.default_rng(5))
    found = pool(speeds, frictions, range(25))
    assert max(float(m.max()) for m in frictions) > 1.03 * MU
    assert found.maximum == pytest.approx(MU, rel=0.015)


@pytest.mark.parametrize(("slow", "fast", "edge"), [(0.8, 1.6, "slow"), (0.05, 0.2, "fast")])
def test_maximum_beyond_speeds_is_reported_and_widens_interval(
    slow: float, fast: float, edge: str
) -> None:
    exact = made(np.random.default_rng(6), slow=slow, fast=fast, between=0.0, within=0.0)
    found = pool(*exact, range(25))
    assert found.at_edge == edge
    assert slow <= found.curve.peak_speed_m_s <= fast
    assert 0.0 < MU - found.maximum < 2.0 * found.maximum_u
    # A slope that falls to 0 adds half of what it would add if it went on.
    assert found.maximum_u < MU - found.maximum


def test_curve_is_quoted_on_range_of_data_only() -> None:
    speeds, frictions = made(np.random.default_rng(7))
    curve = pool(speeds, frictions, range(25)).curve
    everything = np.concatenate(speeds)
    assert everything.min() < curve.speed_m_s[0] and curve.speed_m_s[-1] < everything.max()
    assert np.all((curve.low < curve.mu) & (curve.mu < curve.high))


def test_few_runs_widen_the_interval() -> None:
    rng = np.random.default_rng(8)
    few = np.median([pool(*made(rng, runs=5), range(5)).maximum_u for _ in range(20)])
    many = np.median([pool(*made(rng, runs=25), range(25)).maximum_u for _ in range(20)])
    assert few > 2.5 * many  # more than the sqrt(5) of the number alone


def test_as_many_runs_as_parameters_are_refused() -> None:
    with pytest.raises(ValueError, match="3 runs"):
        pool(*made(np.random.default_rng(9), runs=3), range(3))
