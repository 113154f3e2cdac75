"""The rig with lateral coupling as a system of the estimator."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.lugre.lateral_bench import DRY, VISCOUS, LateralBench
from support.lugre.lateral_wrong import Sweep, lateral_system, right

from rigd.analysis.fitting.fit import fit
from rigd.analysis.output_error.thresholds import THRESHOLDS
from rigd.analysis.output_error.whitened_residuals import OutputErrorModel, noise_at
from rigd.analysis.result import FloatArray
from rigd_analyses.lugre.lateral.constants import LateralTrial
from rigd_analyses.lugre.lateral.coupling_fit.loads import FreeLoads
from rigd_analyses.lugre.lateral.family import ITERATIONS
from rigd_analyses.lugre.lateral.speeds.errors import cell, lacking_force, speeds
from rigd_analyses.lugre.lateral.starts import starts
from rigd_analyses.lugre.lateral.system import LateralSystem
from rigd_analyses.lugre.trials.known_constants import RigConstants
from rigd_analyses.lugre.trials.trial import LugreTrial

CHECKED = (
    "guide_friction", "no_load", "current_zero", "mu_R_dry", "mu_R_vis", "guide_lever",
    "guide_height", "guide_half_span", "row_distance", "mass_offset", "first_bristle",
)  # fmt: skip


@pytest.fixture(scope="module")
def system(
    fast: list[LateralTrial], lateral_bench: LateralBench, rig: RigConstants
) -> LateralSystem:
    return lateral_system(fast, lateral_bench.constants, rig)


@pytest.fixture(scope="module")
def mirrored(
    fast: list[LateralTrial], lateral_bench: LateralBench, rig: RigConstants
) -> LateralSystem:
    """Return the same trials driven backwards, with the same lateral speeds."""
    turned = [replace(item, trial=backwards(item.trial)) for item in fast]
    return lateral_system(turned, lateral_bench.constants, rig)


def backwards(trial: LugreTrial) -> LugreTrial:
    return replace(
        trial,
        current_a=-trial.current_a,
        wheel_angle_rad=-trial.wheel_angle_rad,
        carriage_position_m=-trial.carriage_position_m,
        acceleration_m_s2=-trial.acceleration_m_s2,
        motor_current_a=-trial.motor_current_a,
    )


@pytest.fixture(scope="module")
def point(system: LateralSystem) -> FloatArray:
    """Return parameters of one trial, with the true friction of the rollers."""
    start = {item.parameter.name: item.parameter.start for item in (*system.shared, *system.local)}
    return np.array(list((start | {"mu_R_dry": DRY, "mu_R_vis": VISCOUS}).values()))


@pytest.mark.parametrize("trial", [1, 3], ids=["fast and positive", "fast and negative"])
def test_sensitivities_agree_with_differences(
    trial: int, system: LateralSystem, point: FloatArray
) -> None:
    count = len(system.shared)

    def outputs(values: FloatArray) -> FloatArray:
        return system.simulate(trial, values[:count], values[count:])

    predicted, exact = system.linearise(trial, point[:count], point[count:])
    np.testing.assert_allclose(predicted, outputs(point), atol=1e-12)
    names = [item.parameter.name for item in (*system.shared, *system.local)]
    for name in CHECKED:
        column = names.index(name)
        step = 1e-6 * max(abs(point[column]), 1e-3)
        up, down = point.copy(), point.copy()
        up[column] += step
        down[column] -= step
        difference = (outputs(up) - outputs(down)) / (2.0 * step)
        for output in range(3):
            scale = float(np.max(np.abs(difference[:, output])))
            np.testing.assert_allclose(
                exact[:, output, column], difference[:, output], atol=1e-3 * scale, err_msg=name
            )


def test_ignored_lateral_force_equals_straight_rig(
    system: LateralSystem, point: FloatArray
) -> None:
    """Without lateral force the guide's friction is the stated one, at any lateral speed."""
    shared, local = np.split(point, [len(system.shared)])
    straight = shared[: len(system.rig.shared)]
    np.testing.assert_allclose(
        system.ignoring(2, shared, local), system.rig.simulate(2, straight, local)
    )


def test_backward_drive_mirrors_effects_of_load(
    system: LateralSystem, mirrored: LateralSystem, point: FloatArray
) -> None:
    shared, local = np.split(point, [len(system.shared)])
    (forwards, torque), (back, same) = system.besides(2, shared), mirrored.besides(2, shared)
    assert np.ptp(forwards) > 0.0
    np.testing.assert_allclose(back, -forwards, atol=1e-12)
    assert same == torque
    errors = [speeds(item, shared, local, 2) for item in (system, mirrored)]
    plus, minus = (item.measured - item.ignored for item in errors)
    assert lacking_force(minus, mirrored, 2) == pytest.approx(
        lacking_force(plus, system, 2), rel=1e-2
    )


def test_backward_drive_has_error_of_forward_one(
    system: LateralSystem, mirrored: LateralSystem, fast: list[LateralTrial], point: FloatArray
) -> None:
    shared, local = np.split(point, [len(mirrored.shared)])
    forwards = cell(fast[0], 0.65, speeds(system, shared, local, 0)).error_ignored_m_s
    trial = replace(fast[0], trial=backwards(fast[0].trial))
    back = cell(trial, 0.65, speeds(mirrored, shared, local, 0)).error_ignored_m_s
    assert forwards > 0.01
    assert back == pytest.approx(forwards, rel=1e-2)


def test_starts_suit_a_floor_of_little_friction() -> None:
    """Paperboard, mu_c 0.05: from 0.1 the best of rough fits had frictions that are 1.9 N off."""
    sweep = right(5)
    system = lateral_system(sweep.trials(), sweep.bench.constants, sweep.rig)
    free, ends = FreeLoads.of(system), []
    for start in starts(system):
        model = OutputErrorModel(free, noise_at(free, start))
        ended = fit(
            model, start, max_iterations=ITERATIONS, relative_decrease=THRESHOLDS.min_decrease_rough
        )
        ends.append((ended.cost - sum(noise.log_scale for noise in model.noise), ended.theta))
    _, theta = min(ends, key=lambda end: end[0])
    found = theta[len(free.shared) :].reshape(len(system.speeds), -1)[:, -1]
    true = {0.2: (0.18, 0.54), 0.5: (0.13, 0.59)}  # N, to either side
    expected = [true[abs(v)][v < 0.0] for v in _asked(sweep)]
    assert np.max(np.abs(found - expected)) < 0.6


def _asked(sweep: Sweep) -> list[float]:
    return [sign * v for sign in (1, -1) for v in sweep.speeds for _ in sweep.currents]
