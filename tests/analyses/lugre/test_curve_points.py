"""What the data show beside the friction curve: measured, not fitted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rigd.analysis.friction import SlipForce
from rigd_analyses.lugre.curve import FOLLOWED, LEAST_SEEN, seen, slid_range
from rigd_analyses.lugre.model import LugreModel, friction

THETA = np.array([0.05, 0.12, 0.2, 50.0, 0.3, 2.5])
VISITED = (2e-3, 0.08)
PERIOD_S = 1e-3


def model_of(offset: float, sign: float) -> LugreModel:
    """Return a slide through ``VISITED`` whose force is ``offset`` beyond the model."""
    slip = sign * np.geomspace(1e-3, 0.1, 8000)
    blank = SlipForce("slide", PERIOD_S, slip, np.zeros_like(slip), np.ones_like(slip))
    force = LugreModel([blank]).predict(THETA) + sign * offset
    return LugreModel([replace(blank, force=force)])


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("offset", [0.0, 0.02, -0.01])
def test_points_follow_the_measurement_not_the_fit(offset: float, sign: float) -> None:
    points = seen(model_of(offset, sign), THETA, VISITED)
    assert len(points) > 10
    for point in points:
        assert VISITED[0] <= point.x <= VISITED[1]
        assert point.count >= LEAST_SEEN
        expected = float(friction(THETA, np.array([point.x]))[0]) + offset
        assert point.median == pytest.approx(expected, abs=1e-4)
        assert point.low <= point.median <= point.high


def test_ranges_without_samples_have_no_point() -> None:
    points = seen(model_of(0.0, 1.0), THETA, (0.05, 10.0))
    assert points
    assert max(point.x for point in points) <= 0.1


def test_slip_is_visited_where_the_bristle_follows() -> None:
    # A steady slide of 1 mm/s, one length of the bristle (g/sigma_0) long, then a fast one.
    length = float(friction(THETA, np.array([1e-3]))[0]) / THETA[3]
    slow = np.full(round(length / 1e-3 / PERIOD_S), 1e-3)
    fast = np.full(1000, 0.1)
    assert slid_range(np.concatenate([slow, fast]), THETA, PERIOD_S) == (1e-3, 0.1)
    # Of a twentieth of that length friction at 1 mm/s is not known, however many the samples.
    brief = slow[: int(0.9 * FOLLOWED * len(slow))]
    assert slid_range(np.concatenate([brief, fast]), THETA, PERIOD_S) is None
    many = np.full(100_000, 1e-9)
    found = slid_range(np.concatenate([many, np.geomspace(2e-3, 0.1, 9000)]), THETA, PERIOD_S)
    assert found is not None
    assert 2e-3 <= found[0] < 3e-3


def test_a_bristle_that_hardly_slides_shows_nothing() -> None:
    assert slid_range(np.empty(0), THETA, PERIOD_S) is None
    assert slid_range(np.geomspace(1e-6, 1e-4, 100), THETA, PERIOD_S) is None
