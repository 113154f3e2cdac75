"""Computes the extended Kalman filter of slip for one cycle (compiled code).

The physics is that of :mod:`rigd_analyses.lugre.rig.kernel`, as it identifies the rig; the filter
adds what no model knows. State, n = 13 (9 without roller transitions), in SI:

    0 wheel angle   1 carriage speed v   2 wheel speed w   3 bristle deflection times sigma_0
    4 acceleration of the carriage by forces that are not in the model, m/s^2
    5 torque on the wheel that is not in the model, as a motor current, A
    6 zero of the accelerometer, m/s^2
    7 relative error of the friction force   8 relative error of the drive's gain
    9, 10 push of the rollers' transitions, 1/s   11, 12 what the sensor alone feels, 1/s

States 4 and 5 fade with a time constant (a first-order Gauss-Markov process), the last four and
the errors stay. F is the exact derivative of the Runge-Kutta steps that carry the state, except
that the phase of the transitions is taken as known. While something else holds the carriage, an
unknown acceleration acts in every cycle; it is what the accelerometer shows beyond the model, and
its course within a cycle is a trapezium. The relative error of friction is not estimated: nothing
that is measured tells it from slip. It counts in the covariance (Schmidt-Kalman filter). What else
is not known of the rig is estimated only while nothing else moves the carriage.
"""

from __future__ import annotations

import math

from rigd.analysis.kernel import part
from rigd.analysis.result import FloatArray
from rigd.computed.observers.kernel import (
    Floats,
    Times,
    Words,
    correct,
    cut,
    cut_times,
    predict,
    publish,
    square,
    take,
)
from rigd_analyses.lugre.rig.kernel import COUNT, LOOP_RATE, rates

ANGLE, SPEED, TURNING, BRISTLE, PUSH, TORQUE, ZERO, SCALE, GAIN, RIPPLE = range(10)
PLAIN = RIPPLE  #: states without roller transitions
SHAKE = RIPPLE + 2
FULL = SHAKE + 2
#: Places of the constants that the filter needs besides the 20 of the recursion.
(
    MASS, NORMAL, TRANSITIONS, STEPS, CURRENT_SD, JUMP, PUSH_SD, PUSH_TIME, TORQUE_SD, TORQUE_TIME,
    HELD_SD, HELD_NOISE, ZERO_DRIFT, SPEED_NOISE,
) = range(14)  # fmt: skip
CONSTANTS = 14
#: Places in the readings: current and whether the carriage is held, then angle and acceleration.
CURRENT, HELD = 0, 1


@part
def adjusted(x: Floats, q: FloatArray, fixed: Floats, out: FloatArray) -> float:
    """Write the recursion's parameters ``out`` (20,) with the errors in ``x``; return F_N in N."""
    scale = 1.0 + x[SCALE]
    out[:] = q
    out[6] = q[6] * (1.0 + x[GAIN])
    out[11] = q[11] / scale  # rolling resistance is of the true load
    out[13] = q[13] - x[PUSH]
    out[15] = q[15] + x[TORQUE]
    if x.shape[0] == FULL:
        out[16], out[17] = q[16] + x[RIPPLE], q[17] + x[RIPPLE + 1]
    return float(fixed[NORMAL] * scale)


@part
def columns(
    stage: int, x: Floats, v: float, w: float, z: float, q: FloatArray, fixed: Floats,
    rate: FloatArray, by_q: FloatArray, cosine: float, sine: float, by_x: FloatArray,
) -> None:  # fmt: skip
    """Write the derivatives of row ``stage`` of ``rate`` to the states from 4 on, (4, 3, n)."""
    u = rate[stage, 2] / q[3]
    force = z + q[4] * u + q[5] * (q[14] * w - v)
    by_x[stage, 0, PUSH] = 1.0
    by_x[stage, 1, TORQUE] = by_q[stage, 1, 15]
    by_x[stage, 0, SCALE] = fixed[NORMAL] * force / fixed[MASS]
    by_x[stage, 1, SCALE] = -q[14] * fixed[NORMAL] * force / q[9]
    by_x[stage, 1, GAIN] = by_q[stage, 1, 6] * q[6] / (1.0 + x[GAIN])
    if x.shape[0] == FULL:
        by_x[stage, 0, RIPPLE], by_x[stage, 0, RIPPLE + 1] = v * cosine, v * sine


