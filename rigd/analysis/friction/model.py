"""Fits a friction law: slip of several trials in, friction over normal force out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from rigd.analysis.fitting.model import (
    NormalEquations,
    scaled_bounds,
    slopes,
    stacked_normal_equations,
    to_natural,
    to_scaled,
)
from rigd.analysis.friction import compiled_law
from rigd.analysis.friction.law import FrictionLaw, LawParameter
from rigd.analysis.result import FloatArray

#: Step of the differences in scaled coordinates, at which rounding and the cut series both leave
#: a relative error of about 1e-10 (W. H. Press et al., Numerical Recipes, 3rd ed., section 5.7).
STEP: Final = 1e-5


@dataclass(frozen=True, eq=False)
class SlipForce:
    """The processed samples of one trial: slip in m/s, F/F_N, and which samples count.

    All arrays (n,). The first sample is at rest, with the law's states 0. ``rolling_m_s`` is the
    speed at which the contact moves through the body (the rim of a wheel); None: it does not roll.
    """

    label: str
    period_s: float
    slip_m_s: FloatArray
    force: FloatArray
    mask: FloatArray
    rolling_m_s: FloatArray | None = None


class LawModel:
    """Residuals F_law/F_N - F_measured/F_N; a :class:`rigd.analysis.fitting.model.Model`.

    Between two samples the slip has the mean of both.
    """

    def __init__(self, law: type[FrictionLaw], trials: Sequence[SlipForce]) -> None:
        self.law = law
        self.trials = tuple(trials)
        lengths = [len(trial.slip_m_s) for trial in self.trials]
        ends = np.cumsum(lengths).tolist()
        self._slices = tuple(slice(a, b) for a, b in zip([0, *ends], ends, strict=False))
        slip = np.concatenate([trial.slip_m_s for trial in self.trials])
        kind = np.concatenate([_kind(trial.slip_m_s) for trial in self.trials])
        rolling = np.concatenate([_rolling(trial) for trial in self.trials])
        between = np.concatenate([_between(slip[part]) for part in self._slices])
        rolls = np.concatenate([_between(rolling[part]) for part in self._slices])
        dt = np.repeat([trial.period_s for trial in self.trials], lengths)
        dt[kind != compiled_law.FOLLOWS] = 0.0
        self._inputs = (slip, between, rolls, dt, kind)
        self._measured: FloatArray = np.concatenate([trial.force for trial in self.trials])
        self._mask: FloatArray = np.concatenate([trial.mask for trial in self.trials])

    @property
    def parameters(self) -> tuple[LawParameter, ...]:
        """Return the parameters of the law."""
        return self.law.parameters

    @property
    def trial_slices(self) -> tuple[slice, ...]:
        """Return the place of each trial in the stacked residual."""
        return self._slices

    @property
    def mask(self) -> FloatArray:
        """Return (n,) of 1 if a sample counts and 0 if it does not."""
        return self._mask

    def predict(self, theta: FloatArray) -> FloatArray:
        """Return F/F_N (n,), also if the mask is 0."""
        return compiled_law.predict(self.law.step, self.law.states, theta, self._inputs)

    def residuals(self, theta: FloatArray) -> FloatArray:
        """Return prediction minus measurement, (n,), dimensionless (of F_N)."""
        return self.predict(theta) - self._measured

    def jacobian(self, theta: FloatArray) -> FloatArray:
        """Return d(residuals)/d(theta), (n, p)."""
        if self.law.gradient is None:
            return self.differences(theta)
        return compiled_law.sensitivities(self.law.gradient, self.law.states, theta, self._inputs)

    def differences(self, theta: FloatArray) -> FloatArray:
        """Return d(residuals)/d(theta), (n, p), as central differences; at a bound, one-sided."""
        low, high = scaled_bounds(self.parameters)
        centre = to_scaled(self.parameters, theta)
        columns = []
        for index in range(len(centre)):
            up, down = centre.copy(), centre.copy()
            up[index] = min(up[index] + STEP, high[index])
            down[index] = max(down[index] - STEP, low[index])
            ends = [self.predict(to_natural(self.parameters, point)) for point in (up, down)]
            columns.append((ends[0] - ends[1]) / (up[index] - down[index]))
        return np.stack(columns, axis=1) / slopes(self.parameters, theta)

    def cost(self, theta: FloatArray, weights: FloatArray | None = None) -> float:
        """Return half the weighted sum of squared residuals."""
        law = self.law
        return compiled_law.cost(
            law.step, law.states, theta, self._inputs, self._measured, self._weights(weights)
        )

    def normal_equations(
        self, theta: FloatArray, weights: FloatArray | None = None
    ) -> NormalEquations:
        """Return cost, gradient and information; of a law with derivatives in one fused pass."""
        law, used = self.law, self._weights(weights)
        if law.gradient is None:
            return stacked_normal_equations(self.residuals(theta), self.differences(theta), used)
        return NormalEquations(
            *compiled_law.normal_equations(
                law.gradient, law.states, theta, self._inputs, self._measured, used
            )
        )

    def _weights(self, weights: FloatArray | None) -> FloatArray:
        return self._mask if weights is None else self._mask * weights


def _rolling(trial: SlipForce) -> FloatArray:
    if trial.rolling_m_s is None:
        return np.zeros(len(trial.slip_m_s))
    return trial.rolling_m_s


def _between(values: FloatArray) -> FloatArray:
    """Return the mean over the interval that ends at each sample; at the first the sample."""
    return np.concatenate([values[:1], 0.5 * (values[1:] + values[:-1])])


def _kind(slip: FloatArray) -> FloatArray:
    """Return what each sample of a trial is; the rest ends with its last sample without slip."""
    moving = np.flatnonzero(slip)
    begin = int(moving[0]) if moving.size else len(slip)
    kind = np.full(len(slip), compiled_law.FOLLOWS)
    kind[:begin] = compiled_law.RESTS
    if begin == 0:
        kind[0] = compiled_law.BEGINS
    return kind
