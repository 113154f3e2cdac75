"""The rig with lateral coupling as a system of the estimator."""

from __future__ import annotations

import numpy as np
import pytest

from rigd.analysis.result import FloatArray
from rigd_analyses.lugre.lateral.identify import LateralFound

CHECKED = (
    "guide_friction", "no_load", "current_zero", "mu_R_dry", "mu_R_vis", "guide_lever",
    "guide_height", "guide_half_span", "row_distance", "mass_offset", "first_bristle",
)  # fmt: skip


@pytest.mark.parametrize("trial", [4, 10], ids=["fast and positive", "fast and negative"])
def test_sensitivities_agree_with_differences(found: LateralFound, trial: int) -> None:
    system = found.system
    count = len(system.shared)
    point = np.concatenate([found.shared, found.local(trial)])

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


def test_ignored_lateral_force_equals_straight_rig(found: LateralFound) -> None:
    """Without lateral force the guide's friction is the stated one, at any lateral speed."""
    system, local = found.system, found.local(2)
    straight = found.shared[: len(system.rig.shared)]
    np.testing.assert_allclose(
        system.ignoring(2, found.shared, local), system.rig.simulate(2, straight, local)
    )