@part
def carry(
    x: Floats, q: FloatArray, fixed: Floats, current: float, period: float, f: Floats,
    own: FloatArray, rate: FloatArray, by_state: FloatArray, by_q: FloatArray, by_x: FloatArray,
) -> None:  # fmt: skip
    """Carry ``x`` (n,) over ``period`` s with ``current`` in A; write the derivative ``f`` (n, n).

    ``rate`` (4, 3), ``by_state`` (4, 3, 3), ``by_q`` (4, 3, 20), ``by_x`` (4, 3, n) and ``own``
    (20,) are overwritten; entries of ``by_x`` that are always 0 must be 0.
    """
    n = x.shape[0]
    normal = adjusted(x, q, fixed, own)
    static = own[1] * math.exp(own[2])
    transitions = fixed[TRANSITIONS]
    f[:] = 0.0
    for i in range(n):
        f[i, i] = 1.0
    steps = int(fixed[STEPS])
    h = period / steps
    half, sixth = 0.5 * h, h / 6.0
    for _ in range(steps):
        angle, v, w, z = x[ANGLE], x[SPEED], x[TURNING], x[BRISTLE]
        for stage in range(4):
            reach = 0.0 if stage == 0 else (h if stage == 3 else half)
            before = stage - 1
            v_, w_, z_ = v, w, z
            if stage > 0:
                v_ += reach * rate[before, 0]
                w_ += reach * rate[before, 1]
                z_ += reach * rate[before, 2]
            phase = transitions * (angle + reach * w)
            cosine, sine = math.cos(phase), math.sin(phase)
            rates(
                stage, v_, w_, z_, own, static, current, cosine, sine, 0.0, fixed[MASS], normal,
                True, rate, by_state, by_q,
            )  # fmt: skip
            columns(stage, x, v_, w_, z_, own, fixed, rate, by_q, cosine, sine, by_x)
        x[ANGLE] += h * w + h * sixth * (rate[0, 1] + rate[1, 1] + rate[2, 1])
        x[SPEED] += sixth * (rate[0, 0] + 2.0 * rate[1, 0] + 2.0 * rate[2, 0] + rate[3, 0])
        x[TURNING] += sixth * (rate[0, 1] + 2.0 * rate[1, 1] + 2.0 * rate[2, 1] + rate[3, 1])
        x[BRISTLE] += sixth * (rate[0, 2] + 2.0 * rate[1, 2] + 2.0 * rate[2, 2] + rate[3, 2])
        for j in range(n):
            begin_v, begin_w, begin_z = f[SPEED, j], f[TURNING, j], f[BRISTLE, j]
            d_v, d_w, d_z = 0.0, 0.0, 0.0
            sum_v, sum_w, sum_z, path = 0.0, 0.0, 0.0, 0.0
            for stage in range(4):
                reach = 0.0 if stage == 0 else (h if stage == 3 else half)
                a, b, c = begin_v + reach * d_v, begin_w + reach * d_w, begin_z + reach * d_z
                s = by_state[stage]
                d_v = by_x[stage, 0, j] + s[0, 0] * a + s[0, 1] * b + s[0, 2] * c
                d_w = by_x[stage, 1, j] + s[1, 0] * a + s[1, 1] * b + s[1, 2] * c
                d_z = s[2, 0] * a + s[2, 1] * b + s[2, 2] * c
                weight = 2.0 if 0 < stage < 3 else 1.0
                sum_v += weight * d_v
                sum_w += weight * d_w
                sum_z += weight * d_z
                if stage < 3:
                    path += d_w
            f[ANGLE, j] += h * begin_w + h * sixth * path
            f[SPEED, j] = begin_v + sixth * sum_v
            f[TURNING, j] = begin_w + sixth * sum_w
            f[BRISTLE, j] = begin_z + sixth * sum_z


