"""Computes the torque of a shaft from its two strain gauges (paper, Eq. 4 to 6, corrected).

The gauges are at +45 and -45 degrees to the axis and measure

    eps_a = eps_x cos^2 + eps_y sin^2 + gamma sin cos
    eps_b = eps_x sin^2 + eps_y cos^2 - gamma sin cos

The paper prints a plus in the second equation, which makes their difference zero. At 45 degrees
gamma = eps_a - eps_b (Eq. 5), for any bending strains. gamma is the engineering shear
strain, twice that of the tensor. In T = gamma G J/r_s (Eq. 6), r_s is the radius of the SHAFT. All
equations are linear: they give the same result on the signals and on the coefficients of their
Fourier series, which the paper uses.
"""

from __future__ import annotations

from rigd_analyses.approach_angle.raw.run_data import FloatArray


def torque_nm(gauge_a: FloatArray, gauge_b: FloatArray, scale: float) -> FloatArray:
    """Return the torque in N m from both gauges, and ``scale`` in N m per unit of a - b.

    In amplifier volts it is K_T = m g L/d(V_a - V_b) of the calibration, which G J/(r_s S) with
    the S of the amplifier in V per strain only expects; in strain it is G J/r_s.
    """
    return scale * (gauge_a - gauge_b)
