"""Computes the force in the contact from the gauge torque, and the force that the motion demands.

The equations are those of angle.md section 1, in the frame of the wheel (e_r is the rolling
direction, e_a the axial one; the rollers spin about e_r):

    I dw/dt = T - T_b(w, N) - C_rr N R - R_eff F_r,    T_b = b0 + b1 |w| + bN N
    m a = F_r cos(alpha) - F_a sin(alpha) - F_rail,    F_a = mu_a N
    F_rail = c0 + c_N (|N - m g| + |F_y|) + c_v V,     F_y = F_r sin(alpha) + F_a cos(alpha)

All arrays are block means of shape (n,), SI.
"""

from __future__ import annotations

import numpy as np

from rigd_analyses.approach_angle.better.motion import Means
from rigd_analyses.approach_angle.raw.run_data import AngleRig, FloatArray


def bearing_torque(means: Means, rig: AngleRig) -> FloatArray:
    """Return T_b in N m, between the gauges and the wheel."""
    return np.asarray(
        rig.bearing_constant.value
        + rig.bearing_viscous.value * np.abs(means.wheel_speed_rad_s)
        + rig.bearing_load.value * means.normal_force_n
    )


def drag_torque(means: Means, rig: AngleRig) -> FloatArray:
    """Return all of the torque at the gauges that is not R_eff F_r, N m."""
    rolling = rig.rolling_resistance.value * means.normal_force_n * rig.wheel_radius_m
    inertia = rig.wheel_inertia * means.wheel_acceleration_rad_s2
    return np.asarray(inertia + bearing_torque(means, rig) + rolling)


def rolling_force(torque_nm: FloatArray, means: Means, rig: AngleRig) -> FloatArray:
    """Return F_r in N from the torque at the gauges."""
    radius = rig.effective_radius.value * rig.wheel_radius_m
    return np.asarray((torque_nm - drag_torque(means, rig)) / radius)


def demanded_force(force_n: FloatArray, means: Means, rig: AngleRig, alpha: float) -> FloatArray:
    """Return the F_r in N that the platform's motion asks for; ``force_n`` only loads the rails."""
    normal = means.normal_force_n
    axial = rig.roller_drag.value * normal
    across = np.abs(force_n * np.sin(alpha) + axial * np.cos(alpha))
    weight = rig.platform_mass_kg * rig.gravity
    rails = (
        rig.rail_constant.value
        + rig.rail_load.value * (np.abs(normal - weight) + across)
        + rig.rail_viscous.value * means.platform_speed_m_s
    )
    push = rig.platform_mass_kg * means.platform_acceleration_m_s2 + rails + axial * np.sin(alpha)
    return np.asarray(push / np.cos(alpha))
