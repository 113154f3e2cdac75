"""Checks the force balance: flags runs in which gauges and motion of the platform disagree.

Some torque may be lost between gauges and wheel (bad clamping, 0.1 N m and more). It looks like
friction: such runs gave the paper a maximum of 0.5324 while 0.1868 was true. The lost torque moves
nothing, so the balance of forces on the platform has a residual:

    residual = (F_gauge - [m a + F_rail + F_a sin(alpha)]/cos(alpha))/N

Neither outliers nor repeats show the loss as well (angle.md 3.5).

The limit of the residual is its own uncertainty, propagated from the budget of F_r and from the
calibration of rails and rollers. The better these are known, the smaller the limit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rigd_analyses.approach_angle.better.forces import demanded_force
from rigd_analyses.approach_angle.better.motion import Motion
from rigd_analyses.approach_angle.better.result import BalanceRow
from rigd_analyses.approach_angle.better.settings import BetterSettings
from rigd_analyses.approach_angle.budget import Budget
from rigd_analyses.approach_angle.raw.run_data import FloatArray


@dataclass(frozen=True)
class Balance:
    """Signed residual and the limit of its size, N per N of load.

    It is positive if the gauges show more than the motion needs.
    """

    residual: float
    limit: float
    row: BalanceRow


def force_balance(
    torque: FloatArray,
    force: FloatArray,
    motion: Motion,
    budget: Budget,
    settings: BetterSettings,
) -> Balance:
    """Return the balance of F_r = ``force`` (n,) in N, in the mean over all steady blocks.

    ``torque`` (n,) in N m is the one at the gauges, ``budget`` that of <F_r>/<N> over the same
    blocks.
    """
    known, means = motion.known, motion.means
    normal = float(np.mean(means.normal_force_n))
    needed = demanded_force(force, means, known.rig, known.run.alpha_rad)
    residual = float(np.mean(force - needed))
    u = math.hypot(budget.mu * budget.force, _needed_u(force, motion, settings) / normal)
    row = BalanceRow(
        residual_n=residual,
        normal_n=normal,
        torque_nm=float(np.mean(torque)),
        force_n=float(np.mean(force)),
        wheel_speed_rad_s=float(np.mean(means.wheel_speed_rad_s)),
        platform_speed_m_s=float(np.mean(means.platform_speed_m_s)),
        push_n=known.rig.platform_mass_kg * float(np.mean(means.platform_acceleration_m_s2)),
        on_rails_n=_on_rails(force, motion),
        push_u_n=_push_u(motion, settings),
    )
    return Balance(residual / normal, settings.balance_coverage * u, row)


def _push_u(motion: Motion, settings: BetterSettings) -> float:
    """Return the standard uncertainty in N of m a beside that of its scale.

    The mean acceleration is the change of speed, uncertain at both ends, over the time.
    """
    means = motion.means
    ends = math.sqrt(2.0) * math.hypot(
        motion.speed_u_m_s,
        settings.linearity_u * float(np.max(np.abs(means.platform_speed_m_s))),
    )
    return motion.known.rig.platform_mass_kg * ends / (settings.block_s * means.t_s.size)


def _on_rails(force: FloatArray, motion: Motion) -> float:
    """Return the mean load of the rails in N."""
    rig, alpha = motion.known.rig, motion.known.run.alpha_rad
    normal = float(np.mean(motion.means.normal_force_n))
    across = float(np.mean(force)) * math.sin(alpha)
    across += rig.roller_drag.value * normal * math.cos(alpha)
    return abs(normal - rig.platform_mass_kg * rig.gravity) + abs(across)


def _needed_u(force: FloatArray, motion: Motion, settings: BetterSettings) -> float:
    """Return the standard uncertainty in N of the mean force that the motion needs."""
    known, means, rig = motion.known, motion.means, motion.known.rig
    alpha = known.run.alpha_rad
    normal, speed = float(np.mean(means.normal_force_n)), means.platform_speed_m_s
    inertia = rig.platform_mass_kg * abs(float(np.mean(means.platform_acceleration_m_s2)))
    platform = known.calibration.platform
    return math.hypot(
        rig.rail_constant.u,
        rig.rail_load.u * _on_rails(force, motion),
        rig.rail_viscous.u * float(np.mean(speed)),
        rig.roller_drag.u * normal * math.sin(alpha),
        inertia * platform.u / platform.value,
        _push_u(motion, settings),
    ) / math.cos(alpha)