@part
def expected(
    x: Floats, q: FloatArray, fixed: Floats, current: float, h: Floats, own: FloatArray,
    rate: FloatArray, by_state: FloatArray, by_q: FloatArray, by_x: FloatArray,
) -> float:  # fmt: skip
    """Return the acceleration that the sensor should show; write its derivatives ``h[1]`` (n,)."""
    n = x.shape[0]
    normal = adjusted(x, q, fixed, own)
    v, w, z = x[SPEED], x[TURNING], x[BRISTLE]
    phase = fixed[TRANSITIONS] * x[ANGLE]
    cosine, sine = math.cos(phase), math.sin(phase)
    rates(
        0, v, w, z, own, own[1] * math.exp(own[2]), current, cosine, sine, 0.0, fixed[MASS], normal,
        True, rate, by_state, by_q,
    )  # fmt: skip
    columns(0, x, v, w, z, own, fixed, rate, by_q, cosine, sine, by_x)
    for j in range(n):
        h[1, j] = by_x[0, 0, j]
    for j in range(3):
        h[1, SPEED + j] = by_state[0, 0, j]
    h[1, ZERO] = 1.0
    found = rate[0, 0] + x[ZERO]
    if n == FULL:
        twice_cosine, twice_sine = cosine * cosine - sine * sine, 2.0 * sine * cosine
        h[1, SHAKE], h[1, SHAKE + 1] = v * twice_cosine, v * twice_sine
        shake = x[SHAKE] * twice_cosine + x[SHAKE + 1] * twice_sine
        h[1, SPEED] += shake
        found += v * shake
    return float(found)


@part
def noise(
    fixed: Floats, q: FloatArray, held: bool, was: bool, old: float, new: float, period: float,
    f: Floats, noises: Floats,
) -> None:  # fmt: skip
    """Let the unknown push and torque fade in ``f``, and write the covariance ``noises`` (n, n).

    ``old`` and ``new`` are the shares of the period for which the push is that at its begin and at
    its end; while the carriage is held, now or before (``was``), the two have nothing in common.
    """
    keep_push = 0.0 if held or was else math.exp(-period / fixed[PUSH_TIME])
    keep_torque = math.exp(-period / fixed[TORQUE_TIME])
    push = fixed[HELD_SD] if held else fixed[PUSH_SD]
    variance = push * push * (1.0 - keep_push * keep_push)
    for i in range(BRISTLE + 1):  # what the new push does to the state within the period
        reach = new * f[i, PUSH]
        noises[i, PUSH] = noises[PUSH, i] = reach * variance
        for j in range(BRISTLE + 1):
            noises[i, j] = reach * new * f[j, PUSH] * variance
    for i in range(BRISTLE + 1):
        f[i, PUSH] *= old
    f[PUSH, PUSH] = keep_push
    f[TORQUE, TORQUE] = keep_torque
    noises[PUSH, PUSH] = variance
    noises[TORQUE, TORQUE] = fixed[TORQUE_SD] ** 2 * (1.0 - keep_torque * keep_torque)
    noises[TURNING, TURNING] += (q[6] / q[9] * fixed[CURRENT_SD] * period) ** 2
    noises[SPEED, SPEED] += (fixed[HELD_NOISE] if held else fixed[SPEED_NOISE]) * period
    noises[ZERO, ZERO] = fixed[ZERO_DRIFT] * period


