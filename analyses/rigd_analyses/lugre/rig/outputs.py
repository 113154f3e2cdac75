"""Computes the outputs of the rig and their derivatives from the states of the recursion.

The outputs are: slip travel r_0 angle - position, with the stated radius r_0 (a constant
combination of measured values); carriage position; acceleration. The encoders have a delay. The
accelerometer has a gain and a zero error, and vibrates with the speed at once and twice the rate of
the rollers' transitions. The code is compiled.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rigd.analysis.kernel import kernel
from rigd.analysis.result import FloatArray
from rigd_analyses.lugre.rig.kernel import COUNT

IndexArray = NDArray[np.intp]

DYNAMIC = COUNT - 1  #: parameters of the recursion that all trials share
WHEEL_DELAY = DYNAMIC - 1
(
    CARRIAGE_DELAY, GAIN, SHAKE_COS, SHAKE_SIN, TWICE_COS, TWICE_SIN,
) = range(DYNAMIC, DYNAMIC + 6)  # fmt: skip
SHARED = TWICE_SIN + 1
#: Names of the shared unknowns from ``CARRIAGE_DELAY`` on.
NAMES = (
    "carriage_delay", "acceleration_gain", "shake_cos", "shake_sin", "shake_2_cos", "shake_2_sin",
)  # fmt: skip
FIRST_BRISTLE, FIRST_ANGLE, FIRST_POSITION, ZERO = range(4)
LOCAL = ZERO + 1
SLIP, TRAVEL, ACCELERATION = range(3)
OUTPUTS = ACCELERATION + 1


@kernel
def _shake(shared: FloatArray, cosine: float, sine: float) -> float:
    """Return what the accelerometer shakes for each m/s, in 1/s."""
    twice_cosine, twice_sine = 2.0 * cosine * cosine - 1.0, 2.0 * sine * cosine
    shake: float = (
        shared[SHAKE_COS] * cosine + shared[SHAKE_SIN] * sine
        + shared[TWICE_COS] * twice_cosine + shared[TWICE_SIN] * twice_sine
    )  # fmt: skip
    return shake


@kernel
def outputs(
    states: FloatArray, phase: FloatArray, shared: FloatArray, local: FloatArray, radius: float
) -> FloatArray:
    """Return the outputs (n, 3) of ``states`` (n, 6).

    ``phase`` (n,) is that of the rollers' transitions in rad, ``radius`` the one that slip travel
    is made with, in m.
    """
    count = states.shape[0]
    out = np.empty((count, OUTPUTS))
    for k in range(count):
        x, angle, rate, v, w = states[k, 0], states[k, 1], states[k, 2], states[k, 3], states[k, 4]
        position = x - shared[CARRIAGE_DELAY] * v + local[FIRST_POSITION]
        turned = angle - shared[WHEEL_DELAY] * w + local[FIRST_ANGLE]
        shake = _shake(shared, math.cos(phase[k]), math.sin(phase[k]))
        out[k, SLIP] = radius * turned - position
        out[k, TRAVEL] = position
        out[k, ACCELERATION] = (1.0 + shared[GAIN]) * rate + local[ZERO] + v * shake
    return out


@kernel
def output_slopes(
    states: FloatArray, by_q: FloatArray, phase: FloatArray, hurry: FloatArray,
    shared: FloatArray, radius: float, q_slopes: FloatArray, places: IndexArray, unknowns: int,
) -> FloatArray:  # fmt: skip
    """Return the derivatives (n, 3, unknowns + 4) of the outputs to shared, then local unknowns.

    ``by_q`` (n, 5, 20) are those of ``states`` to the parameters of the recursion, ``hurry`` (n,)
    is the rate of ``phase`` in rad/s. ``q_slopes`` (2, 19) are the derivatives of the parameters
    of the recursion to the shared unknown of the same place, and to the mass. ``shared`` (26,) are
    those of this trial, the last of them the mass, and ``places`` (26,) their columns.
    """
    count = states.shape[0]
    out = np.zeros((count, OUTPUTS, unknowns + LOCAL))
    late_wheel, late_carriage = shared[WHEEL_DELAY], shared[CARRIAGE_DELAY]
    gain, mass = 1.0 + shared[GAIN], places[SHARED]
    carriage, wheel = places[CARRIAGE_DELAY], places[WHEEL_DELAY]
    for k in range(count):
        slip, travel, felt = out[k, SLIP], out[k, TRAVEL], out[k, ACCELERATION]
        by = by_q[k]
        rate, v, w = states[k, 2], states[k, 3], states[k, 4]
        cosine, sine = math.cos(phase[k]), math.sin(phase[k])
        shake = _shake(shared, cosine, sine)
        for j in range(COUNT):
            position = by[0, j] - late_carriage * by[3, j]
            gap = radius * (by[1, j] - late_wheel * by[4, j]) - position
            acceleration = gain * by[2, j] + shake * by[3, j]
            if j == DYNAMIC:
                at, share = unknowns + FIRST_BRISTLE, 1.0
            else:
                at, share = places[j], q_slopes[0, j]
                by_mass = q_slopes[1, j]
                if by_mass != 0.0:
                    slip[mass] += by_mass * gap
                    travel[mass] += by_mass * position
                    felt[mass] += by_mass * acceleration
            slip[at], travel[at], felt[at] = share * gap, share * position, share * acceleration
        twice_cosine, twice_sine = 2.0 * cosine * cosine - 1.0, 2.0 * sine * cosine
        slip[wheel] -= radius * w
        felt[wheel] += v * hurry[k] * (
            shared[SHAKE_SIN] * cosine - shared[SHAKE_COS] * sine
            + 2.0 * (shared[TWICE_SIN] * twice_cosine - shared[TWICE_COS] * twice_sine)
        )  # fmt: skip
        slip[carriage], travel[carriage] = v, -v
        felt[places[GAIN]] = rate
        felt[places[SHAKE_COS]], felt[places[SHAKE_SIN]] = v * cosine, v * sine
        felt[places[TWICE_COS]], felt[places[TWICE_SIN]] = v * twice_cosine, v * twice_sine
        slip[unknowns + FIRST_ANGLE] = radius
        slip[unknowns + FIRST_POSITION], travel[unknowns + FIRST_POSITION] = -1.0, 1.0
        felt[unknowns + ZERO] = 1.0
    return out
