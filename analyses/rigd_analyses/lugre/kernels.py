"""The bristle recursion with forward sensitivities, compiled.

With z = sigma_0 p the model is dz/dt = sigma_0 (V - |V| z / g(V)). For a slip V constant over a
sample (its midpoint value) z relaxes exactly towards sign(V) g:

    z+ = s g + (z - s g) exp(-sigma_0 |V| dt / g)

    F/F_N = z + sigma_1 (V - |V| z / g) + sigma_2 V

with the corrected Eq. 6, g = mu_c + (mu_s - mu_c) exp(-sqrt|V / V_s|) (the paper's misses a "+").
Parameters are q = (V_s, mu_c, ln(mu_s/mu_c), sigma_0, sigma_1, sigma_2); sigma_1 and sigma_2 are
linear. lugre.md section 5.
"""

from __future__ import annotations

import numpy as np

from rigd.analysis.kernel import kernel
from rigd.analysis.result import FloatArray

COUNT = 6


@kernel
def stribeck(v: float, v_s: float, mu_c: float, rise: float) -> tuple[float, float, float, float]:
    """Return g and its derivatives to V_s, mu_c and ln(mu_s/mu_c) at ``v``.

    ``rise`` = mu_s/mu_c - 1.
    """
    root = np.sqrt(abs(v) / v_s)
    decay = np.exp(-root)
    shape = 1.0 + rise * decay
    return (
        mu_c * shape,
        mu_c * rise * decay * root / (2.0 * v_s),
        shape,
        mu_c * (rise + 1.0) * decay,
    )


@kernel
def _advance(z: float, q: FloatArray, rise: float, v: float, dt: float) -> float:
    """Return ``z`` after ``dt`` s at the slip ``v`` in m/s."""
    if v == 0.0:
        return z
    g = stribeck(v, q[0], q[1], rise)[0]
    target = g if v > 0.0 else -g
    after: float = target + (z - target) * np.exp(-q[3] * abs(v) * dt / g)
    return after


@kernel
def _advance_all(
    z: float, z0: float, z1: float, z2: float, z3: float,
    q: FloatArray, rise: float, v: float, dt: float,
) -> tuple[float, float, float, float, float]:  # fmt: skip
    """Return ``z`` and its derivatives to q[0] to q[3] after ``dt`` s at the slip ``v`` in m/s."""
    if v == 0.0:
        return z, z0, z1, z2, z3
    speed = abs(v)
    g, g0, g1, g2 = stribeck(v, q[0], q[1], rise)
    sign = 1.0 if v > 0.0 else -1.0
    rate = q[3] * speed * dt / g
    e = np.exp(-rate)
    gap = z - sign * g
    by_g = sign * (1.0 - e) + gap * e * rate / g
    return (
        sign * g + gap * e,
        e * z0 + by_g * g0,
        e * z1 + by_g * g1,
        e * z2 + by_g * g2,
        e * z3 - gap * e * rate / q[3],
    )


@kernel
def _derivatives(
    row: FloatArray, q: FloatArray, rise: float, v: float,
    z: float, z0: float, z1: float, z2: float, z3: float,
) -> None:  # fmt: skip
    """Write d(F/F_N)/dq at the slip ``v`` in m/s into ``row`` (6,)."""
    speed = abs(v)
    g, g0, g1, g2 = stribeck(v, q[0], q[1], rise)
    hold = 1.0 - q[4] * speed / g
    direct = q[4] * speed * z / (g * g)
    row[0] = hold * z0 + direct * g0
    row[1] = hold * z1 + direct * g1
    row[2] = hold * z2 + direct * g2
    row[3] = hold * z3
    row[4] = v - speed * z / g
    row[5] = v


@kernel
def predict(
    q: FloatArray, v: FloatArray, v_mid: FloatArray, dt: FloatArray, first: FloatArray
) -> FloatArray:
    """Return F/F_N (n,) for slip ``v`` (n,) in m/s.

    ``v_mid[k]`` is the slip between samples k-1 and k, ``dt[k]`` that interval in s, and
    ``first[k]`` is 1 where a trial begins: the bristle is at rest there.
    """
    rise = np.expm1(q[2])
    out = np.empty_like(v)
    z = 0.0
    for k in range(v.shape[0]):
        z = 0.0 if first[k] != 0.0 else _advance(z, q, rise, v_mid[k], dt[k])
        g = stribeck(v[k], q[0], q[1], rise)[0]
        out[k] = z + q[4] * (v[k] - abs(v[k]) * z / g) + q[5] * v[k]
    return out


@kernel
def cost(
    q: FloatArray,
    v: FloatArray,
    v_mid: FloatArray,
    dt: FloatArray,
    first: FloatArray,
    measured: FloatArray,
    weights: FloatArray,
) -> float:
    """Return half the weighted sum of squares of prediction minus ``measured``."""
    rise = np.expm1(q[2])
    total = 0.0
    z = 0.0
    for k in range(v.shape[0]):
        z = 0.0 if first[k] != 0.0 else _advance(z, q, rise, v_mid[k], dt[k])
        if weights[k] != 0.0:
            g = stribeck(v[k], q[0], q[1], rise)[0]
            r = z + q[4] * (v[k] - abs(v[k]) * z / g) + q[5] * v[k] - measured[k]
            total += weights[k] * r * r
    return 0.5 * total


@kernel
def sensitivities(
    q: FloatArray, v: FloatArray, v_mid: FloatArray, dt: FloatArray, first: FloatArray
) -> FloatArray:
    """Return d(F/F_N)/dq, (n, 6), by forward propagation through the exact update."""
    n = v.shape[0]
    rise = np.expm1(q[2])
    out = np.zeros((n, 6))
    z = z0 = z1 = z2 = z3 = 0.0
    for k in range(n):
        if first[k] != 0.0:
            z = z0 = z1 = z2 = z3 = 0.0
        else:
            z, z0, z1, z2, z3 = _advance_all(z, z0, z1, z2, z3, q, rise, v_mid[k], dt[k])
        _derivatives(out[k], q, rise, v[k], z, z0, z1, z2, z3)
    return out


@kernel
def normal_equations(
    q: FloatArray,
    v: FloatArray,
    v_mid: FloatArray,
    dt: FloatArray,
    first: FloatArray,
    measured: FloatArray,
    weights: FloatArray,
) -> tuple[float, FloatArray, FloatArray]:
    """Return cost, J'Wr (6,) and J'WJ (6, 6) in one pass that stores no Jacobian."""
    rise = np.expm1(q[2])
    total = 0.0
    gradient = np.zeros(6)
    information = np.zeros((6, 6))
    row = np.empty(6)
    z = z0 = z1 = z2 = z3 = 0.0
    for k in range(v.shape[0]):
        if first[k] != 0.0:
            z = z0 = z1 = z2 = z3 = 0.0
        else:
            z, z0, z1, z2, z3 = _advance_all(z, z0, z1, z2, z3, q, rise, v_mid[k], dt[k])
        weight = weights[k]
        if weight == 0.0:
            continue
        _derivatives(row, q, rise, v[k], z, z0, z1, z2, z3)
        r = z + q[4] * row[4] + q[5] * v[k] - measured[k]
        total += weight * r * r
        for i in range(6):
            weighted = weight * row[i]
            gradient[i] += weighted * r
            for j in range(i, 6):
                information[i, j] += weighted * row[j]
    for i in range(6):
        for j in range(i):
            information[i, j] = information[j, i]
    return 0.5 * total, gradient, information
