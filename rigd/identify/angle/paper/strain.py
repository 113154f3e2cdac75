"""From two gauges on a shaft to its torque: the paper's Eq. 4 to 6, corrected.

The two gauges lie at +45 and -45 degrees to the axis. Eq. 4 as printed has the same sign of the
shear term in both rows, which makes the difference of Eq. 5 zero at 45 degrees; the second is
negative. The shear strain is the engineering one (the tensor's is half of it).
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np

from rigd.identify.angle.data import FloatArray

#: A number, a signal, or the coefficients of a series: all below is linear.
Linear = TypeVar("Linear", float, FloatArray)

GAUGE_ANGLE_RAD = np.pi / 4.0


def gauge_strains(
    eps_x: float, eps_y: float, gamma_xy: float, theta_rad: float = GAUGE_ANGLE_RAD
) -> tuple[float, float]:
    """Return what gauges at ``theta_rad`` and at right angles to it read: Eq. 4, corrected."""
    cos, sin = np.cos(theta_rad), np.sin(theta_rad)
    return (
        float(eps_x * cos**2 + eps_y * sin**2 + gamma_xy * cos * sin),
        float(eps_x * sin**2 + eps_y * cos**2 - gamma_xy * cos * sin),
    )


def shear(gauge_a: Linear, gauge_b: Linear) -> Linear:
    """Return gauge a - gauge b: at 45 degrees the shear strain, free of bending (Eq. 5).

    In the unit of the gauges, strain or amplifier volts.
    """
    return gauge_a - gauge_b


def torque_scale(
    torsional_rigidity_nm2: float, shaft_radius_m: float, volts_per_strain: float
) -> float:
    """Return K_T = G J/(r_s S) in N m per V of (V_a - V_b), from Eq. 6 with the SHAFT's radius.

    What a calibration with a known mass on a known arm measures, m g L/d(V_a - V_b), and is
    expected to find.
    """
    return torsional_rigidity_nm2 / (shaft_radius_m * volts_per_strain)
