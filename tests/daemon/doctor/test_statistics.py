"""Zero and noise of a channel from blocks, against numpy on the whole."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rigd.daemon.doctor.statistics import Statistics


@pytest.mark.parametrize("offset", [0.0, 1e6])
def test_blocks_of_any_length_give_equal_statistics(offset: float) -> None:
    random = np.random.default_rng(7)
    values = offset + random.normal(0.3, 0.02, 5000)
    seen = Statistics()
    for block in np.split(values, [1, 2, 3, 50, 51, 4000]):
        seen.add(block)
    assert seen.count == 5000
    assert seen.mean == pytest.approx(values.mean(), rel=1e-12)
    assert seen.deviation == pytest.approx(values.std(ddof=1), rel=1e-6)
    assert (seen.low, seen.high) == (values.min(), values.max())
    assert not seen.constant
    assert not seen.climbing


def test_non_finite_values_are_counted_and_left_out() -> None:
    seen = Statistics()
    seen.add(np.array([1.0, math.nan, 3.0]))
    seen.add(np.array([math.inf]))
    assert (seen.count, seen.not_finite, seen.mean) == (2, 2, 2.0)


def test_unchanged_value_is_constant_and_rising_value_climbs() -> None:
    still, clock = Statistics(), Statistics()
    for begin in range(0, 9, 3):
        still.add(np.full(3, 4.2))
        clock.add(np.arange(begin, begin + 3.0))
    assert (still.constant, still.climbing) == (True, False)
    assert (clock.constant, clock.climbing) == (False, True)
    clock.add(np.array([8.0]))  # as the last one: a climb has ended
    assert not clock.climbing


def test_deviation_of_one_value_is_nan() -> None:
    seen = Statistics()
    assert math.isnan(seen.deviation)
    seen.add(np.array([1.0]))
    assert math.isnan(seen.deviation)
    assert not seen.constant
