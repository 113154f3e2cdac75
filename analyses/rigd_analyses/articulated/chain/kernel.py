"""Simulates a chain of modules on gripping wheels from the speeds of its motors, compiled.

The equations of motion are those of Newton and Euler, written by recursion along the chain (Luh,
Walker and Paul, J. Dyn. Sys. Meas. Control 102, 1980): velocities and accelerations go from the
first module to the last, forces of the hinges back. Derivatives of the motion go along with it
(forward sensitivities), in any number of lanes: the residual forces of the recursion are
differentiated at the accelerations that solve them.

Contact forces are in proportion to the slip (articulated.md 2): no contact slides. A wheel without
a motor follows the ground within 0.4 ms; its spin is taken as that of rolling.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rigd.analysis.kernel import kernel

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
W0: Final = 0.2  #: rad/s, of the tanh that replaces the sign of Eq. 12 (articulated.md 1.6)
#: Values of a module: contacts per wheel, rolling force at the rim of a wheel in N, sizes,
#: distances of the hinges, mass and inertia with wheels, what a rolling wheel adds to the mass.
K_LON, K_LAT, ROLLING, RADIUS, HALF_TRACK, HALF_BASE, AHEAD, BEHIND, MASS, INERTIA, ADDED = range(
    11
)
VALUES: Final = 11
#: What :func:`rates` leaves of a module for :func:`tangents`.
COS, SIN, U, LAT, AX, AY, GAINED, ALONG, ACROSS, TURN, SUM_X, SUM_Y, TANH_R, TANH_L = range(14)
WORK: Final = 14
FORCES: Final = 3  #: that may act on a module besides: along, across, moment


@kernel
def lever(v: Floats, i: int, j: int) -> float:
    """Return by how much the centre of module ``i`` is behind along module ``j``, in m."""
    return (v[j, AHEAD] if j > 0 else 0.0) + (v[j, BEHIND] if j < i else 0.0)


@kernel
def rates(v: Floats, count: Floats, spin: Floats, y: Floats, dy: Floats, w: Floats, h: Floats,
          z: Floats) -> None:  # fmt: skip
    """Write dy/dt, and what :func:`tangents` takes of it.

    ``v`` (n, VALUES) are the modules, ``count`` (n, 2) how many wheels of each right and left side
    have a motor, ``spin`` (n, 2) the sum of their speeds in rad/s. The state ``y`` (3 n + 4,) is
    the place of the first centre, headings, their rates in the same order, and the ways along each
    module. ``h`` (n + 2, n + 2) gets the factor of the masses, ``z`` (n + 2,) the accelerations.
    """
    n = v.shape[0]
    m = n + 2
    for a in range(m):
        z[a] = 0.0
        for b in range(m):
            h[a, b] = 0.0
    vx, vy, gx, gy = y[m], y[m + 1], 0.0, 0.0
    for i in range(n):
        c, s, om = math.cos(y[2 + i]), math.sin(y[2 + i]), y[m + 2 + i]
        w[i, COS], w[i, SIN] = c, s
        if i > 0:
            back, cj, sj, oj = v[i - 1, BEHIND], w[i - 1, COS], w[i - 1, SIN], y[m + 1 + i]
            vx, vy = vx + back * sj * oj, vy - back * cj * oj
            gx, gy = gx + back * cj * oj * oj, gy + back * sj * oj * oj
            ahead = v[i, AHEAD]
            vx, vy = vx + ahead * s * om, vy - ahead * c * om
            gx, gy = gx + ahead * c * om * om, gy + ahead * s * om * om
        u, lat = c * vx + s * vy, c * vy - s * vx
        w[i, U], w[i, LAT] = u, lat
        half, r = v[i, HALF_TRACK], v[i, RADIUS]
        biased = c * gx + s * gy + om * lat
        along, turn = 0.0, -4.0 * v[i, K_LAT] * v[i, HALF_BASE] * v[i, HALF_BASE] * om
        for side in range(2):
            arm = half if side == 0 else -half
            over, driven = u + arm * om, count[i, side]
            sign = math.tanh(over / (r * W0))
            force = v[i, K_LON] * (r * spin[i, side] - driven * over)
            force -= (2.0 - driven) * (v[i, ROLLING] * sign + v[i, ADDED] * biased)
            w[i, TANH_R + side] = sign
            along += force
            turn += arm * force
        across = -4.0 * v[i, K_LAT] * lat
        w[i, ALONG], w[i, ACROSS], w[i, TURN] = along, across, turn
        mass = v[i, MASS]
        fx, fy = c * along - s * across - mass * gx, s * along + c * across - mass * gy
        right, left = (2.0 - count[i, 0]) * v[i, ADDED], (2.0 - count[i, 1]) * v[i, ADDED]
        both, apart = right + left, half * (right - left)
        z[0] += fx
        z[1] += fy
        z[2 + i] += turn
        h[0, 0] += mass + both * c * c
        h[1, 0] += both * c * s
        h[1, 1] += mass + both * s * s
        for j in range(i + 1):
            far = lever(v, i, j)
            px, py = far * w[j, SIN], -far * w[j, COS]
            along_j = c * px + s * py
            z[2 + j] += px * fx + py * fy
            h[2 + j, 0] += mass * px + both * along_j * c
            h[2 + j, 1] += mass * py + both * along_j * s
            for k in range(j + 1):
                far = lever(v, i, k)
                qx, qy = far * w[k, SIN], -far * w[k, COS]
                h[2 + j, 2 + k] += mass * (px * qx + py * qy) + both * along_j * (c * qx + s * qy)
            if apart != 0.0:
                h[2 + i, 2 + j] += apart * along_j
                if j == i:
                    h[2 + i, 2 + i] += apart * along_j
        h[2 + i, 0] += apart * c
        h[2 + i, 1] += apart * s
        h[2 + i, 2 + i] += v[i, INERTIA] + both * half * half
    for a in range(m):  # Cholesky
        for b in range(a + 1):
            total = h[a, b]
            for k in range(b):
                total -= h[a, k] * h[b, k]
            h[a, b] = math.sqrt(total) if a == b else total / h[b, b]
    for a in range(m):
        for b in range(a):
            z[a] -= h[a, b] * z[b]
        z[a] /= h[a, a]
    for a in range(m - 1, -1, -1):
        for b in range(a + 1, m):
            z[a] -= h[b, a] * z[b]
        z[a] /= h[a, a]
    for a in range(m):
        dy[a], dy[m + a] = y[m + a], z[a]
    ax, ay = z[0], z[1]
    for i in range(n):
        c, s, om, al = w[i, COS], w[i, SIN], y[m + 2 + i], z[2 + i]
        if i > 0:
            back, cj, sj = v[i - 1, BEHIND], w[i - 1, COS], w[i - 1, SIN]
            oj, aj = y[m + 1 + i], z[1 + i]
            ax, ay = ax + back * (cj * oj * oj + sj * aj), ay + back * (sj * oj * oj - cj * aj)
            ahead = v[i, AHEAD]
            ax, ay = ax + ahead * (c * om * om + s * al), ay + ahead * (s * om * om - c * al)
        gained = c * ax + s * ay + om * w[i, LAT]
        w[i, AX], w[i, AY], w[i, GAINED] = ax, ay, gained
        along, turn = 0.0, -4.0 * v[i, K_LAT] * v[i, HALF_BASE] * v[i, HALF_BASE] * om
        half, r = v[i, HALF_TRACK], v[i, RADIUS]
        for side in range(2):
            arm = half if side == 0 else -half
            over, driven = w[i, U] + arm * om, count[i, side]
            force = v[i, K_LON] * (r * spin[i, side] - driven * over)
            rolled = v[i, ROLLING] * w[i, TANH_R + side] + v[i, ADDED] * (gained + arm * al)
            force -= (2.0 - driven) * rolled
            along += force
            turn += arm * force
        w[i, ALONG], w[i, TURN] = along, turn
        dy[2 * m + i] = w[i, U]
    sx, sy = 0.0, 0.0
    for i in range(n - 1, -1, -1):
        c, s, mass = w[i, COS], w[i, SIN], v[i, MASS]
        sx += c * w[i, ALONG] - s * w[i, ACROSS] - mass * w[i, AX]
        sy += s * w[i, ALONG] + c * w[i, ACROSS] - mass * w[i, AY]
        w[i, SUM_X], w[i, SUM_Y] = sx, sy


@kernel
def tangents(v: Floats, dv: Floats, count: Floats, spin: Floats, y: Floats, dy: Floats, w: Floats,
             h: Floats, z: Floats, push: Floats, out: Floats, room: Floats) -> None:  # fmt: skip
    """Write the derivatives ``out`` (3 n + 4, lanes) of the rates for those of the state ``dy``.

    ``dv`` (n, VALUES, lanes) are those of the modules, ``push`` (n, FORCES, lanes), or none, forces
    and a moment on each. ``room`` (4 + 3 n, lanes) is room for what is computed on the way.
    """
    n, lanes = v.shape[0], out.shape[1]
    m, pushed = n + 2, push.shape[0] > 0
    for k in range(lanes):
        room[0, k], room[1, k], room[2, k], room[3, k] = dy[m, k], dy[m + 1, k], 0.0, 0.0
        out[0, k], out[1, k] = dy[m, k], dy[m + 1, k]
    for i in range(n):
        c, s, om, al = w[i, COS], w[i, SIN], y[m + 2 + i], z[2 + i]
        u, lat, ax, ay, gained = w[i, U], w[i, LAT], w[i, AX], w[i, AY], w[i, GAINED]
        k_lon, k_lat, rolling, r = v[i, K_LON], v[i, K_LAT], v[i, ROLLING], v[i, RADIUS]
        half, base, added, mass = v[i, HALF_TRACK], v[i, HALF_BASE], v[i, ADDED], v[i, MASS]
        along, across, twist = w[i, ALONG], w[i, ACROSS], 4.0 * k_lat * base * base
        cj, sj, oj, aj, back = 0.0, 0.0, 0.0, 0.0, 0.0
        p = i - 1 if i > 0 else 0
        ahead = v[i, AHEAD] if i > 0 else 0.0
        if i > 0:
            cj, sj, oj, aj, back = w[p, COS], w[p, SIN], y[m + 2 + p], z[2 + p], v[p, BEHIND]
        linked = 1.0 if i > 0 else 0.0
        for k in range(lanes):
            dth, dom = dy[2 + i, k], dy[m + 2 + i, k]
            dtj, doj = dy[2 + p, k], dy[m + 2 + p, k]
            db, da = linked * dv[p, BEHIND, k], linked * dv[i, AHEAD, k]
            dvx = room[0, k] + db * sj * oj + back * (cj * dtj * oj + sj * doj)
            dvy = room[1, k] - db * cj * oj + back * (sj * dtj * oj - cj * doj)
            dvx += da * s * om + ahead * (c * dth * om + s * dom)
            dvy += -da * c * om + ahead * (s * dth * om - c * dom)
            dax = room[2, k] + db * (cj * oj * oj + sj * aj)
            dax += back * (-sj * dtj * oj * oj + 2.0 * cj * oj * doj + cj * dtj * aj)
            day = room[3, k] + db * (sj * oj * oj - cj * aj)
            day += back * (cj * dtj * oj * oj + 2.0 * sj * oj * doj + sj * dtj * aj)
            dax += da * (c * om * om + s * al)
            dax += ahead * (-s * dth * om * om + 2.0 * c * om * dom + c * dth * al)
            day += da * (s * om * om - c * al)
            day += ahead * (c * dth * om * om + 2.0 * s * om * dom + s * dth * al)
            room[0, k], room[1, k], room[2, k], room[3, k] = dvx, dvy, dax, day
            du, dlat = c * dvx + s * dvy + lat * dth, c * dvy - s * dvx - u * dth
            dgained = c * dax + s * day + (c * ay - s * ax) * dth + dom * lat + om * dlat
            dhalf, dr, dk = dv[i, HALF_TRACK, k], dv[i, RADIUS, k], dv[i, K_LON, k]
            droll, dadd = dv[i, ROLLING, k], dv[i, ADDED, k]
            dalong = 0.0
            dbase, dkt = dv[i, HALF_BASE, k], dv[i, K_LAT, k]
            dturn = -4.0 * (dkt * base + 2.0 * k_lat * dbase) * base * om - twist * dom
            for side in range(2):
                way = 1.0 if side == 0 else -1.0
                driven, sign, spun = count[i, side], w[i, TANH_R + side], spin[i, side]
                over, dover = u + way * half * om, du + way * (dhalf * om + half * dom)
                more, dmore = gained + way * half * al, dgained + way * dhalf * al
                force = k_lon * (r * spun - driven * over)
                force -= (2.0 - driven) * (rolling * sign + added * more)
                df = dk * (r * spun - driven * over) + k_lon * (dr * spun - driven * dover)
                slope = (1.0 - sign * sign) / (r * W0) * (dover - over * dr / r)
                df -= (2.0 - driven) * (
                    droll * sign + rolling * slope + dadd * more + added * dmore
                )
                dalong += df
                dturn += way * (dhalf * force + half * df)
            dacross = -4.0 * (dkt * lat + k_lat * dlat)
            if pushed:
                dalong += push[i, 0, k]
                dacross += push[i, 1, k]
                dturn += push[i, 2, k]
            dm = dv[i, MASS, k]
            room[4 + 3 * i, k] = (
                c * dalong - s * dacross - (s * along + c * across) * dth - dm * ax - mass * dax
            )
            room[5 + 3 * i, k] = (
                s * dalong + c * dacross + (c * along - s * across) * dth - dm * ay - mass * day
            )
            room[6 + 3 * i, k] = dturn - dv[i, INERTIA, k] * al
            out[2 + i, k] = dom
            out[2 * m + i, k] = du
    for k in range(lanes):
        room[0, k], room[1, k] = 0.0, 0.0
    for i in range(n - 1, -1, -1):
        c, s = w[i, COS], w[i, SIN]
        ahead, back = (v[i, AHEAD] if i > 0 else 0.0), (v[i, BEHIND] if i < n - 1 else 0.0)
        q = i + 1 if i < n - 1 else i
        first, last = (1.0 if i > 0 else 0.0), (1.0 if i < n - 1 else 0.0)
        sx, sy = w[i, SUM_X], w[i, SUM_Y]
        bx, by = last * w[q, SUM_X], last * w[q, SUM_Y]
        for k in range(lanes):
            dth = dy[2 + i, k]
            dbx, dby = room[0, k], room[1, k]
            dsx, dsy = dbx + room[4 + 3 * i, k], dby + room[5 + 3 * i, k]
            room[0, k], room[1, k] = dsx, dsy
            found = room[6 + 3 * i, k]
            found -= first * dv[i, AHEAD, k] * (c * sy - s * sx)
            found -= ahead * (c * dsy - s * dsx - (c * sx + s * sy) * dth)
            found -= last * dv[i, BEHIND, k] * (c * by - s * bx)
            found -= back * (c * dby - s * dbx - (c * bx + s * by) * dth)
            out[m + 2 + i, k] = found
    for k in range(lanes):
        out[m, k], out[m + 1, k] = room[0, k], room[1, k]
    for a in range(m):
        for b in range(a):
            f = h[a, b]
            for k in range(lanes):
                out[m + a, k] -= f * out[m + b, k]
        f = 1.0 / h[a, a]
        for k in range(lanes):
            out[m + a, k] *= f
    for a in range(m - 1, -1, -1):
        for b in range(a + 1, m):
            f = h[b, a]
            for k in range(lanes):
                out[m + a, k] -= f * out[m + b, k]
        f = 1.0 / h[a, a]
        for k in range(lanes):
            out[m + a, k] *= f


@kernel
def simulate(v: Floats, dv: Floats, count: Floats, spins: Floats, grid: Floats, frames_at: Integers,
             late: float, headings: Floats, by_headings: Floats,
             pushes: Floats) -> tuple[Floats, Floats, Floats, Floats, Floats]:  # fmt: skip
    """Return what a camera sees, and the states, at the frames in ``frames_at`` (f,).

    ``v, dv, count`` as in :func:`rates` and :func:`tangents`; ``spins`` (t, n, 2) at the times
    ``grid`` (t,) in s, straight in between; ``late`` is the latency in s; ``headings`` (n,) those
    of the start, with derivatives ``by_headings`` (n, lanes), where the first centre rests in the
    origin; ``pushes`` (t, n, FORCES, lanes), or none, act besides. Steps are by Runge-Kutta of
    order 4.

    For the f frames: place of the first centre and headings as the camera shows them (f, n + 2),
    their rates, their derivatives (f, n + 2, lanes); the states (f, 3 n + 4) without latency, and
    their derivatives (f, 3 n + 4, lanes).
    """
    n, lanes, steps, frames = v.shape[0], dv.shape[2], spins.shape[0], frames_at.size
    m, size = n + 2, 3 * n + 4
    moving, pushed = lanes > 0, pushes.shape[0] > 0
    pose, rate = np.zeros((frames, m)), np.zeros((frames, m))
    by_pose = np.zeros((frames, m, lanes))
    states, by_states = np.zeros((frames, size)), np.zeros((frames, size, lanes))
    y, new, k = np.zeros(size), np.zeros(size), np.zeros((4, size))
    t, moved, kt = np.zeros((size, lanes)), np.zeros((size, lanes)), np.zeros((4, size, lanes))
    before, at = np.zeros((m, lanes)), np.zeros(size)
    w, h, z = np.zeros((n, WORK)), np.zeros((m, m)), np.zeros(m)
    spin, room = np.zeros((n, 2)), np.zeros((4 + 3 * n, lanes))
    push = np.zeros((n, FORCES, lanes)) if pushed else np.zeros((0, FORCES, lanes))
    y[2:m] = headings
    t[2:m] = by_headings
    now, shown = 0, 0
    for i in range(steps):
        if i == frames_at[now]:
            states[now], by_states[now] = y, t
            now = min(now + 1, frames - 1)
        if i == steps - 1:
            break
        step = grid[i + 1] - grid[i]
        seen = shown < frames and (grid[frames_at[shown]] - late < grid[i + 1] or i >= steps - 2)
        at[:] = y
        if seen and moving:
            before[:] = t[:m]
        for stage in range(4):
            share = 0.0 if stage == 0 else (0.5 if stage < 3 else 1.0)
            for j in range(size):
                new[j] = y[j] + share * step * k[stage - 1, j] if stage else y[j]
            for j in range(n):
                for side in range(2):
                    first = spins[i, j, side]
                    spin[j, side] = first + share * (spins[i + 1, j, side] - first)
            rates(v, count, spin, new, k[stage], w, h, z)
            if moving:
                for j in range(size):
                    for lane in range(lanes):
                        moved[j, lane] = t[j, lane]
                        if stage:
                            moved[j, lane] += share * step * kt[stage - 1, j, lane]
                if pushed:
                    push[:] = pushes[i] + share * (pushes[i + 1] - pushes[i])
                tangents(v, dv, count, spin, new, moved, w, h, z, push, kt[stage], room)
        sixth = step / 6.0
        for j in range(size):
            y[j] += sixth * (k[0, j] + 2.0 * (k[1, j] + k[2, j]) + k[3, j])
            for lane in range(lanes):
                total = kt[0, j, lane] + 2.0 * (kt[1, j, lane] + kt[2, j, lane]) + kt[3, j, lane]
                t[j, lane] += sixth * total
        while seen and shown < frames:
            due = grid[frames_at[shown]] - late
            if due >= grid[i + 1] and i < steps - 2:
                break
            s = 0.0 if due < grid[0] else (due - grid[i]) / step
            for j in range(m):
                p0, p1, v0, v1 = at[j], y[j], step * at[m + j], step * y[m + j]
                rest = p1 - p0
                bend, twist = 3.0 * rest - 2.0 * v0 - v1, v0 + v1 - 2.0 * rest
                pose[shown, j] = p0 + s * (v0 + s * (bend + s * twist))
                pace = (v0 + s * (2.0 * bend + 3.0 * s * twist)) / step
                rate[shown, j] = 0.0 if due < grid[0] else pace
                for lane in range(lanes):
                    m0, m1 = before[j, lane], t[j, lane]
                    by_pose[shown, j, lane] = m0 + s * (m1 - m0)
            shown += 1
    return pose, rate, by_pose, states, by_states
