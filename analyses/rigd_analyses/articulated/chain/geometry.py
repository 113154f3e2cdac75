"""What sizes and contacts of the modules mean for the motion of a chain, and where modules are."""

from __future__ import annotations

from typing import Final

import numpy as np

from rigd.analysis.result import FloatArray
from rigd_analyses.articulated.chain.kernel import (
    ADDED,
    AHEAD,
    BEHIND,
    HALF_BASE,
    HALF_TRACK,
    INERTIA,
    K_LAT,
    K_LON,
    MASS,
    RADIUS,
    ROLLING,
    VALUES,
)
from rigd_analyses.articulated.chain.layout import SIZES
from rigd_analyses.articulated.chain.needs import KINDS

#: Raw values of a module: contacts, then sizes; behind those of all modules stands gravity.
RAW: Final = (*KINDS, *SIZES)
K_ROLL, RADIUS_AT, TRACK_AT, BASE_AT, AHEAD_AT, BEHIND_AT, BODY, BODY_INERTIA, WHEEL, SPIN = range(
    2, 12
)


def derived(raw: FloatArray, directions: FloatArray, modules: int) -> tuple[FloatArray, FloatArray]:
    """Return the values (n, VALUES) of the modules, and their derivatives along ``directions``."""
    r, dr = raw[:-1].reshape(modules, -1), directions[:-1].reshape(modules, len(RAW), -1)
    g, dg = raw[-1], directions[-1]
    v, dv = np.zeros((modules, VALUES)), np.zeros((modules, VALUES, dr.shape[2]))
    for place, at in (
        (K_LON, 0), (K_LAT, 1), (RADIUS, RADIUS_AT), (HALF_TRACK, TRACK_AT), (HALF_BASE, BASE_AT),
        (AHEAD, AHEAD_AT), (BEHIND, BEHIND_AT),
    ):  # fmt: skip
        v[:, place], dv[:, place] = r[:, at], dr[:, at]
    v[:, MASS], dv[:, MASS] = r[:, BODY] + 4.0 * r[:, WHEEL], dr[:, BODY] + 4.0 * dr[:, WHEEL]
    load, by_load = 0.25 * g * v[:, MASS], 0.25 * (g * dv[:, MASS] + v[:, MASS, None] * dg)
    k, by_k, radius = r[:, K_ROLL], dr[:, K_ROLL], r[:, RADIUS_AT]
    v[:, ROLLING] = k * load / radius
    by = dr[:, RADIUS_AT]
    dv[:, ROLLING] = (by_k * load[:, None] + k[:, None] * by_load) / radius[:, None]
    dv[:, ROLLING] -= (v[:, ROLLING] / radius)[:, None] * by
    track, base, wheel = r[:, TRACK_AT], r[:, BASE_AT], r[:, WHEEL]
    v[:, INERTIA] = r[:, BODY_INERTIA] + 4.0 * wheel * (track**2 + base**2)
    dv[:, INERTIA] = dr[:, BODY_INERTIA] + 4.0 * (track**2 + base**2)[:, None] * dr[:, WHEEL]
    dv[:, INERTIA] += (
        8.0 * wheel[:, None] * (track[:, None] * dr[:, TRACK_AT] + base[:, None] * dr[:, BASE_AT])
    )
    v[:, ADDED] = r[:, SPIN] / radius**2
    dv[:, ADDED] = dr[:, SPIN] / (radius**2)[:, None] - (2.0 * v[:, ADDED] / radius)[:, None] * by
    return v, dv


def fastest(values: FloatArray) -> float:
    """Return the rate in 1/s of the fastest motion that contacts which grip give a module."""
    turning = values[:, K_LON] * values[:, HALF_TRACK] ** 2
    turning = (turning + values[:, K_LAT] * values[:, HALF_BASE] ** 2) / values[:, INERTIA]
    along, across = (values[:, at] / values[:, MASS] for at in (K_LON, K_LAT))
    return 4.0 * float(np.max([turning, along, across]))


def placed(
    values: FloatArray, by_values: FloatArray, pose: FloatArray, rate: FloatArray,
    by_pose: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:  # fmt: skip
    """Return poses (f, 3 n), their rates and derivatives (f, 3 n, lanes) of all modules.

    ``pose`` (f, n + 2) are the place of the first one and all headings.
    """
    n = len(values)
    out, pace = np.zeros((len(pose), 3 * n)), np.zeros((len(pose), 3 * n))
    by = np.zeros((len(pose), 3 * n, by_pose.shape[2]))
    x, y, vx, vy = pose[:, 0].copy(), pose[:, 1].copy(), rate[:, 0].copy(), rate[:, 1].copy()
    bx, by_y = by_pose[:, 0].copy(), by_pose[:, 1].copy()
    for i in range(n):
        for j, place in ((i - 1, BEHIND), (i, AHEAD)) if i else ():
            c, s = np.cos(pose[:, 2 + j]), np.sin(pose[:, 2 + j])
            arm, om = values[j, place], rate[:, 2 + j]
            x, y, vx, vy = x - arm * c, y - arm * s, vx + arm * s * om, vy - arm * c * om
            more, turned_by = by_values[j, place], by_pose[:, 2 + j]
            bx = bx - more * c[:, None] + arm * s[:, None] * turned_by
            by_y = by_y - more * s[:, None] - arm * c[:, None] * turned_by
        out[:, 3 * i], out[:, 3 * i + 1], out[:, 3 * i + 2] = x, y, pose[:, 2 + i]
        pace[:, 3 * i], pace[:, 3 * i + 1], pace[:, 3 * i + 2] = vx, vy, rate[:, 2 + i]
        by[:, 3 * i], by[:, 3 * i + 1], by[:, 3 * i + 2] = bx, by_y, by_pose[:, 2 + i]
    return out, pace, by


def motion(values: FloatArray, states: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return speeds along and across (f, n) in m/s, and yaw rates (f, n), of ``states``."""
    n = len(values)
    m = n + 2
    vx, vy = states[:, m].copy(), states[:, m + 1].copy()
    along, across = np.zeros((len(states), n)), np.zeros((len(states), n))
    om = states[:, m + 2 : m + 2 + n]
    for i in range(n):
        for j, place in ((i - 1, BEHIND), (i, AHEAD)) if i else ():
            vx = vx + values[j, place] * np.sin(states[:, 2 + j]) * om[:, j]
            vy = vy - values[j, place] * np.cos(states[:, 2 + j]) * om[:, j]
        c, s = np.cos(states[:, 2 + i]), np.sin(states[:, 2 + i])
        along[:, i], across[:, i] = c * vx + s * vy, c * vy - s * vx
    return along, across, np.asarray(om)
