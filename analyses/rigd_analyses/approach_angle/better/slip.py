"""Computes the paper's slip and the corrected slip of one run, from smoothed speeds."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rigd_analyses.approach_angle.better.motion import Motion
from rigd_analyses.approach_angle.better.settings import BetterSettings
from rigd_analyses.approach_angle.raw.run_data import Regime
from rigd_analyses.approach_angle.regime import regime_of

NAN = float("nan")


@dataclass(frozen=True)
class Slip:
    """Means over the steady part of a run; NaN if the platform does not move."""

    paper: float
    corrected: float
    corrected_u: float
    relative_speed_m_s: float
    regime: Regime


def mean_slip(motion: Motion, settings: BetterSettings) -> Slip:
    """Return both slips as ratios of means over the steady part, and the regime there."""
    run, calibration, rig = motion.known.run, motion.known.calibration, motion.known.rig
    rim = rig.wheel_radius_m * motion.wheel_speed_rad_s
    rolling = rig.effective_radius.value * rim
    along = motion.platform_speed_m_s * math.cos(run.alpha_rad)
    moving = along > settings.sliding_speed_m_s
    if not np.any(moving):
        return Slip(NAN, NAN, NAN, float(np.mean(rim - motion.platform_speed_m_s)), Regime.SLIDING)
    rim, rolling, along = rim[moving], rolling[moving], along[moving]
    speed = motion.platform_speed_m_s[moving]
    ratio = float(np.mean(rolling) / np.mean(along))
    # Neighbouring samples of a smoothed speed repeat each other over half a period of its cut-off.
    seconds = float(np.count_nonzero(moving)) * float(np.median(np.diff(motion.steady_t_s)))
    independent = max(1.0, 2.0 * settings.wheel_cutoff_hz * seconds)
    parts = (
        rig.effective_radius.u / rig.effective_radius.value,
        calibration.wheel.u / calibration.wheel.value,
        calibration.platform.u / calibration.platform.value,
        settings.angle_u_rad * math.tan(run.alpha_rad),
        motion.speed_u_m_s / (float(np.mean(speed)) * math.sqrt(independent)),
        motion.speed_u_m_s / (float(np.mean(rim)) * math.sqrt(independent)),
    )
    return Slip(
        paper=float(np.mean(rim) / np.mean(speed) - 1.0),
        corrected=ratio - 1.0,
        corrected_u=ratio * math.hypot(*parts),
        relative_speed_m_s=float(np.mean(rim - speed)),
        regime=regime_of(rolling / along - 1.0),
    )
