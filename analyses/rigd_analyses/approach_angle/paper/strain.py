"""From two gauges on a shaft to its torque: the paper's Eq. 4 to 6, corrected.

The gauges lie at +45 and -45 degrees to the axis and read

    eps_a = eps_x cos^2 + eps_y sin^2 + gamma sin cos
    eps_b = eps_x sin^2 + eps_y cos^2 - gamma sin cos

of which the paper prints the second with a plus, which makes their difference zero. At 45 degrees
it is gamma = eps_a - eps_b (Eq. 5) whatever the strains of bending: the engineering shear strain,
twice the tensor's. T = gamma G J/r_s (Eq. 6) takes the radius of the SHAFT. All of it is linear:
on the signals, or on the coefficients of their series as the paper has it, is the same.
"""

from __future__ import annotations

from rigd_analyses.approach_angle.data import FloatArray


def torque_nm(gauge_a: FloatArray, gauge_b: FloatArray, scale: float) -> FloatArray:
    """Return the torque in N m from both gauges, and ``scale`` in N m per unit of a - b.

    In amplifier volts it is K_T = m g L/d(V_a - V_b) of the calibration, which G J/(r_s S) with
    the S of the amplifier in V per strain only expects; in strain it is G J/r_s.
    """
    return scale * (gauge_a - gauge_b)
