"""Computes the interval of a quantity from three contributions: chance, method and ridge.

The quantity is any function of the parameters (a parameter itself, g at one slip).

- chance: the larger of two standard errors, that of the sandwich covariance, which holds for
  correlated residuals, and that of the jackknife over whole trials;
- method: the root mean square change of the quantity when the filter window is 10 ms shorter or
  longer; it represents the effect of the smoothing, and of the vibration that the filter passes;
- ridge: the range of the quantity over all parameter sets that the profiles of V_s, mu_c, mu_s and
  mu_s/mu_c accept. A covariance does not show this range: it describes the cost only near the
  estimate, and the cost is not a parabola there.

The 95 % interval adds the three in quadrature, chance and method times 1.96, separately below and
above the estimate.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rigd.analysis.identifiability import Z_95
from rigd.analysis.result import FloatArray
from rigd.analysis.uncertainty import delta_sd, jackknife_sd

Function = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, eq=False)
class Spread:
    """``theta`` (p,) natural; ``coloured`` (p, p) scaled; the rest are lists of natural sets."""

    theta: FloatArray
    slopes: FloatArray
    coloured: FloatArray
    left_out: tuple[FloatArray, ...]
    windows: tuple[FloatArray, ...]
    ridge: FloatArray

    def standard_error(self, function: Function, gradient: FloatArray) -> FloatArray:
        """Return chance and method together for ``function`` (m,), d(function)/d(theta) (m, p)."""
        chance = np.maximum(
            delta_sd(gradient * self.slopes, self.coloured),
            jackknife_sd(function, self.left_out),
        )
        return np.asarray(np.hypot(chance, self.method_sd(function)))

    def method_sd(self, function: Function) -> FloatArray:
        """Return the root mean square change of ``function`` (m,) under other filter windows."""
        centre = function(self.theta)
        if not self.windows:
            return np.zeros_like(centre)
        return np.asarray(
            np.sqrt(np.mean([(function(t) - centre) ** 2 for t in self.windows], axis=0))
        )

    def interval(
        self, function: Function, gradient: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return (low, high, standard error), each (m,), of ``function`` at 95 %."""
        centre = function(self.theta)
        error = self.standard_error(function, gradient)
        ridge = np.array([function(t) for t in self.ridge] or [centre])
        below = np.maximum(centre - ridge.min(axis=0), 0.0)
        above = np.maximum(ridge.max(axis=0) - centre, 0.0)
        return (
            centre - np.hypot(Z_95 * error, below),
            centre + np.hypot(Z_95 * error, above),
            error,
        )
