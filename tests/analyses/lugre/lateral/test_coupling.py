"""The coupling in closed form, against iteration, differences and its own symmetries."""

from __future__ import annotations

import numpy as np
import pytest
from support.lugre.lateral_bench import DRY, VISCOUS, roller_force

from rigd_analyses.lugre.lateral import coupling
from rigd_analyses.lugre.lateral.coupling import LiftedRows, Shape, lateral_force, load

THETA = np.array([DRY, VISCOUS, 0.012, 0.25, 0.03, 0.04, -0.012])
SPEEDS = np.array([-0.65, -0.5, -0.2, -5e-4, 0.0, 2e-4, 0.2, 0.35, 0.5, 0.65])
#: The mass is nearer to the other row, which negative speeds lift.
OTHER_ROW = np.array([DRY, VISCOUS, 0.012, 0.25, 0.03, 0.04, -0.029])


def shape(rows: LiftedRows, lever_sign: float = 1.0) -> Shape:
    return Shape(lever_sign, 0.05, 0.04, 0.03, rows)


@pytest.mark.parametrize("rows", LiftedRows)
def test_closed_form_agrees_with_iteration(rows: LiftedRows) -> None:
    force, _ = lateral_force(SPEEDS, THETA, rows)
    iterated = roller_force(SPEEDS, 1.0, physical=rows is LiftedRows.PHYSICAL)
    np.testing.assert_allclose(force, iterated, rtol=1e-9, atol=1e-15)


def test_loads_are_those_of_the_paper() -> None:
    """Eqs. 21 to 24 and 48 written out, for one speed of either sign."""
    for speed, force in ((0.2, 0.041), (-0.2, -0.041)):
        found = load(np.array([speed]), THETA, shape(LiftedRows.PRINTED))
        moment = 0.012 - force * 0.25
        upper, lower = (-force * 0.03 - moment) / 0.06, (-force * 0.03 + moment) / 0.06
        assert found.guide[0] == pytest.approx((abs(upper) + abs(lower)) / (0.012 / 0.03))
        near, far = (0.07 - force * 0.05) / 0.04, (0.03 - force * 0.05) / 0.04
        assert found.bearing[0] == pytest.approx((near + far) / 2.5)


@pytest.mark.parametrize("rows", LiftedRows)
@pytest.mark.parametrize("theta", [THETA, OTHER_ROW], ids=["first", "second"])
def test_derivatives_agree_with_differences(rows: LiftedRows, theta: np.ndarray) -> None:
    exact = load(SPEEDS, theta, shape(rows))
    for column in range(len(coupling.NAMES)):
        step = 1e-6 * abs(theta[column])
        up, down = theta.copy(), theta.copy()
        up[column] += step
        down[column] -= step
        high, low = load(SPEEDS, up, shape(rows)), load(SPEEDS, down, shape(rows))
        guide = (high.guide - low.guide) / (2.0 * step)
        bearing = (high.bearing - low.bearing) / (2.0 * step)
        np.testing.assert_allclose(exact.guide_by[:, column], guide, rtol=1e-5, atol=1e-6)
        np.testing.assert_allclose(exact.bearing_by[:, column], bearing, rtol=1e-5, atol=1e-6)


def test_other_lever_sign_mirrors_the_guide() -> None:
    physical = shape(LiftedRows.PHYSICAL)
    mirrored = load(-SPEEDS, THETA, shape(LiftedRows.PHYSICAL, -1.0))
    np.testing.assert_allclose(load(SPEEDS, THETA, physical).guide, mirrored.guide, rtol=1e-12)


def test_without_lateral_motion_nothing_changes() -> None:
    found = load(np.zeros(1), THETA, shape(LiftedRows.PRINTED))
    assert found.guide[0] == 1.0
    assert found.bearing[0] == pytest.approx(1.0, rel=1e-12)


def test_locking_loop_stays_finite() -> None:
    locked = THETA * [5.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0]
    found = load(SPEEDS, locked, shape(LiftedRows.PRINTED))
    assert np.all(np.isfinite(found.guide))
    assert np.all(np.isfinite(found.guide_by))
