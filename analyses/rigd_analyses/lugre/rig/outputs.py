"""Computes the outputs of the rig and their derivatives from the states of the recursion.

The outputs are: slip travel r_0 angle - position, with the stated radius r_0 (a constant
combination of measured values); carriage position; acceleration. Each sensor has a delay. The
accelerometer has a gain and a zero error, and vibrates with the speed at once and twice the rate of
the rollers' transitions. The code is compiled.

The acceleration jumps with the current: of a late one the value is that between samples (cubic
convolution; Keys, IEEE Trans. Acoustics, Speech and Signal Processing 29, 1981). A late position is
that of the nearest sample, to first order from there: off by an eighth of the acceleration times
the square of the period, 0.5 um at 4 m/s^2 and 1 kHz. To first order from the sample itself one of
5 ms was off by 50 um, and taken for a shaft that winds up.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from rigd.analysis.kernel import inlined, kernel
from rigd.analysis.result import FloatArray
from rigd_analyses.lugre.rig.kernel import COUNT

IndexArray = NDArray[np.intp]

DYNAMIC = COUNT - 1  #: parameters of the recursion that all trials share
WHEEL_DELAY = DYNAMIC - 1
(
    CARRIAGE_DELAY, GAIN, ACCELERATION_DELAY, SHAKE_COS, SHAKE_SIN, TWICE_COS, TWICE_SIN,
) = range(DYNAMIC, DYNAMIC + 7)  # fmt: skip
SHARED = TWICE_SIN + 1
#: Names of the shared unknowns from ``CARRIAGE_DELAY`` on.
NAMES = (
    "carriage_delay", "acceleration_gain", "acceleration_delay",
    "shake_cos", "shake_sin", "shake_2_cos", "shake_2_sin",
)  # fmt: skip
FIRST_BRISTLE, FIRST_ANGLE, FIRST_POSITION, ZERO = range(4)
LOCAL = ZERO + 1
SLIP, TRAVEL, ACCELERATION = range(3)
OUTPUTS = ACCELERATION + 1
#: Of cubic convolution: powers 0 to 3 of the lag, of the samples from one after to two before.
CUBIC = 0.5 * np.array(
    [[0.0, 2.0, 0.0, 0.0], [-1.0, 0.0, 1.0, 0.0], [2.0, -5.0, 4.0, -1.0], [-1.0, 3.0, -3.0, 1.0]]
)


def late(values: FloatArray, lag: float) -> tuple[FloatArray, FloatArray]:
    """Return ``values`` (n, c) as they were ``lag`` samples before, and the derivatives to it.

    Before the first sample and behind the last they stay.
    """
    whole = math.floor(lag)
    part = lag - whole
    weights = np.stack([part ** np.arange(4), [0.0, 1.0, 2.0 * part, 3.0 * part**2]]) @ CUBIC
    return _mixed(values, whole, weights)


def unsure(rate: FloatArray, jumps: FloatArray, lag: float) -> FloatArray:
    """Return by how much :func:`late` may err (n,) where ``rate`` (n,) jumps between samples.

    ``jumps`` (n,) is 1 if the current jumps behind a sample, and so the acceleration.
    """
    whole = math.floor(lag)
    part = lag - whole
    steps = np.append(np.abs(np.diff(rate)), 0.0) * jumps
    near = maximum_filter1d(steps, 5)[np.clip(np.arange(len(rate)) - whole, 0, len(rate) - 1)]
    return np.asarray(2.0 * part * (1.0 - part) * near)


@kernel
def _mixed(values: FloatArray, whole: int, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    count, columns = values.shape
    found, slopes = np.zeros((count, columns)), np.zeros((count, columns))
    for k in range(count):
        for i in range(4):
            row = values[min(max(k - whole + 1 - i, 0), count - 1)]
            share, slope = weights[0, i], weights[1, i]
            for j in range(columns):
                found[k, j] += share * row[j]
                slopes[k, j] += slope * row[j]
    return found, slopes


@inlined
def _nearest(k: int, lag: float, count: int) -> int:
    """Return the sample that is nearest to ``lag`` samples before ``k``, of ``count``."""
    return min(max(k - math.floor(lag + 0.5), 0), count - 1)


@kernel
def _shake(shared: FloatArray, cosine: float, sine: float) -> float:
    """Return what the accelerometer shakes for each m/s, in 1/s."""
    twice_cosine, twice_sine = 2.0 * cosine * cosine - 1.0, 2.0 * sine * cosine
    shake: float = (
        shared[SHAKE_COS] * cosine + shared[SHAKE_SIN] * sine
        + shared[TWICE_COS] * twice_cosine + shared[TWICE_SIN] * twice_sine
    )  # fmt: skip
    return shake


def outputs(
    states: FloatArray, phase: FloatArray, shared: FloatArray, local: FloatArray, radius: float,
    period: float,
) -> FloatArray:  # fmt: skip
    """Return the outputs (n, 3) of ``states`` (n, 6), whose samples are ``period`` s apart.

    ``phase`` (n,) is that of the rollers' transitions in rad, ``radius`` the one that slip travel
    is made with, in m.
    """
    found = _at_once(states, phase, shared, local, radius, period)
    lag = shared[ACCELERATION_DELAY] / period
    found[:, ACCELERATION:] = late(found[:, ACCELERATION:], lag)[0]
    return found


@kernel
def _at_once(
    states: FloatArray, phase: FloatArray, shared: FloatArray, local: FloatArray, radius: float,
    period: float,
) -> FloatArray:  # fmt: skip
    """Return the outputs (n, 3) with an accelerometer that is not late."""
    count = states.shape[0]
    out = np.empty((count, OUTPUTS))
    late_wheel, late_carriage = shared[WHEEL_DELAY], shared[CARRIAGE_DELAY]
    for k in range(count):
        rate, v = states[k, 2], states[k, 3]
        a = _nearest(k, late_carriage / period, count)
        b = _nearest(k, late_wheel / period, count)
        position = states[a, 0] - (late_carriage - (k - a) * period) * states[a, 3]
        position += local[FIRST_POSITION]
        turned = states[b, 1] - (late_wheel - (k - b) * period) * states[b, 4] + local[FIRST_ANGLE]
        shake = _shake(shared, math.cos(phase[k]), math.sin(phase[k]))
        out[k, SLIP] = radius * turned - position
        out[k, TRAVEL] = position
        out[k, ACCELERATION] = (1.0 + shared[GAIN]) * rate + local[ZERO] + v * shake
    return out


def output_slopes(
    states: FloatArray, by_q: FloatArray, phase: FloatArray, hurry: FloatArray,
    shared: FloatArray, radius: float, q_slopes: FloatArray, places: IndexArray, unknowns: int,
    period: float,
) -> FloatArray:  # fmt: skip
    """Return the derivatives (n, 3, unknowns + 4) of the outputs to shared, then local unknowns.

    ``by_q`` (n, 5, 20) are those of ``states`` to the parameters of the recursion, ``hurry`` (n,)
    is the rate of ``phase`` in rad/s. ``q_slopes`` (2, 19) are the derivatives of the parameters
    of the recursion to the shared unknown of the same place, and to the mass. ``shared`` (27,) are
    those of this trial, the last of them the mass, and ``places`` (27,) their columns. The samples
    are ``period`` s apart.
    """
    found = _slopes_at_once(
        states, by_q, phase, hurry, shared, radius, q_slopes, places, unknowns, period
    )
    lag = shared[ACCELERATION_DELAY] / period
    felt = _at_once(states, phase, shared, np.zeros(LOCAL), radius, period)[:, ACCELERATION:]
    found[:, ACCELERATION] = late(found[:, ACCELERATION], lag)[0]
    found[:, ACCELERATION, places[ACCELERATION_DELAY]] = late(felt, lag)[1][:, 0] / period
    return found


@kernel
def _slopes_at_once(
    states: FloatArray, by_q: FloatArray, phase: FloatArray, hurry: FloatArray,
    shared: FloatArray, radius: float, q_slopes: FloatArray, places: IndexArray, unknowns: int,
    period: float,
) -> FloatArray:  # fmt: skip
    """Return the derivatives with an accelerometer that is not late, to its delay 0."""
    count = states.shape[0]
    out = np.zeros((count, OUTPUTS, unknowns + LOCAL))
    late_wheel, late_carriage = shared[WHEEL_DELAY], shared[CARRIAGE_DELAY]
    gain, mass = 1.0 + shared[GAIN], places[SHARED]
    carriage, wheel = places[CARRIAGE_DELAY], places[WHEEL_DELAY]
    for k in range(count):
        slip, travel, felt = out[k, SLIP], out[k, TRAVEL], out[k, ACCELERATION]
        a = _nearest(k, late_carriage / period, count)
        b = _nearest(k, late_wheel / period, count)
        by, by_carriage, by_wheel = by_q[k], by_q[a], by_q[b]
        after_carriage = late_carriage - (k - a) * period
        after_wheel = late_wheel - (k - b) * period
        rate, v = states[k, 2], states[k, 3]
        cosine, sine = math.cos(phase[k]), math.sin(phase[k])
        shake = _shake(shared, cosine, sine)
        for j in range(COUNT):
            position = by_carriage[0, j] - after_carriage * by_carriage[3, j]
            gap = radius * (by_wheel[1, j] - after_wheel * by_wheel[4, j]) - position
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
        slip[wheel] -= radius * states[b, 4]
        felt[wheel] += v * hurry[k] * (
            shared[SHAKE_SIN] * cosine - shared[SHAKE_COS] * sine
            + 2.0 * (shared[TWICE_SIN] * twice_cosine - shared[TWICE_COS] * twice_sine)
        )  # fmt: skip
        slip[carriage], travel[carriage] = states[a, 3], -states[a, 3]
        felt[places[GAIN]] = rate
        felt[places[SHAKE_COS]], felt[places[SHAKE_SIN]] = v * cosine, v * sine
        felt[places[TWICE_COS]], felt[places[TWICE_SIN]] = v * twice_cosine, v * twice_sine
        slip[unknowns + FIRST_ANGLE] = radius
        slip[unknowns + FIRST_POSITION], travel[unknowns + FIRST_POSITION] = -1.0, 1.0
        felt[unknowns + ZERO] = 1.0
    return out
