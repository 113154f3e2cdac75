"""Computes how the rollers' lateral friction loads the guide and the wheel's bearings.

Symbols as in lugre.md section 2, items 6 to 11. The friction of the rollers at the lateral speed
v_z is G = s F_N with s = mu_R_dry S(v_z) + mu_R_vis v_z, S(u) = tanh(u / 1 mm/s), as long as both
rows of rollers carry load. The guide carries |F_G| + |F_H| = max(|G|, |M_D| / h) with
M_D = F_N (d - e) - G c, the bearings |F_A| + |F_B|. Both are given relative to the load without
lateral motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np

from rigd.analysis.result import FloatArray

SMOOTH_M_S = 1e-3  #: speed over which dry friction turns its sign
#: Loop gain 2 |s| c / j of Eqs. 22, 25 and 26 beyond which they are not followed: at 1 they lock.
MOST_GAIN = 0.98
#: Parameters of the coupling, in this order; SI. `lever` is |d - e|.
NAMES = (
    "mu_R_dry", "mu_R_vis", "guide_lever", "guide_height", "guide_half_span", "row_distance",
    "mass_offset",
)  # fmt: skip
DRY, VISCOUS, LEVER, HEIGHT, HALF_SPAN, ROW_DISTANCE, MASS_OFFSET = range(len(NAMES))


class LiftedRows(Enum):
    """The friction of a row of rollers that the lateral force has lifted."""

    PRINTED = "a lifted row rubs as if pressed on: |F_r| of Eq. 26 as printed"
    PHYSICAL = "a lifted row does not rub: max(F_r, 0) in Eq. 26"


@dataclass(frozen=True)
class Shape:
    """What the coupling depends on and no recording determines better than a caliper; SI.

    ``lever_sign`` is the sign of d - e. ``wheel_radius``, ``spacing`` (a) and ``overhang`` (b) are
    those of Eq. 48.
    """

    lever_sign: float
    wheel_radius: float
    spacing: float
    overhang: float
    rows: LiftedRows = LiftedRows.PRINTED


@dataclass(frozen=True, eq=False)
class Load:
    """Load of guide and bearings over that without lateral motion, (n,); derivatives (n, 7)."""

    guide: FloatArray
    bearing: FloatArray
    guide_by: FloatArray
    bearing_by: FloatArray


def roller_friction(speed_m_s: FloatArray, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return s (n,) at lateral speeds (n,) and its derivatives (n, 7); item 8."""
    sign = np.tanh(speed_m_s / SMOOTH_M_S)
    by = np.zeros((len(speed_m_s), len(NAMES)))
    by[:, DRY], by[:, VISCOUS] = sign, speed_m_s
    return theta[DRY] * sign + theta[VISCOUS] * speed_m_s, by


def loop_gain(s: FloatArray, theta: FloatArray) -> FloatArray:
    """Return the gain 2 |s| c / j of the algebraic loop of Eqs. 22, 25 and 26, (n,)."""
    return np.asarray(2.0 * np.abs(s) * theta[HEIGHT] / theta[ROW_DISTANCE])


def lateral_force(
    speed_m_s: FloatArray, theta: FloatArray, rows: LiftedRows
) -> tuple[FloatArray, FloatArray]:
    """Return G / F_N (n,) and its derivatives (n, 7) to ``theta`` (7,); item 9.

    As printed, a row whose F_r turns negative adds |F_r|: G then solves a loop, in closed form
    G / F_N = s (j + 2 k) / (j - 2 s c) for the first row, with -s for the second.
    """
    s, s_by = roller_friction(speed_m_s, theta)
    if rows is LiftedRows.PHYSICAL:
        return s, s_by
    c, j, k = theta[HEIGHT], theta[ROW_DISTANCE], theta[MASS_OFFSET]
    first, second = -k - s * c < 0.0, k + j + s * c < 0.0
    lifted = first | second
    towards = np.where(second, -s, s)  # the two rows mirror one another
    free = loop_gain(s, theta) < MOST_GAIN
    rest = np.where(free, j - 2.0 * towards * c, (1.0 - MOST_GAIN) * j)
    share = j + 2.0 * k
    force = towards * share / rest
    by = np.zeros_like(s_by)
    by_towards = share / rest + np.where(free, force * 2.0 * c / rest, 0.0)
    by_towards = np.where(second, -by_towards, by_towards)
    by[:, DRY], by[:, VISCOUS] = by_towards * s_by[:, DRY], by_towards * s_by[:, VISCOUS]
    by[:, HEIGHT] = np.where(free, force * 2.0 * towards / rest, 0.0)
    by[:, ROW_DISTANCE] = towards / rest - force / rest * np.where(free, 1.0, 1.0 - MOST_GAIN)
    by[:, MASS_OFFSET] = 2.0 * towards / rest
    return np.where(lifted, force, s), np.where(lifted[:, None], by, s_by)


def load(speed_m_s: FloatArray, theta: FloatArray, shape: Shape) -> Load:
    """Return the loads at lateral speeds (n,) with the coupling's parameters (7,), or (7, n).

    The guide's friction is measured without lateral motion, so that only the relative load counts
    (items 6 and 11): max(|G| h, |F_N (d - e) - G c|) / (F_N |d - e|).
    """
    force, force_by = lateral_force(speed_m_s, theta, shape.rows)
    lever, c, h = theta[LEVER], theta[HEIGHT], theta[HALF_SPAN]
    moment = shape.lever_sign * lever - force * c
    tilted = np.abs(moment) >= np.abs(force) * h
    turn, push = np.sign(moment), np.sign(force)
    guide = np.where(tilted, np.abs(moment), np.abs(force) * h) / lever
    by_force = np.where(tilted, -turn * c, push * h) / lever
    guide_by = by_force[:, None] * force_by
    guide_by[:, HEIGHT] += np.where(tilted, -turn * force / lever, 0.0)
    guide_by[:, HALF_SPAN] += np.where(tilted, 0.0, np.abs(force) / lever)
    guide_by[:, LEVER] += (np.where(tilted, turn * shape.lever_sign, 0.0) - guide) / lever

    a, b, r = shape.spacing, shape.overhang, shape.wheel_radius
    near, far = a + b - force * r, b - force * r
    bearing = (np.abs(near) + np.abs(far)) / (a + 2.0 * b)
    by_force = -r * (np.sign(near) + np.sign(far)) / (a + 2.0 * b)
    return Load(guide, bearing, guide_by, by_force[:, None] * force_by)
