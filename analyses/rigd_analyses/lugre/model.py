"""The LuGre model "slip in, traction out" as the estimators see it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from rigd.analysis.model import FitParameter, NormalEquations, Scaling
from rigd.analysis.result import FloatArray
from rigd_analyses.lugre import kernels

V_S, MU_C, RATIO, SIGMA_0, SIGMA_1, SIGMA_2 = range(6)

#: Fitted coordinates. ln(mu_s/mu_c) >= 0 keeps static friction at or above Coulomb friction, and
#: makes "no Stribeck effect" a bound that can be reached and recognised.
PARAMETERS = (
    FitParameter("V_s", "m/s", 1e-4, 10.0, 0.05),
    FitParameter("mu_c", "1", 1e-4, 2.0, 0.1),
    FitParameter("ln(mu_s/mu_c)", "1", 0.0, 4.0, 0.2, Scaling.LINEAR),
    FitParameter("sigma_0", "1/m", 0.1, 1e4, 30.0),
    FitParameter("sigma_1", "s/m", 1e-4, 100.0, 0.3),
    FitParameter("sigma_2", "s/m", 1e-3, 100.0, 2.0),
)


@dataclass(frozen=True, eq=False)
class SlipForce:
    """The processed samples of one trial: slip in m/s, F/F_N, and which samples count.

    All arrays (n,). The first sample is at rest, with the bristle relaxed.
    """

    label: str
    period_s: float
    slip_m_s: FloatArray
    force: FloatArray
    mask: FloatArray


@dataclass(frozen=True, eq=False)
class LugreModel:
    """Residuals F_model/F_N - F_measured/F_N of several trials, with analytic sensitivities."""

    trials: Sequence[SlipForce]
    parameters: tuple[FitParameter, ...] = PARAMETERS
    _inputs: tuple[FloatArray, FloatArray, FloatArray, FloatArray] = field(init=False, repr=False)
    _measured: FloatArray = field(init=False, repr=False)
    _mask: FloatArray = field(init=False, repr=False)
    _slices: tuple[slice, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        slip = np.concatenate([t.slip_m_s for t in self.trials])
        middle = np.concatenate([_midpoints(t.slip_m_s) for t in self.trials])
        dt = np.concatenate([np.full(len(t.slip_m_s), t.period_s) for t in self.trials])
        first = np.concatenate([_first(len(t.slip_m_s)) for t in self.trials])
        ends = np.cumsum([len(t.slip_m_s) for t in self.trials])
        slices = tuple(
            slice(int(e) - len(t.slip_m_s), int(e)) for e, t in zip(ends, self.trials, strict=True)
        )
        object.__setattr__(self, "_inputs", (slip, middle, dt, first))
        object.__setattr__(self, "_measured", np.concatenate([t.force for t in self.trials]))
        object.__setattr__(self, "_mask", np.concatenate([t.mask for t in self.trials]))
        object.__setattr__(self, "_slices", slices)

    @property
    def trial_slices(self) -> tuple[slice, ...]:
        """Return where each trial stands in the stacked residual."""
        return self._slices

    @property
    def mask(self) -> FloatArray:
        """Return (n,) of 1 where a sample counts and 0 where it does not."""
        return self._mask

    def predict(self, theta: FloatArray) -> FloatArray:
        """Return F/F_N (n,), also where the mask is 0."""
        return kernels.predict(theta, *self._inputs)

    def residuals(self, theta: FloatArray) -> FloatArray:
        """Return prediction minus measurement, (n,), dimensionless (of F_N)."""
        return self.predict(theta) - self._measured

    def jacobian(self, theta: FloatArray) -> FloatArray:
        """Return d(residuals)/d(theta), (n, 6)."""
        return kernels.sensitivities(theta, *self._inputs)

    def cost(self, theta: FloatArray, weights: FloatArray | None = None) -> float:
        """Return half the weighted sum of squared residuals."""
        return kernels.cost(theta, *self._inputs, self._measured, self._weights(weights))

    def normal_equations(
        self, theta: FloatArray, weights: FloatArray | None = None
    ) -> NormalEquations:
        """Return cost, gradient and information from one fused pass (about 0.1 µs a sample)."""
        return NormalEquations(
            *kernels.normal_equations(theta, *self._inputs, self._measured, self._weights(weights))
        )

    def _weights(self, weights: FloatArray | None) -> FloatArray:
        return self._mask if weights is None else self._mask * weights


def friction(theta: FloatArray, slip_m_s: FloatArray) -> FloatArray:
    """Return g(V_r), dimensionless, at ``slip_m_s`` (corrected Eq. 6)."""
    rise = np.expm1(theta[RATIO])
    decay = np.exp(-np.sqrt(np.abs(slip_m_s) / theta[V_S]))
    return np.asarray(theta[MU_C] * (1.0 + rise * decay))


def friction_gradient(theta: FloatArray, slip_m_s: FloatArray) -> FloatArray:
    """Return dg/d(theta), (n, 6), at ``slip_m_s``; zero to sigma_0, sigma_1, sigma_2."""
    rise = np.expm1(theta[RATIO])
    root = np.sqrt(np.abs(slip_m_s) / theta[V_S])
    decay = np.exp(-root)
    out = np.zeros((len(slip_m_s), len(theta)))
    out[:, V_S] = theta[MU_C] * rise * decay * root / (2.0 * theta[V_S])
    out[:, MU_C] = 1.0 + rise * decay
    out[:, RATIO] = theta[MU_C] * (rise + 1.0) * decay
    return out


def _midpoints(slip: FloatArray) -> FloatArray:
    """Return the slip in the middle of the interval that ends at each sample."""
    return np.concatenate([slip[:1], 0.5 * (slip[1:] + slip[:-1])])


def _first(count: int) -> FloatArray:
    mark = np.zeros(count)
    mark[0] = 1.0
    return mark
