"""Finds where the torque peak ends and the steady segment begins, by a Gaussian fit (paper, Eq. 9).

Height and centre of the Gaussian are the largest torque and its time. The module fits only sigma,
by least squares over the times within 0.1 (t_M - t_0) of the peak. That window nearly always begins
before the record; the module clips it at the ends of the record.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from rigd_analyses.approach_angle.raw.run_data import FloatArray

#: Bounds of the fit as multiples of the window: beyond them the peak is a spike or no peak at all.
NARROWEST, WIDEST = 1e-3, 1e3


@dataclass(frozen=True)
class Peak:
    """A Gaussian fitted to the peak of a torque; ``window`` are the samples used for the fit."""

    height_nm: float
    time_s: float
    sigma_s: float
    index: int
    window: slice

    def at(self, t_s: FloatArray) -> FloatArray:
        """Return the Gaussian at the times ``t_s``, in N m."""
        return self.height_nm * np.exp(-0.5 * ((t_s - self.time_s) / self.sigma_s) ** 2)


def fit_peak(t_s: FloatArray, torque_nm: FloatArray, share: float) -> Peak:
    """Fit sigma to ``torque_nm`` (n,) within ``share`` of the record on either side of its peak.

    A torque that does not fall off gives a sigma far beyond the record; its caller must check.
    """
    index = int(np.argmax(torque_nm))
    height, time = float(torque_nm[index]), float(t_s[index])
    reach = share * float(t_s[-1] - t_s[0])
    window = slice(
        int(np.searchsorted(t_s, time - reach, side="left")),
        int(np.searchsorted(t_s, time + reach, side="right")),
    )
    offset, torque = t_s[window] - time, torque_nm[window]

    def gaussian(log_sigma: FloatArray) -> FloatArray:
        return height * np.exp(-0.5 * (offset / np.exp(log_sigma)) ** 2)

    def residuals(log_sigma: FloatArray) -> FloatArray:
        return gaussian(log_sigma) - torque

    def jacobian(log_sigma: FloatArray) -> FloatArray:
        return (gaussian(log_sigma) * (offset / np.exp(log_sigma)) ** 2)[:, None]

    found = least_squares(
        residuals, [np.log(0.5 * reach)], jacobian,
        bounds=(np.log(NARROWEST * reach), np.log(WIDEST * reach)), xtol=1e-12, ftol=1e-12,
    )  # fmt: skip
    return Peak(height, time, float(np.exp(found.x[0])), index, window)
