"""The usual way to fit a LuGre model: scipy's least_squares over solve_ivp, finite differences.

The same processed samples, start, box and logarithmic parameters as rigd's own fit, so that only
the method differs. The right-hand side is scalar Python with ``math``, which is several times
faster than the same lines on one-element arrays.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from rigd.analysis.fitting.model import scaled_bounds, to_natural, to_scaled
from rigd.analysis.friction import SlipForce
from rigd_analyses.lugre.model import LugreModel

FloatArray = NDArray[np.float64]
Residual = Callable[[FloatArray], FloatArray]

#: Of the solver, and of the differences. An adaptive solver's result jumps by about its tolerance
#: when a parameter moves, so the step must be far above it: with the default step (1.5e-8) the
#: fit does not leave its start at rtol 1e-6, and stays eight times above the best cost at 1e-9.
RTOL, ATOL, DIFF_STEP = 1e-8, 1e-10, 1e-4


@dataclass(frozen=True)
class PeerFit:
    """The end point of least_squares (natural parameters), and its cost."""

    theta: FloatArray
    cost: float
    evaluations: int  #: of the whole residual, those for differences included


def solved_force(trial: SlipForce, q: FloatArray) -> FloatArray:
    """Return F/F_N (n,) by solve_ivp, the recorded slip interpolated linearly."""
    v_s, mu_c, ratio, s0, s1, s2 = map(float, q)
    rise = mu_c * math.expm1(ratio)
    slip: list[float] = trial.slip_m_s.tolist()
    last = len(slip) - 1
    period = trial.period_s

    def rate(t: float, z: FloatArray) -> float:
        position = t / period
        index = min(int(position), last - 1)
        v = slip[index] + (position - index) * (slip[index + 1] - slip[index])
        g = mu_c + rise * math.exp(-math.sqrt(abs(v) / v_s))
        return s0 * (v - abs(v) * float(z[0]) / g)

    t = np.arange(len(slip)) * period
    z = solve_ivp(rate, (0.0, t[-1]), [0.0], "LSODA", t, rtol=RTOL, atol=ATOL).y[0]
    v = trial.slip_m_s
    g = mu_c + rise * np.exp(-np.sqrt(np.abs(v) / v_s))
    return np.asarray(z + s1 * (v - np.abs(v) * z / g) + s2 * v)


def slow_residual(model: LugreModel) -> Residual:
    """Return the residual of the used samples with every trial solved by solve_ivp."""
    measured = np.concatenate([t.force for t in model.trials])

    def residual(q: FloatArray) -> FloatArray:
        predicted = np.concatenate([solved_force(t, q) for t in model.trials])
        return np.asarray((predicted - measured)[model.mask > 0.0])

    return residual


def fast_residual(model: LugreModel) -> Residual:
    """Return the same residual from rigd's compiled recursion."""
    return lambda q: np.asarray(model.residuals(q)[model.mask > 0.0])


def peer_fit(model: LugreModel, residual: Residual) -> PeerFit:
    """Fit ``residual`` by least_squares from the model's own start."""
    low, high = scaled_bounds(model.parameters)
    start = to_scaled(model.parameters, np.array([p.start for p in model.parameters]))
    count = 0

    def counted(scaled: FloatArray) -> FloatArray:
        nonlocal count
        count += 1
        return residual(to_natural(model.parameters, scaled))

    found = least_squares(counted, start, bounds=(low, high), diff_step=np.array([DIFF_STEP]))
    return PeerFit(to_natural(model.parameters, np.asarray(found.x)), float(found.cost), count)
