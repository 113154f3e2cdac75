"""Computes what the laws with a bristle share, for one sample (compiled code).

With z the force of the bristle over the normal force, and V the slip, the bristle follows

    dz/dt = sigma_0 (V - |V| z / g(V))

g is the force at which it yields. If V is constant over a sample, z relaxes exactly towards
sign(V) g:

    z+ = s g + (z - s g) exp(-sigma_0 |V| dt / g)

See lugre.md section 5.
"""

from __future__ import annotations

import numpy as np

from rigd.analysis.friction import LawParameter
from rigd.analysis.kernel import kernel

STRIBECK_SPEED = LawParameter(
    "V_s", "m/s", 1e-4, 10.0, 0.05, symbol="V_s",
    meaning="slip at which the Stribeck effect has fallen to 1/e",
    advice="It needs slip both well below V_s and up to V_s itself.",
)  # fmt: skip
COULOMB = LawParameter(
    "mu_c", "1", 1e-4, 2.0, 0.1, symbol="μ_c",
    meaning="normalised Coulomb friction, g far above V_s",
    advice="It needs slip well beyond V_s, so that the Stribeck effect has died away.",
)  # fmt: skip
STIFFNESS = LawParameter(
    "sigma_0", "1/m", 0.1, 1e4, 30.0, symbol="σ_0", meaning="normalised bristle stiffness",
    advice="It needs slip that begins or reverses within the recording.",
)  # fmt: skip
DAMPING = LawParameter(
    "sigma_1", "s/m", 1e-4, 100.0, 0.3, symbol="σ_1", meaning="normalised bristle damping",
    advice="It needs slip that jumps.",
)  # fmt: skip
VISCOUS = LawParameter(
    "sigma_2", "s/m", 1e-3, 100.0, 2.0, symbol="σ_2", meaning="normalised viscous friction",
    advice="It needs a wider range of slip.",
)  # fmt: skip
FRICTION = LawParameter(
    "mu", "1", 1e-4, 2.0, 0.1, symbol="μ", meaning="normalised friction at any slip",
    advice="It needs slip that lasts.",
)  # fmt: skip


@kernel
def stribeck(v: float, v_s: float, mu_c: float, rise: float) -> tuple[float, float, float, float]:
    """Return g and its derivatives to V_s, mu_c and ln(mu_s/mu_c) at ``v``.

    g = mu_c + (mu_s - mu_c) exp(-sqrt|V / V_s|), the corrected Eq. 6 (a "+" is missing in the
    paper). ``rise`` = mu_s/mu_c - 1.
    """
    root = np.sqrt(abs(v) / v_s)
    decay = np.exp(-root)
    shape = 1.0 + rise * decay
    return (
        mu_c * shape,
        mu_c * rise * decay * root / (2.0 * v_s),
        shape,
        mu_c * (rise + 1.0) * decay,
    )


@kernel
def relax(
    z: float, g: float, sigma_0: float, v: float, dt: float
) -> tuple[float, float, float, float]:
    """Return ``z`` after ``dt`` s at the slip ``v`` in m/s; its derivatives to z, g and sigma_0."""
    if v == 0.0:
        return z, 1.0, 0.0, 0.0
    sign = 1.0 if v > 0.0 else -1.0
    rate = sigma_0 * abs(v) * dt / g
    e = np.exp(-rate)
    gap = z - sign * g
    return (
        sign * g + gap * e,
        e,
        sign * (1.0 - e) + gap * e * rate / g,
        -gap * e * rate / sigma_0,
    )
