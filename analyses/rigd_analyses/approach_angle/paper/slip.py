"""Slip and relative speed over the steady segment: the paper's Eq. 11 and 12, and corrected.

The paper's slip refers w R to V and so holds for alpha = 0: a wheel that rolls without slip at
45 degrees has V cos(alpha) = w R and slips "-0.293". It divides by a V that starts at 0, hence
the gate V > 0, and is a mean of ratios. The corrected one is a ratio of means and is 0 for a
rolling wheel at any angle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigd_analyses.approach_angle.data import FloatArray


@dataclass(frozen=True)
class Slip:
    """Means over a segment: the paper's slip, the corrected one, w R - V in m/s."""

    paper: float
    corrected: float
    relative_speed_m_s: float


def mean_slip(rim_m_s: FloatArray, platform_m_s: FloatArray, alpha_rad: float) -> Slip:
    """Return the means of samples (n,) that all have V = ``platform_m_s`` > 0; n > 0."""
    relative = rim_m_s - platform_m_s
    return Slip(
        paper=float(np.mean(relative / platform_m_s)),
        corrected=float(np.mean(rim_m_s) / (np.mean(platform_m_s) * np.cos(alpha_rad)) - 1.0),
        relative_speed_m_s=float(np.mean(relative)),
    )
