"""Slip and relative speed over the steady segment: the paper's Eq. 11 and 12, and corrected.

The paper's slip refers w R to V and so holds for alpha = 0: a wheel that rolls without slip at
45 degrees has V cos(alpha) = w R and slips "-0.293". It divides by a V that starts at 0, hence
the gate V > 0, and is a mean of ratios. The corrected one is a ratio of means and is 0 for a
rolling wheel at any angle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigd.identify.angle.data import FloatArray


@dataclass(frozen=True)
class Slip:
    """Means over a segment: the paper's slip, the corrected one, w R - V in m/s."""

    paper: float
    corrected: float
    relative_speed_m_s: float


NOT_MOVING = Slip(float("nan"), float("nan"), float("nan"))


def mean_slip(rim_m_s: FloatArray, platform_m_s: FloatArray, alpha_rad: float) -> Slip:
    """Return the means where V > 0; NaN all of them where it never is. Both arrays (n,) in m/s."""
    moving = platform_m_s > 0.0
    if not np.any(moving):
        return NOT_MOVING
    rim, platform = rim_m_s[moving], platform_m_s[moving]
    relative = rim - platform
    return Slip(
        paper=float(np.mean(relative / platform)),
        corrected=float(np.mean(rim) / (np.mean(platform) * np.cos(alpha_rad)) - 1.0),
        relative_speed_m_s=float(np.mean(relative)),
    )
