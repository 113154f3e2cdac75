"""Fits a Fourier series of whole hertz to a signal by least squares (paper, Eq. 7 and 8).

Corrections to the paper: the sum is over both terms; i = 0..M-1; the columns of b_0 are left out,
because they are zero and make the printed system singular. The series keeps LOW frequencies only
(the text of the paper has "high").

The fit is a 19 Hz filter only for a record of 1 s. For a record of 0.3 to 0.6 s the basis is nearly
dependent:

- the coefficients reach 1e7 to 1e11 V and cancel. The module uses float64 throughout; no
  coefficient may be rounded, or printed and read back;
- a_0 is not the mean;
- the noise at the edges is 5 to 6 times the noise in the middle.

The curve within the record, and its mean, are good nevertheless.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigd_analyses.approach_angle.raw.run_data import FloatArray


@dataclass(frozen=True, eq=False)
class FourierFit:
    """``k`` series over the same times: ``basis`` (n, 2 N + 1), ``coefficients`` (2 N + 1, k)."""

    basis: FloatArray
    coefficients: FloatArray

    @property
    def curves(self) -> FloatArray:
        """The fitted signals (n, k)."""
        return self.basis @ self.coefficients


def fourier_basis(t_s: FloatArray, highest_hz: int) -> FloatArray:
    """Return cos(2 pi k t) for k = 0..N, then sin(2 pi k t) for k = 1..N: (n, 2 N + 1)."""
    turns = np.vander(np.exp(2j * np.pi * t_s), highest_hz + 1, increasing=True)
    return np.hstack([turns.real, turns.imag[:, 1:]])


def fit_fourier(
    t_s: FloatArray, signals: FloatArray, *, highest_hz: int, rcond: float
) -> FourierFit:
    """Fit ``signals`` (n, k) over the times ``t_s`` (n,).

    The solution of least norm; singular values below ``rcond`` of the largest count as zero.
    """
    basis = fourier_basis(t_s, highest_hz)
    coefficients = np.linalg.lstsq(basis, signals, rcond=rcond)[0]
    return FourierFit(basis, np.asarray(coefficients, dtype=np.float64))
