"""Computes the interval of a quantity from three contributions: chance, method and ridge.

The quantity is any function of the parameters (a parameter itself, a characteristic at one point).

- chance: the larger of two standard errors, that of the sandwich covariance, which holds for
  correlated residuals, and that of the jackknife over whole trials;
- method: the root mean square change of the quantity when the data are processed in other ways,
  such as with a shorter and a longer filter window;
- ridge: the range of the quantity over all parameter sets that the profiles accept. A covariance
  does not show this range: it describes the cost only near the estimate, and the cost is not a
  parabola there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.stats import t

from rigd.analysis.fitting.identifiability import Z_95
from rigd.analysis.fitting.uncertainty import delta_sd, jackknife_sd
from rigd.analysis.result import FloatArray

Function = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, eq=False)
class Spread:
    """``theta`` (p,) natural; ``coloured`` (p, p) scaled; the rest are natural sets.

    ``left_out`` are refits without each trial, ``others`` refits to data processed in other ways,
    ``ridge`` (m, p) what the profiles accept. ``slopes`` (p,) are d(theta)/d(scaled).
    """

    theta: FloatArray
    slopes: FloatArray
    coloured: FloatArray
    left_out: tuple[FloatArray, ...] = ()
    others: tuple[FloatArray, ...] = ()
    ridge: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))

    def standard_error(self, function: Function, gradient: FloatArray) -> FloatArray:
        """Return chance and method together for ``function`` (m,), d(function)/d(theta) (m, p)."""
        return np.asarray(np.hypot(self._chance(function, gradient), self.method_sd(function)))

    def trials_sd(self, function: Function) -> FloatArray:
        """Return the standard error of ``function`` (m,) by the jackknife; 0 without refits.

        It is widened as few trials show their scatter badly: 1.96 of it hold 95 % (Student's t).
        """
        if len(self.left_out) < 2:
            return np.zeros_like(function(self.theta))
        few = float(t.ppf(0.975, len(self.left_out) - 1)) / Z_95
        return few * jackknife_sd(function, self.left_out)

    def method_sd(self, function: Function) -> FloatArray:
        """Return the root mean square change of ``function`` (m,) under other processing."""
        centre = function(self.theta)
        if not self.others:
            return np.zeros_like(centre)
        return np.asarray(
            np.sqrt(np.mean([(function(other) - centre) ** 2 for other in self.others], axis=0))
        )

    def interval(
        self, function: Function, gradient: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return (low, high, standard error), each (m,), of ``function`` at 95 %.

        All three contributions are added in quadrature, on each side by itself.
        """
        centre, error = function(self.theta), self.standard_error(function, gradient)
        below, above = self._beyond(function, centre)
        return (
            centre - np.hypot(Z_95 * error, below),
            centre + np.hypot(Z_95 * error, above),
            error,
        )

    def band(self, function: Function, gradient: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return (low, high), each (m,), of ``function`` at 95 %, as of parameters by profiles.

        Profiles of all parameters show chance too: the larger of both counts.
        """
        centre, chance = function(self.theta), Z_95 * self._chance(function, gradient)
        method = Z_95 * self.method_sd(function)
        below, above = self._beyond(function, centre)
        return (
            centre - np.hypot(np.maximum(chance, below), method),
            centre + np.hypot(np.maximum(chance, above), method),
        )

    def _chance(self, function: Function, gradient: FloatArray) -> FloatArray:
        by_covariance = delta_sd(gradient * self.slopes, self.coloured)
        return np.maximum(by_covariance, self.trials_sd(function))

    def _beyond(self, function: Function, centre: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return how far the ridge reaches below and above ``centre`` (m,)."""
        ridge = np.array([function(point) for point in self.ridge] or [centre])
        return (
            np.maximum(centre - ridge.min(axis=0), 0.0),
            np.maximum(ridge.max(axis=0) - centre, 0.0),
        )
