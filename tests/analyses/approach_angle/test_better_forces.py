"""The balances of forces and moments of angle.md section 1, with numbers put in by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rigd_analyses.approach_angle.better.forces import demanded_force, drag_torque, rolling_force
from rigd_analyses.approach_angle.better.motion import Means
from rigd_analyses.approach_angle.raw.run_data import AngleRig

#: One block: N, w, dw/dt, V, and the F_r that the contact gives, at 30 degrees.
NORMAL_N, WHEEL_RAD_S, WHEEL_RAD_S2, SPEED_M_S, ROLLING_N = 58.86, 40.0, 25.0, 1.2, 20.0
ALPHA = math.radians(30.0)


def means(normal_n: float = NORMAL_N, acceleration_m_s2: float = 0.0) -> Means:
    """Return one block; what the forces do not depend on is NaN."""
    unknown = np.full(1, np.nan)
    return Means(
        t_s=unknown,
        gauges_v=unknown,
        normal_force_n=np.full(1, normal_n),
        wheel_speed_rad_s=np.full(1, WHEEL_RAD_S),
        wheel_acceleration_rad_s2=np.full(1, WHEEL_RAD_S2),
        platform_travel_m=unknown,
        platform_speed_m_s=np.full(1, SPEED_M_S),
        platform_acceleration_m_s2=np.full(1, acceleration_m_s2),
        sliding_speed_m_s=unknown,
        slid_m=unknown,
        turn=np.full((1, 2), np.nan),
    )


def test_the_torque_holds_inertia_bearings_and_rolling_resistance(rig: AngleRig) -> None:
    bearings = 0.012 + 2e-4 * WHEEL_RAD_S + 1e-4 * NORMAL_N
    others = 4e-4 * WHEEL_RAD_S2 + bearings + 0.006 * NORMAL_N * 0.05
    assert drag_torque(means(), rig) == pytest.approx(others)
    torque = np.full(1, others + 0.995 * 0.05 * ROLLING_N)
    assert rolling_force(torque, means(), rig) == pytest.approx(ROLLING_N)


@pytest.mark.parametrize("normal_n", [NORMAL_N, 20.0])  # more, and less, than the platform weighs
def test_motion_asks_for_force_that_drives_it(rig: AngleRig, normal_n: float) -> None:
    axial = 0.05 * normal_n
    across = ROLLING_N * math.sin(ALPHA) + axial * math.cos(ALPHA)
    rails = 0.6 + 0.01 * (abs(normal_n - 3.0 * 9.81) + across) + 0.3 * SPEED_M_S
    along = ROLLING_N * math.cos(ALPHA) - axial * math.sin(ALPHA) - rails
    moved = means(normal_n, acceleration_m_s2=along / 3.0)
    asked = demanded_force(np.full(1, ROLLING_N), moved, rig, ALPHA)
    assert asked == pytest.approx(ROLLING_N)
