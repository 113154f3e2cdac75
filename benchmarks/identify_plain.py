"""Plain least squares on the simulated rig, with the usual intervals: a peer of output error.

What a person gets from scipy's least_squares: the six parameters of friction are free, the
constants are as stated, each trial begins at rest at zero. Each output is weighted by the root mean
square that the fit leaves of it: weighted by the noise of their sensors, friction is bent to
explain a travel that only the drive constants can explain (seen: mu_c 15 times too large). The
covariance is s^2 (J'J)^-1. The fit begins at the truth, so that no start is to blame for what it
misses. A number that is known no better than to a factor of two is not quoted.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from support.lugre.coverage import Found

from rigd.analysis.fitting.model import scaled_bounds, slopes, to_natural, to_scaled
from rigd_analyses.lugre.model import MU_C, PARAMETERS, RATIO, friction, friction_gradient
from rigd_analyses.lugre.rig.family import rig_system
from rigd_analyses.lugre.rig.parts import sort_out
from rigd_analyses.lugre.rig.system import RigSystem
from rigd_analyses.lugre.slip_force.identify import Settings
from rigd_analyses.lugre.trials.known_constants import RigConstants
from rigd_analyses.lugre.trials.trial import LugreTrial, sampling_period_s

FloatArray = NDArray[np.float64]
#: From a start (6,), natural, to the end (6,) and its covariance (6, 6), scaled.
Fitted = Callable[[RigSystem, FloatArray], tuple[FloatArray, FloatArray]]
Z_95 = 1.96
COUNT = len(PARAMETERS)
MOST = 60  #: evaluations of one round
ROUNDS = 3  #: of weights and fit


def plain_least_squares(
    trials: Sequence[LugreTrial],
    rig: RigConstants,
    truth: Mapping[str, float],
    slip: FloatArray,
    fitted: Fitted | None = None,
) -> dict[str, Found]:
    """Return estimates and ends over the truth: parameters, then g at ``slip`` (n,) in m/s.

    ``fitted`` is another way to fit than scipy's.

    Raises DataError: too few trials move.
    """
    begin = np.array([truth.get(p.name, 0.0) for p in PARAMETERS])
    begin[RATIO] = math.log(truth["mu_s"] / truth["mu_c"])
    parts, _ = sort_out(trials, [sampling_period_s(trial) for trial in trials], Settings())
    system = rig_system(parts, rig, begin)
    scaled, covariance = (fitted or _fitted)(system, begin)
    theta = to_natural(PARAMETERS, scaled)
    names = [p.name for p in PARAMETERS]
    rows = {name: np.eye(COUNT)[k] for k, name in enumerate(names) if name in truth}
    rows["mu_s"] = np.eye(COUNT)[MU_C] + np.eye(COUNT)[RATIO]
    values = dict(zip(names, theta.tolist(), strict=True))
    values["mu_s"] = float(theta[MU_C] * math.exp(theta[RATIO]))
    found = {
        name: _quoted(values[name] / truth[name], rows[name] @ covariance @ rows[name])
        for name in truth
    }
    curve, true = friction(theta, slip), friction(begin, slip)
    by = friction_gradient(theta, slip) * slopes(PARAMETERS, theta) / curve[:, None]
    for speed, value, right, row in zip(slip, curve, true, by, strict=True):
        name = f"g({1e3 * speed:.0f} mm/s)"
        found[name] = _quoted(float(value / right), float(row @ covariance @ row))
    return found


def inside(begin: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return ``begin`` (6,) within the bounds, and these; all scaled."""
    low, high = scaled_bounds(PARAMETERS)
    return np.clip(to_scaled(PARAMETERS, begin), low + 1e-9, high - 1e-9), low, high


def simulated(system: RigSystem, scaled: FloatArray) -> list[FloatArray]:
    """Return the outputs (n, 3) of each trial at friction ``scaled`` (6,), all else as stated."""
    at = _shared(system, scaled)
    return [system.simulate(k, at, _rest(system)) for k in range(len(system.trials))]


def _shared(system: RigSystem, scaled: FloatArray) -> FloatArray:
    stated = np.array([item.parameter.start for item in system.shared])
    return np.append(to_natural(PARAMETERS, scaled), stated[COUNT:])


def _rest(system: RigSystem) -> FloatArray:
    return np.array([item.parameter.start for item in system.local])


def _fitted(system: RigSystem, begin: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the end of the fit (6,) and its covariance (6, 6), scaled."""
    rest = _rest(system)

    def errors(scaled: FloatArray) -> FloatArray:
        outputs = simulated(system, scaled)
        return np.concatenate([a - b for a, b in zip(outputs, system.measured, strict=True)])

    def residual(scaled: FloatArray, weights: FloatArray) -> FloatArray:
        return np.asarray((errors(scaled) * weights).ravel())

    def jacobian(scaled: FloatArray, weights: FloatArray) -> FloatArray:
        at = _shared(system, scaled)
        scale = slopes(PARAMETERS, at[:COUNT])
        parts = [system.linearise(k, at, rest)[1][:, :, :COUNT] for k in range(len(system.trials))]
        return np.concatenate([(p * weights[:, None] * scale).reshape(-1, COUNT) for p in parts])

    point, low, high = inside(begin)
    for _ in range(ROUNDS):
        weights = 1.0 / np.sqrt(np.mean(errors(point) ** 2, axis=0))
        end = least_squares(
            residual, point, jacobian, bounds=(low, high), x_scale="jac", max_nfev=MOST,
            args=(weights,),
        )  # fmt: skip
        point = np.clip(end.x, low + 1e-9, high - 1e-9)
    variance = 2.0 * end.cost / (len(end.fun) - COUNT)
    slope = jacobian(np.asarray(end.x), weights)
    covariance = variance * np.linalg.pinv(slope.T @ slope)
    return np.asarray(end.x), np.asarray(covariance, dtype=np.float64)


def _quoted(estimate: float, variance: float) -> Found:
    """Return the estimate and the ends of its interval; None for what is not quoted."""
    half = Z_95 * math.sqrt(max(variance, 0.0))
    if not half < math.log(2.0):
        return estimate, None, None
    return estimate, estimate * math.exp(-half), estimate * math.exp(half)
