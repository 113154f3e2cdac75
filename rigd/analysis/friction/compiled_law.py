"""Runs a friction law over the samples of all trials (compiled code).

A law gives one function for one sample, and may give a second one with derivatives. Both are
compiled by themselves with a fixed signature (:func:`step`, :func:`gradient`); the loops below call
them by their address. So the loops are compiled once for all laws, and numba keeps all compiled
code on disk.
"""

from __future__ import annotations

from collections.abc import Callable

import numba
import numpy as np
from numba import types

from rigd.analysis.kernel import kernel
from rigd.analysis.result import FloatArray

#: ``step(state, theta, slip_between, slip, rolling, dt) -> F/F_N``
Step = Callable[[FloatArray, FloatArray, float, float, float, float], float]
#: ``gradient(state, sensitivity, theta, slip_between, slip, rolling, dt, row) -> F/F_N``
Gradient = Callable[
    [FloatArray, FloatArray, FloatArray, float, float, float, float, FloatArray], float
]
#: Slip, slip between the samples, rolling speed (m/s), interval (s), and what each sample is.
Inputs = tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]

#: A sample that follows another, the first of a trial, one of the rest before the slip begins.
FOLLOWS, BEGINS, RESTS = 0.0, 1.0, 2.0

_REAL = types.float64
_VECTOR = types.float64[::1]
_MATRIX = types.float64[:, ::1]
_STEP = _REAL(_VECTOR, _VECTOR, _REAL, _REAL, _REAL, _REAL)
_GRADIENT = _REAL(_VECTOR, _MATRIX, _VECTOR, _REAL, _REAL, _REAL, _REAL, _VECTOR)


def step(function: Step) -> Step:
    """Compile a law's function for one sample, when its module is imported.

    ``function(state, theta, slip_between, slip, rolling, dt)`` advances ``state`` (states,) in
    place by ``dt`` s at the slip ``slip_between`` in m/s, the mean over that interval, and returns
    F/F_N at the slip ``slip`` in m/s. ``theta`` (p,) are the parameters in their units,
    ``rolling`` is the speed in m/s at which the contact moves through the body (a wheel's rim).

    Raises:
        numba.core.errors.NumbaError: it cannot be compiled.
    """
    compiled: Step = numba.cfunc(_STEP, cache=True, error_model="numpy")(function)
    return compiled


def gradient(function: Gradient) -> Gradient:
    """Compile a law's function for one sample with derivatives.

    ``function(state, sensitivity, theta, slip_between, slip, rolling, dt, row)`` does what the
    :func:`step` of the law does. Besides, it advances ``sensitivity`` (states, p), the derivatives
    of the state by ``theta``, in place, and writes those of F/F_N into ``row`` (p,).

    Raises:
        numba.core.errors.NumbaError: it cannot be compiled.
    """
    compiled: Gradient = numba.cfunc(_GRADIENT, cache=True, error_model="numpy")(function)
    return compiled


@kernel
def predict(law: Step, states: int, theta: FloatArray, inputs: Inputs) -> FloatArray:
    """Return F/F_N (n,). Each trial begins with all states 0, and without force at rest."""
    slip, between, rolling, dt, kind = inputs
    out = np.empty_like(slip)
    state = np.zeros(states)
    for k in range(slip.shape[0]):
        if kind[k] != FOLLOWS:
            state[:] = 0.0
        out[k] = (
            0.0 if kind[k] == RESTS else law(state, theta, between[k], slip[k], rolling[k], dt[k])
        )
    return out


@kernel
def cost(
    law: Step,
    states: int,
    theta: FloatArray,
    inputs: Inputs,
    measured: FloatArray,
    weights: FloatArray,
) -> float:
    """Return half the weighted sum of squares of prediction minus ``measured`` (n,)."""
    slip, between, rolling, dt, kind = inputs
    total = 0.0
    state = np.zeros(states)
    for k in range(slip.shape[0]):
        if kind[k] != FOLLOWS:
            state[:] = 0.0
        force = 0.0
        if kind[k] != RESTS:
            force = law(state, theta, between[k], slip[k], rolling[k], dt[k])
        r = force - measured[k]
        if weights[k] != 0.0:
            total += weights[k] * r * r
    return 0.5 * total


@kernel
def sensitivities(law: Gradient, states: int, theta: FloatArray, inputs: Inputs) -> FloatArray:
    """Return d(F/F_N)/d(theta), (n, p)."""
    slip, between, rolling, dt, kind = inputs
    out = np.zeros((slip.shape[0], theta.shape[0]))
    state, sensitivity = np.zeros(states), np.zeros((states, theta.shape[0]))
    for k in range(slip.shape[0]):
        if kind[k] != FOLLOWS:
            state[:] = 0.0
            sensitivity[:] = 0.0
        if kind[k] == RESTS:
            continue
        law(state, sensitivity, theta, between[k], slip[k], rolling[k], dt[k], out[k])
    return out


@kernel
def normal_equations(
    law: Gradient,
    states: int,
    theta: FloatArray,
    inputs: Inputs,
    measured: FloatArray,
    weights: FloatArray,
) -> tuple[float, FloatArray, FloatArray]:
    """Return cost, J'Wr (p,) and J'WJ (p, p) in one pass that stores no Jacobian."""
    slip, between, rolling, dt, kind = inputs
    count = theta.shape[0]
    total = 0.0
    gradients, information, row = np.zeros(count), np.zeros((count, count)), np.empty(count)
    state, sensitivity = np.zeros(states), np.zeros((states, count))
    for k in range(slip.shape[0]):
        if kind[k] != FOLLOWS:
            state[:] = 0.0
            sensitivity[:] = 0.0
        weight = weights[k]
        if kind[k] == RESTS:
            total += weight * measured[k] * measured[k]
            continue
        force = law(state, sensitivity, theta, between[k], slip[k], rolling[k], dt[k], row)
        if weight == 0.0:
            continue
        r = force - measured[k]
        total += weight * r * r
        for i in range(count):
            weighted = weight * row[i]
            gradients[i] += weighted * r
            for j in range(i, count):
                information[i, j] += weighted * row[j]
    for i in range(count):
        for j in range(i):
            information[i, j] = information[j, i]
    return 0.5 * total, gradients, information
