"""The coupling from the friction of the guide in each trial: all optima, what the data allow."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from support.lugre.lateral_bench import DRY, VISCOUS
from support.lugre.lateral_wrong import Sweep, right

from rigd.analysis.output_error.whitened_residuals import OutputErrorModel, noise_at
from rigd.analysis.result import FitOutcome, FloatArray
from rigd_analyses.lugre.lateral.coupling_fit.fit import reduced
from rigd_analyses.lugre.lateral.coupling_fit.loads import FreeLoads, Loads
from rigd_analyses.lugre.lateral.coupling_fit.problem import UNEVEN, Reduced, optima, strained
from rigd_analyses.lugre.lateral.family import find_lateral
from rigd_analyses.lugre.lateral.result import result
from rigd_analyses.lugre.lateral.starts import starts


def test_either_law_is_held_by_intervals() -> None:
    # Rig 13: both laws of a lifted row fit, with mu_R_dry 0.040 and 0.051; 0.046 is true.
    sweep = right(13)
    found = find_lateral(sweep.trials(), sweep.rig, sweep.constants)
    assert found.gate.outcome is FitOutcome.FITS
    assert not found.rows_known
    shown = result(found)
    for name, value in sweep.truth.items():
        entry = shown.parameter(name)
        assert entry.low is not None and entry.high is not None, name
        assert entry.low <= value <= entry.high, name


@pytest.fixture(scope="module")
def uneven() -> Callable[[float], tuple[Reduced, FloatArray]]:
    """Return what makes the problem of rollers of an unevenness, and a point of it (9,)."""
    sweep = Sweep()
    system = sweep.system
    means = tuple(np.array([np.mean(speed)]) for speed in system.speeds)
    system = replace(system, speeds=means)
    free, theta = FreeLoads.of(system), starts(system)[0]
    model = OutputErrorModel(free, noise_at(free, theta))
    count = len(system.speeds)
    loads = Loads(free, model, np.ones(count), np.eye(count), theta, np.zeros((0, count)))

    def problem(unevenness: float) -> tuple[Reduced, FloatArray]:
        found = reduced(loads, system, system)
        found = replace(found, unknowns=(*found.unknowns, UNEVEN))
        point = np.array([item.start for item in found.parameters])
        point[[1, 2, -1]] = DRY, VISCOUS, unevenness
        forces = found.forces(point)[0]
        known = replace(loads, forces_n=forces, covariance=np.diag((0.005 * forces) ** 2))
        return replace(found, loads=known), point

    return problem


@pytest.mark.parametrize("unevenness", [-0.2, 0.0])
def test_rollers_that_rub_unevenly_are_named(
    unevenness: float, uneven: Callable[[float], tuple[Reduced, FloatArray]]
) -> None:
    problem, _ = uneven(unevenness)
    even = replace(problem, unknowns=problem.unknowns[:-1])
    found = strained([even], optima(even)[0].theta)
    if unevenness == 0.0:
        assert found is None
        return
    assert found is not None
    assert any(name.startswith("unevenness of the rollers") for name in (found.name, *found.others))


def test_slopes_of_uneven_rollers_agree_with_differences(
    uneven: Callable[[float], tuple[Reduced, FloatArray]],
) -> None:
    problem, point = uneven(0.1)
    slopes = problem.forces(point)[1]
    for place, value in enumerate(point):
        step = np.zeros(len(point))
        step[place] = 1e-6 * abs(value)
        difference = problem.forces(point + step)[0] - problem.forces(point - step)[0]
        expected = difference / (2.0 * step[place])
        np.testing.assert_allclose(slopes[:, place], expected, rtol=1e-4, atol=1e-5)
