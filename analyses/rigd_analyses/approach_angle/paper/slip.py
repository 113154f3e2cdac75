"""Computes slip and relative speed over the steady segment (paper, Eq. 11 and 12, and corrected).

The paper's slip relates w R to V. This is correct for alpha = 0 only: a wheel that rolls without
slip at 45 degrees has V cos(alpha) = w R and a slip of "-0.293". The paper divides by V, which
starts at 0; the analysis therefore uses samples with V > 0 only. The paper's slip is a mean of
ratios. The corrected slip is a ratio of means; it is 0 for a rolling wheel at any angle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigd_analyses.approach_angle.raw.run_data import FloatArray


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