@part
def step_slip(
    t_ns: int, words: Times, times: Times, floats: Floats, places: Times, packed: Words
) -> None:
    """Compute the filter of slip for the cycle at ``t_ns``.

    ``floats`` has, behind the tables of the memory: x (n), P (n, n), innovations (2), a matrix that
    is overwritten (n, n), ``last`` (3), q (20), the other constants, R (2, 2), the first x and P,
    then as in :func:`carry` and :func:`noise` f (n, n), h (2, n), noises (n, n), learned (n), own,
    rate, by_state, by_q, by_x, and ``shown`` (3) and ``spread`` (3, 3), which get slip, carriage
    speed and the zero. ``last`` keeps the current of the cycle before, the angle at which the
    filter began, and whether the carriage was held.
    """
    given, held, row = cut(floats, places, 0), cut(floats, places, 1), cut(floats, places, 2)
    ages, current, clock, period_ns, lost_ns = cut_times(times, given.shape[0])
    x, off, last = cut(floats, places, 3), cut(floats, places, 5), cut(floats, places, 7)
    n, inputs = x.shape[0], held.shape[0]
    p, work = square(floats, places, 4, n), square(floats, places, 6, n)
    q, fixed, r = cut(floats, places, 8), cut(floats, places, 9), square(floats, places, 10, 2)
    f, h = square(floats, places, 13, n), square(floats, places, 14, n)
    noises, learned = square(floats, places, 15, n), cut(floats, places, 16)
    own, rate = cut(floats, places, 17), square(floats, places, 18, 3)
    by_state = cut(floats, places, 19).reshape((4, 3, 3))
    by_q = cut(floats, places, 20).reshape((4, 3, COUNT))
    by_x = cut(floats, places, 21).reshape((4, 3, n))
    shown, spread = cut(floats, places, 22), square(floats, places, 23, 3)
    period = period_ns * 1e-9
    steps = take(t_ns, words, period_ns, lost_ns, given, ages, held, current, clock)
    nis = math.nan
    if steps == 0:
        x[:], p[:] = cut(floats, places, 11), square(floats, places, 12, n)
        last[0] = held[CURRENT]
        last[1] = math.nan
        last[2] = 0.0
    grabbed = inputs > HELD and held[HELD] > 0.5
    was = last[2] > 0.5
    # The push jumps where the carriage is seized or released; between, its course is a trapezium.
    old, new = (0.0 if was != grabbed else (0.5 if grabbed else 1.0)), 0.0
    if grabbed:
        new = 0.5 if was else 1.0
    for number in range(steps):
        i = held[CURRENT]
        if number == 0:
            change = last[0] - i
            # The current loop is through with a jump long before the next cycle.
            jump = abs(change) > fixed[JUMP]
            i += change * (min(0.5, 1.0 / (LOOP_RATE * period)) if jump else 0.5)
        if number > 0:
            old, new, was = (0.5, 0.5, True) if grabbed else (1.0, 0.0, False)
        push = x[PUSH]
        x[PUSH] = old * push
        carry(x, q, fixed, i, period, f, own, rate, by_state, by_q, by_x)
        noise(fixed, q, grabbed, was, old, new, period, f, noises)
        x[PUSH] = push * f[PUSH, PUSH]
        x[TORQUE] *= f[TORQUE, TORQUE]
        predict(x, p, f, noises, work)
    last[0] = held[CURRENT]
    last[2] = 1.0 if grabbed else 0.0
    if steps >= 0:
        if math.isnan(last[1]):  # its first reading: where the encoder stands means nothing
            last[1] = given[inputs] - x[ANGLE]
        h[1, :] = 0.0
        off[1] = given[inputs + 1] - expected(
            x, q, fixed, held[CURRENT], h, own, rate, by_state, by_q, by_x
        )
        off[0] = given[inputs] - last[1] - x[ANGLE]
        for k in range(SCALE, n):
            learned[k] = 0.0 if grabbed or k == SCALE else 1.0
        nis = correct(x, p, h, r, off, current, inputs, learned)
    radius = q[14]
    shown[0], shown[1], shown[2] = radius * x[TURNING] - x[SPEED], x[SPEED], x[ZERO]
    spread[0, 0] = (
        radius * radius * p[TURNING, TURNING] - 2.0 * radius * p[TURNING, SPEED] + p[SPEED, SPEED]
    )
    spread[1, 1], spread[2, 2] = p[SPEED, SPEED], p[ZERO, ZERO]
    for k in range(n):
        if not (math.isfinite(x[k]) and p[k, k] >= 0.0):
            shown[0] = math.nan  # a sign of divergence, also in a state that is not shown
    publish(
        t_ns, words, steps >= 0, shown, spread, off, nis, inputs, current, clock, row, packed
    )  # fmt: skip
