"""Defines the interface of models to the estimators: parameters, residuals per trial, derivatives.

A rig family provides one class with these methods; fitting, uncertainty, profiles and verdicts are
then the same for all rigs. Residuals are dimensionless: the model divides them by its noise scale
or by its normal force, so that trials can be compared.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

import numpy as np

from rigd.analysis.result import FittedPoint, FloatArray


class Scaling(Enum):
    """The coordinate in which a parameter is fitted."""

    LINEAR = "linear"
    LOG = "log"


@dataclass(frozen=True)
class FitParameter:
    """A fitted parameter with its box; the first start begins at ``start``, in ``unit``."""

    name: str
    unit: str
    low: float
    high: float
    start: float
    scaling: Scaling = Scaling.LOG

    def __post_init__(self) -> None:
        if not self.low <= self.start <= self.high:
            raise ValueError(
                f"{self.name}: start {self.start} outside [{self.low}, {self.high}] {self.unit}"
            )
        if self.scaling is Scaling.LOG and self.low <= 0.0:
            raise ValueError(f"{self.name}: log scaling needs a positive lower bound")

    def scaled(self, value: float) -> float:
        """Return ``value`` (in ``unit``) in the coordinate of the fit."""
        return math.log(value) if self.scaling is Scaling.LOG else value

    def natural(self, scaled: float) -> float:
        """Return the coordinate of the fit as a value in ``unit``."""
        return math.exp(scaled) if self.scaling is Scaling.LOG else scaled

    def slope(self, value: float) -> float:
        """Return d(value)/d(scaled) at ``value``."""
        return value if self.scaling is Scaling.LOG else 1.0


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """``cost`` = 1/2 r'Wr, ``gradient`` = J'Wr (p,), ``information`` = J'WJ (p, p)."""

    cost: float
    gradient: FloatArray
    information: FloatArray

    def promised(self, step: FloatArray) -> float:
        """Return by how much ``step`` (p,) lowers the cost of the linearised model."""
        return -float(self.gradient @ step + 0.5 * step @ self.information @ step)


class Model(Protocol):
    """Residuals r = (prediction - measurement) of several trials and their exact derivatives.

    ``theta`` is (p,) in natural units in the order of ``parameters``; ``weights``, if given, is
    (n,) over all trials one after the other and multiplies the model's own 0/1 mask.
    """

    @property
    def parameters(self) -> tuple[FitParameter, ...]:
        """Return the fitted parameters."""

    @property
    def trial_slices(self) -> tuple[slice, ...]:
        """Return the place of each trial in the stacked residual, in time order."""

    @property
    def mask(self) -> FloatArray:
        """Return (n,) of 1 if a sample enters the cost and 0 if it does not."""

    def residuals(self, theta: FloatArray) -> FloatArray:
        """Return the stacked residuals (n,), also if the mask is 0."""

    def jacobian(self, theta: FloatArray) -> FloatArray:
        """Return d(residuals)/d(theta), (n, p)."""

    def cost(self, theta: FloatArray, weights: FloatArray | None = None) -> float:
        """Return 1/2 r'Wr."""

    def normal_equations(
        self, theta: FloatArray, weights: FloatArray | None = None
    ) -> NormalEquations:
        """Return cost, gradient and information, without keeping the Jacobian if it can."""


def stacked_normal_equations(
    residuals: FloatArray, jacobian: FloatArray, weights: FloatArray
) -> NormalEquations:
    """Return the normal equations from dense arrays, for models without a fused kernel."""
    weighted = jacobian * weights[:, None]
    return NormalEquations(
        cost=0.5 * float(np.dot(weights * residuals, residuals)),
        gradient=weighted.T @ residuals,
        information=weighted.T @ jacobian,
    )


def fitted_point(
    parameters: Sequence[FitParameter],
    theta: FloatArray,
    covariance: FloatArray,
    moved: Sequence[FloatArray],
    accepted: FloatArray,
) -> FittedPoint:
    """Return the end of a fit, ``theta`` (p,) natural, for the JSON object of a result.

    ``covariance`` (p, p) is in scaled coordinates. ``moved`` are the natural parameters (p,) under
    other choices of the method, ``accepted`` (m, p) those that profiles accept: of these the ends
    of each parameter are kept.
    """
    ends = (
        {int(k) for k in (*np.argmin(accepted, 0), *np.argmax(accepted, 0))}
        if len(accepted)
        else ()
    )
    alternatives = [*moved, *(accepted[k] for k in sorted(ends))]
    return FittedPoint(
        names=tuple(item.name for item in parameters),
        units=tuple(item.unit for item in parameters),
        scaling=tuple(item.scaling.value for item in parameters),
        values=np.asarray(theta, dtype=np.float64),
        covariance=covariance,
        alternatives=np.reshape(alternatives, (-1, len(theta))).astype(np.float64),
    )


def to_scaled(parameters: Sequence[FitParameter], theta: FloatArray) -> FloatArray:
    """Return natural values (p,) in the coordinates of the fit."""
    return np.array([p.scaled(float(x)) for p, x in zip(parameters, theta, strict=True)])


def to_natural(parameters: Sequence[FitParameter], scaled: FloatArray) -> FloatArray:
    """Return fit coordinates (p,) in natural values."""
    return np.array([p.natural(float(x)) for p, x in zip(parameters, scaled, strict=True)])


def slopes(parameters: Sequence[FitParameter], theta: FloatArray) -> FloatArray:
    """Return d(natural)/d(scaled), (p,)."""
    return np.array([p.slope(float(x)) for p, x in zip(parameters, theta, strict=True)])


def scaled_bounds(parameters: Sequence[FitParameter]) -> tuple[FloatArray, FloatArray]:
    """Return the box in the coordinates of the fit, two (p,) arrays."""
    low = np.array([p.scaled(p.low) for p in parameters])
    high = np.array([p.scaled(p.high) for p in parameters])
    return low, high
