"""Tests whether the residuals of the fit of a lateral sweep depend on the lateral speed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import f as f_distribution

from rigd.analysis.result import FloatArray

LEVEL = 1e-3  #: of a right model, one sweep in a thousand is called structured


@dataclass(frozen=True)
class Structure:
    """One-way analysis of variance of the lacking forces, grouped by lateral speed.

    ``worst_n`` is the mean force that the model lacks at ``worst_m_s``, ``scatter_n`` the standard
    deviation of a trial within its group.
    """

    p_value: float
    worst_n: float
    worst_m_s: float
    scatter_n: float

    @property
    def sentence(self) -> str:
        """Return a sentence if the forces follow the lateral speed, else nothing."""
        if self.p_value >= LEVEL:
            return ""
        return (
            f"what it leaves of the carriage's speed follows the lateral speed: at "
            f"{self.worst_m_s:+.2f} m/s it lacks {1e3 * self.worst_n:+.1f} mN along the guide, "
            f"trials set alike differ by {1e3 * self.scatter_n:.1f} mN. Check guide_lever, "
            "guide_height, row_distance and mass_offset."
        )


def structure(forces_n: FloatArray, groups_m_s: Sequence[float]) -> Structure | None:
    """Return the test of the forces (trials,) by their lateral speeds; None if none is repeated."""
    by_speed: dict[float, list[float]] = {}
    for force, speed in zip(forces_n, groups_m_s, strict=True):
        by_speed.setdefault(speed, []).append(float(force))
    inside = len(forces_n) - len(by_speed)
    if len(by_speed) < 2 or inside < 1:
        return None
    means = {speed: float(np.mean(forces)) for speed, forces in by_speed.items()}
    within = sum(float(np.sum((np.array(f) - means[speed]) ** 2)) for speed, f in by_speed.items())
    variance = within / inside
    if not variance > 0.0:
        return None
    # Against zero, not against their mean: what all trials lack is no less a misfit.
    between = sum(len(forces) * means[speed] ** 2 for speed, forces in by_speed.items())
    statistic = between / len(by_speed) / variance
    worst = max(means, key=lambda speed: abs(means[speed]))
    return Structure(
        float(f_distribution.sf(statistic, len(by_speed), inside)),
        means[worst], worst, float(np.sqrt(variance)),
    )  # fmt: skip
