"""Simulates the articulated robot from the speeds of its wheels, in compiled code.

The equations are those of articulated.md section 2 while no contact slides (the forces are in
proportion to the slip). Real and complex parameters are both taken: the imaginary part of a
result is its derivative (complex step; Squire and Trapp, SIAM Review 40, 1998), exact to rounding.

The rear wheels turn freely and follow the ground within 0.4 ms. Their spin is taken as that of
rolling: what turns them is their inertia and their rolling resistance.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from rigd.analysis.kernel import kernel

#: Real or complex.
Numbers = NDArray[Any]
#: Parameters of a simulation, in this order.
NAMES: Final = (
    *("k_lon", "k_lat", "k_roll", "wheel_radius", "half_track", "half_wheelbase"),
    *("hinge_distance", "body_mass", "body_inertia", "wheel_inertia", "gravity", "hinge"),
    "wheel_mass",
)
W0: Final = 0.2  #: rad/s, of the tanh that replaces the sign of Eq. 12 (articulated.md 1.6)
ROUNDS: Final = 3  #: the rear wheels' inertia is a tenth of what it acts on: 1e-3 of it is left
#: Columns of a row: poses of both centres, their rates, contact torques of both sides, load share.
POSE: Final = slice(0, 6)
RATE: Final = slice(6, 12)
TORQUE: Final = slice(12, 14)
SHARE: Final = 14
WIDTH: Final = 15


@kernel
def rates(
    p: Numbers, y: Numbers, right: float, left: float, lagged: Numbers, dy: Numbers, out: Numbers
) -> None:
    """Write dy/dt (8,) and a row of results (WIDTH,); ``lagged`` (2,) are rear accelerations."""
    k_lon, k_lat, k_roll, r, b, d = p[0], p[1], p[2], p[3], p[4], p[5]
    arm, i_w, m_w = p[6], p[9], p[12]
    m = p[7] + 4.0 * m_w
    inertia = p[8] + 4.0 * m_w * (b * b + d * d)
    load = m * p[10] / 4.0
    c1, s1, c2, s2 = np.cos(y[2]), np.sin(y[2]), np.cos(y[3]), np.sin(y[3])
    vx, vy, w1, w2 = y[4], y[5], y[6], y[7]
    u, v = vx * c1 + vy * s1, -vx * s1 + vy * c1
    slip_r, slip_l = r * right - u - b * w1, r * left - u + b * w1
    fx = 2.0 * k_lon * (slip_r + slip_l)
    fy = -4.0 * k_lat * v
    t1 = -4.0 * k_lat * d * d * w1 + 2.0 * b * k_lon * (slip_r - slip_l)
    f1x, f1y = c1 * fx - s1 * fy, s1 * fx + c1 * fy
    x2, y2 = vx + arm * (w1 * s1 + w2 * s2), vy - arm * (w1 * c1 + w2 * c2)
    u2, v2 = x2 * c2 + y2 * s2, -x2 * s2 + y2 * c2
    drag_r = 2.0 * k_roll * load * np.tanh((u2 + b * w2) / (r * W0)) / r
    drag_l = 2.0 * k_roll * load * np.tanh((u2 - b * w2) / (r * W0)) / r
    gy = -4.0 * k_lat * v2
    added = 4.0 * i_w / (r * r)
    m_r, cg, sg = 0.5 * m, c1 * c2 + s1 * s2, s1 * c2 - c1 * s2
    a11 = inertia + m_r * arm * arm
    a12 = m_r * arm * arm * cg
    det = a11 * a11 - a12 * a12
    for _ in range(ROUNDS):
        gx = -drag_r - drag_l - added * lagged[0]
        t2 = -4.0 * k_lat * d * d * w2 - b * (drag_r - drag_l) - added * b * b * lagged[1]
        f2x, f2y = c2 * gx - s2 * gy, s2 * gx + c2 * gy
        dx, dyy = 0.5 * (f2x - f1x), 0.5 * (f2y - f1y)
        q1 = t1 + arm * (s1 * dx - c1 * dyy) - m_r * arm * arm * sg * w2 * w2
        q2 = t2 + arm * (s2 * dx - c2 * dyy) + m_r * arm * arm * sg * w1 * w1
        a1, a2 = (a11 * q1 - a12 * q2) / det, (a11 * q2 - a12 * q1) / det
        ax = arm * (c1 * w1 * w1 + s1 * a1) + arm * (c2 * w2 * w2 + s2 * a2)
        ay = arm * (s1 * w1 * w1 - c1 * a1) + arm * (s2 * w2 * w2 - c2 * a2)
        bx, by = (f1x + f2x - m * ax) / (2.0 * m), (f1y + f2y - m * ay) / (2.0 * m)
        lagged[0] = (bx + ax) * c2 + (by + ay) * s2 + v2 * w2
        lagged[1] = a2
    dy[0], dy[1], dy[2], dy[3] = vx, vy, w1, w2
    dy[4], dy[5], dy[6], dy[7] = bx, by, a1, a2
    out[0], out[1], out[2] = y[0], y[1], y[2]
    out[3], out[4], out[5] = y[0] - arm * (c1 + c2), y[1] - arm * (s1 + s2), y[3]
    out[6], out[7], out[8], out[9], out[10], out[11] = vx, vy, w1, x2, y2, w2
    rolling = 2.0 * k_roll * load
    out[12] = 2.0 * r * k_lon * slip_r + rolling * np.tanh(right / W0)
    out[13] = 2.0 * r * k_lon * slip_l + rolling * np.tanh(left / W0)
    lon = k_lon.real * max(abs(slip_r.real), abs(slip_l.real))
    lat = k_lat.real * (abs(v.real) + abs(d.real * w1.real))
    lat2 = k_lat.real * (abs(v2.real) + abs(d.real * w2.real))
    out[14] = max(np.sqrt(lon * lon + lat * lat), lat2) / load.real


@kernel
def simulate(p: Numbers, speeds: NDArray[np.float64], step: float) -> Numbers:
    """Return a row of results at each of n times ``step`` s apart, (n, WIDTH).

    ``p`` are the parameters (NAMES), real or complex; ``speeds`` (n, 2) those of the wheels, right
    and left, in rad/s, straight lines in between. The front centre starts at rest in the origin,
    heading along x.
    """
    n = speeds.shape[0]
    rows = np.zeros((n, WIDTH), p.dtype)
    y, at = np.zeros(8, p.dtype), np.zeros(8, p.dtype)
    k1, k2 = np.zeros(8, p.dtype), np.zeros(8, p.dtype)
    k3, k4 = np.zeros(8, p.dtype), np.zeros(8, p.dtype)
    lagged, unused = np.zeros(2, p.dtype), np.zeros(WIDTH, p.dtype)
    y[3] = -p[11]
    for i in range(n):
        rates(p, y, speeds[i, 0], speeds[i, 1], lagged, k1, rows[i])
        if i == n - 1:
            break
        right = 0.5 * (speeds[i, 0] + speeds[i + 1, 0])
        left = 0.5 * (speeds[i, 1] + speeds[i + 1, 1])
        for j in range(8):
            at[j] = y[j] + 0.5 * step * k1[j]
        rates(p, at, right, left, lagged, k2, unused)
        for j in range(8):
            at[j] = y[j] + 0.5 * step * k2[j]
        rates(p, at, right, left, lagged, k3, unused)
        for j in range(8):
            at[j] = y[j] + step * k3[j]
        rates(p, at, speeds[i + 1, 0], speeds[i + 1, 1], lagged, k4, unused)
        for j in range(8):
            y[j] += step / 6.0 * (k1[j] + 2.0 * (k2[j] + k3[j]) + k4[j])
    return rows
