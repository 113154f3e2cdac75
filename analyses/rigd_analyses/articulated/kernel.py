"""Simulates the articulated robot from the speeds of its wheels, with derivatives, compiled.

The equations are those of articulated.md section 2, in the frame of the rear module; the contacts
follow the paper's law, which jumps from mu_s to mu_d. Each contact keeps its branch for a step, and
a step is cut where one leaves it. Derivatives go along with the motion (forward sensitivities): 15
lanes through the linearised equations, and at each cut the jump that the moved instant makes
(saltation; Leine and Nijmeijer, Dynamics and Bifurcations of Non-Smooth Mechanical Systems, 2004,
sec. 7.1).

The rear wheels turn freely and follow the ground within 0.4 ms. Their spin is taken as that of
rolling: what turns them is their inertia and their rolling resistance, whether they slide or not.
Beside a lateral force at which they slide, their longitudinal force (2 % of the load) is nothing.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rigd.analysis.kernel import kernel

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Integers = NDArray[np.int64]
#: Parameters of a simulation, in this order.
NAMES: Final = (
    *("k_lon", "k_lat", "k_roll", "wheel_radius", "half_track", "half_wheelbase"),
    *("hinge_distance", "body_mass", "body_inertia", "wheel_inertia", "gravity", "hinge"),
    *("wheel_mass", "mu_s", "mu_d"),
)
#: Behind them: 0 of the paper's law; of others, the share of mu_s N over which contacts let go.
WIDTH: Final = len(NAMES)
W0: Final = 0.2  #: rad/s, of the tanh that replaces the sign of Eq. 12 (articulated.md 1.6)
LANES: Final = 16  #: derivatives that go along; the last is that to time, at a cut
TIME: Final = LANES - 1
#: States: place of the front centre, rear heading, hinge angle (front less rear heading), velocity
#: of the front centre along and across the rear module, yaw rates, integrals of contact torques.
X, Y, TH2, G, VU, VV, W1, W2, QR, QL = range(10)
STATES: Final = 10
CONTACTS: Final = 6  #: front wheels in the paper's order, then rear axles, whose wheels are alike
#: What may disturb a robot: speeds of the wheels, forces along and across and a moment on the front
#: module, a force across and a moment on the rear one.
DISTURBED: Final = 7
EVENTS: Final = 32  #: cuts of a step; contacts that still alternate then keep their branch
LOCATED: Final = 1e-12  #: share of a step to which a cut is located
BEYOND: Final = 1e-9  #: squared force over squared limit, less 1, beyond which a branch is left
STOPPED: Final = 1e-9  #: rate of that in 1/s below which the instant of a cut has no derivative
#: Results of `rates` for `tangents`; those of front contact k are at FRONT + 8 k.
CG, SG, C2, S2, U1, V1, U2, V2, ALONG, ACROSS, TURN, DR, DL, F2V, GU, AU, AV, A1, A2 = range(19)
A2U, LOAD, HR, HL, M11, M12, M22, FU, FV, HB, LAT_F, LAT_R = range(19, 31)
FRONT: Final = 32  #: slip, eta, f_lon, f_lat, P, Pc, Gaa, Gac
GCC: Final = 64
WORK: Final = 80
MOVED, ROWS = STATES, STATES + CONTACTS  #: rows that `tangents` writes; the last: of excess


@kernel
def gradual(force: float, limit: float, sliding: float, width: float) -> float:
    """Return the share of ``force`` that a contact carries, letting go over (1 +- width) mu_s N.

    ``limit`` is mu_s N and ``sliding`` mu_d N.
    """
    at = min((force / limit - 1.0 + width) / (2.0 * width), 1.0)
    if at <= 0.0:
        return 1.0
    return 1.0 + at * at * (3.0 - 2.0 * at) * (sliding / force - 1.0)


@kernel
def rates(p: Floats, right: float, left: float, y: Floats, slides: Flags, dy: Floats, w: Floats,
          excess: Floats) -> None:  # fmt: skip
    """Write dy/dt (STATES,), ``w``, and how far contacts are beyond mu_s N: none, if gradual."""
    k_lon, k_lat, k_roll, r, b, d, arm = p[0], p[1], p[2], p[3], p[4], p[5], p[6]
    width = p[WIDTH]
    m = p[7] + 4.0 * p[12]
    inertia = p[8] + 4.0 * p[12] * (b * b + d * d)
    load = m * p[10] / 4.0
    limit, sliding = p[13] * load, p[14] * load
    cg, sg = math.cos(y[G]), math.sin(y[G])
    c2, s2 = math.cos(y[TH2]), math.sin(y[TH2])
    vu, vv, w1, w2 = y[VU], y[VV], y[W1], y[W2]
    u1, v1 = vu * cg + vv * sg, -vu * sg + vv * cg
    along, across, turn = 0.0, 0.0, 0.0
    dy[QR], dy[QL] = 0.0, 0.0
    for k in range(4):
        side, end = (1.0 if k & 1 else -1.0), (1.0 if k < 2 else -1.0)
        slip = r * (left if k & 1 else right) - u1 + side * b * w1
        eta = v1 + end * d * w1
        a, c = k_lon * slip, k_lat * eta
        square = a * a + c * c
        excess[k] = square / (limit * limit) - 1.0
        at = FRONT + 8 * k
        if slides[k]:
            h = math.sqrt(max(square, 1e-300))
            a_h, c_h, s_h = a / h, c / h, sliding / h
            w[at + 2], w[at + 3] = sliding * a_h, -sliding * c_h
            w[at + 4], w[at + 5] = a_h, c_h
            w[at + 6], w[at + 7], w[GCC + k] = s_h * c_h * c_h, -s_h * a_h * c_h, s_h * a_h * a_h
        else:
            share = gradual(math.sqrt(square), limit, sliding, width) if width > 0.0 else 1.0
            w[at + 2], w[at + 3], w[at + 4], w[at + 5] = share * a, -share * c, 0.0, 0.0
            w[at + 6], w[at + 7], w[GCC + k] = 1.0, 0.0, 1.0
            excess[k] = -1.0 if width > 0.0 else excess[k]
        w[at], w[at + 1] = slip, eta
        along += w[at + 2]
        across += w[at + 3]
        turn += end * d * w[at + 3] - side * b * w[at + 2]
        dy[QL if k & 1 else QR] += r * w[at + 2]
    hr, hl = math.tanh(right / W0), math.tanh(left / W0)
    dy[QR] += 2.0 * k_roll * load * hr
    dy[QL] += 2.0 * k_roll * load * hl
    u2, v2 = vu + arm * w1 * sg, vv - arm * (w1 * cg + w2)
    rolling = 2.0 * k_roll * load / r
    dr, dl = math.tanh((u2 + b * w2) / (r * W0)), math.tanh((u2 - b * w2) / (r * W0))
    for k in range(2):
        eta = v2 + (d * w2 if k == 0 else -d * w2)
        c = k_lat * eta
        excess[4 + k] = c * c / (limit * limit) - 1.0
        w[LAT_F + k] = -sliding * math.copysign(1.0, c) if slides[4 + k] else -c
        if width > 0.0:
            w[LAT_F + k] *= gradual(abs(c), limit, sliding, width)
            excess[4 + k] = -1.0
    f2v = 2.0 * (w[LAT_F] + w[LAT_R])
    t2 = 2.0 * d * (w[LAT_F] - w[LAT_R]) - b * rolling * (dr - dl)
    added = 4.0 * p[9] / (r * r)
    ml, mll = m * arm, m * arm * arm
    fu, fv = along * cg - across * sg, along * sg + across * cg
    hb = vv * w2 + arm * w1 * cg * (w1 - w2)
    drag = -rolling * (dr + dl)
    mass = 2.0 * m + added
    mu = (m + added) * arm * sg
    qu = fu + drag - ml * (cg * w1 * w1 + w2 * w2) - added * hb
    qv = fv + f2v - ml * sg * w1 * w1
    q1 = turn + arm * (drag * sg - f2v * cg) - mll * sg * w2 * w2 - added * hb * arm * sg
    q2 = t2 - arm * f2v + mll * sg * w1 * w1
    m11 = inertia + mll + added * arm * arm * sg * sg - mu * mu / mass - 0.5 * mll * cg * cg
    m12 = 0.5 * mll * cg
    m22 = inertia + 0.5 * mll + added * b * b
    r1, r2 = q1 - mu / mass * qu + 0.5 * arm * cg * qv, q2 + 0.5 * arm * qv
    det = m11 * m22 - m12 * m12
    a1, a2 = (m22 * r1 - m12 * r2) / det, (m11 * r2 - m12 * r1) / det
    au, av = (qu - mu * a1) / mass, (qv + ml * (cg * a1 + a2)) / (2.0 * m)
    dy[X], dy[Y] = vu * c2 - vv * s2, vu * s2 + vv * c2
    dy[TH2], dy[G] = w2, w1 - w2
    dy[VU], dy[VV], dy[W1], dy[W2] = au + vv * w2, av - vu * w2, a1, a2
    w[CG], w[SG], w[C2], w[S2], w[U1], w[V1], w[U2], w[V2] = cg, sg, c2, s2, u1, v1, u2, v2
    w[ALONG], w[ACROSS], w[TURN], w[DR], w[DL], w[F2V] = along, across, turn, dr, dl, f2v
    a2u = au + arm * sg * a1 + hb
    w[GU], w[AU], w[AV], w[A1], w[A2], w[A2U] = drag - added * a2u, au, av, a1, a2, a2u
    w[LOAD], w[HR], w[HL], w[M11], w[M12], w[M22] = load, hr, hl, m11, m12, m22
    w[FU], w[FV], w[HB] = fu, fv, hb


@kernel
def tangents(p: Floats, dp: Floats, y: Floats, dy: Floats, slides: Flags, w: Floats, push: Floats,
             out: Floats) -> None:  # fmt: skip
    """Write the derivatives ``out`` of the rates for those of the state ``dy``.

    ``dp`` (15, LANES) are those of the parameters, ``push`` (DISTURBED, LANES) those of what
    disturbs; ``out`` gets those of the contacts' excess behind the rates, (ROWS, LANES). All are
    flat: at known distances the compiler computes several lanes at once.
    """
    k_lon, k_lat, k_roll, r, b, d, arm = p[0], p[1], p[2], p[3], p[4], p[5], p[6]
    inertia, gravity, wheel, static = p[9], p[10], p[12], p[13]
    m, load = p[7] + 4.0 * wheel, w[LOAD]
    limit = static * load
    cg, sg, c2, s2, u1, v1, u2 = w[CG], w[SG], w[C2], w[S2], w[U1], w[V1], w[U2]
    vu, vv, w1, w2 = y[VU], y[VV], y[W1], y[W2]
    au, av, a1, a2, a2u, gu, f2v = w[AU], w[AV], w[A1], w[A2], w[A2U], w[GU], w[F2V]
    added, ml, mll = 4.0 * inertia / (r * r), m * arm, m * arm * arm
    mass = 2.0 * m + added
    mu = (m + added) * arm * sg
    m11, m12, m22 = w[M11], w[M12], w[M22]
    by_det, by_mass, by_half = 1.0 / (m11 * m22 - m12 * m12), 1.0 / mass, 0.5 / m
    by_r, by_w0, by_limit, mu_m = 1.0 / r, 1.0 / (r * W0), 1.0 / limit, mu / mass
    dr, dl, along, across = w[DR], w[DL], w[ALONG], w[ACROSS]
    rolling = 2.0 * k_roll * load / r
    of_r, of_l = rolling * (1.0 - dr * dr), rolling * (1.0 - dl * dl)
    rear_r, rear_l = (u2 + b * w2) * by_w0, (u2 - b * w2) * by_w0
    over = 2.0 * by_limit * by_limit
    spin_r, spin_l = (w[FRONT] + u1 + b * w1) / r, (w[FRONT + 8] + u1 - b * w1) / r
    by_hr, by_hl = (1.0 - w[HR] * w[HR]) / W0, (1.0 - w[HL] * w[HL]) / W0
    lat0, lat1 = w[LAT_F], w[LAT_R]
    slide0, slide1 = slides[4], slides[5]
    e0, e1 = w[V2] + d * w2, w[V2] - d * w2
    s0, s1 = math.copysign(1.0, e0), math.copysign(1.0, e1)
    for n in range(LANES):
        dg, dvu, dvv = dy[G * LANES + n], dy[VU * LANES + n], dy[VV * LANES + n]
        dw1, dw2, drad = dy[W1 * LANES + n], dy[W2 * LANES + n], dp[3 * LANES + n]
        db, dd, darm = dp[4 * LANES + n], dp[5 * LANES + n], dp[6 * LANES + n]
        dkl, dkt, dkr = dp[n], dp[LANES + n], dp[2 * LANES + n]
        dmw = 4.0 * dp[12 * LANES + n]
        dm = dp[7 * LANES + n] + dmw
        dload = 0.25 * (dm * gravity + m * dp[10 * LANES + n])
        dlimit = dp[13 * LANES + n] * load + static * dload
        dslide = dp[14 * LANES + n] * load + p[14] * dload
        dcg, dsg = -sg * dg, cg * dg
        du1 = dvu * cg + dvv * sg + v1 * dg
        dv1 = -dvu * sg + dvv * cg - u1 * dg
        dlo, dla, dturn = push[2 * LANES + n], push[3 * LANES + n], push[4 * LANES + n]
        dqr = 2.0 * w[HR] * (dkr * load + k_roll * dload)
        dqr += 2.0 * k_roll * load * by_hr * push[n]
        dql = 2.0 * w[HL] * (dkr * load + k_roll * dload)
        dql += 2.0 * k_roll * load * by_hl * push[LANES + n]
        slip_r = drad * spin_r + r * push[n] - du1 - db * w1 - b * dw1
        slip_l = drad * spin_l + r * push[LANES + n] - du1 + db * w1 + b * dw1
        dt1 = dd * w1 + d * dw1
        for k in range(4):
            at = FRONT + 8 * k
            side, end = (1.0 if k & 1 else -1.0), (1.0 if k < 2 else -1.0)
            a, c = k_lon * w[at], k_lat * w[at + 1]
            da = dkl * w[at] + k_lon * (slip_l if k & 1 else slip_r)
            dc = dkt * w[at + 1] + k_lat * (dv1 + end * dt1)
            flon = w[at + 4] * dslide + w[at + 6] * da + w[at + 7] * dc
            flat = -(w[at + 5] * dslide + w[at + 7] * da + w[GCC + k] * dc)
            passed = a * da + c * dc - (a * a + c * c) * by_limit * dlimit
            out[(MOVED + k) * LANES + n] = over * passed
            dlo += flon
            dla += flat
            dturn += end * (dd * w[at + 3] + d * flat) - side * (db * w[at + 2] + b * flon)
            if k & 1:
                dql += drad * w[at + 2] + r * flon
            else:
                dqr += drad * w[at + 2] + r * flon
        dl_sg = darm * sg + arm * dsg
        du2 = dvu + dw1 * arm * sg + w1 * dl_sg
        dv2 = dvv - darm * (w1 * cg + w2) - arm * (dw1 * cg + w1 * dcg + dw2)
        t2 = dd * w2 + d * dw2
        c0, c1 = dkt * e0 + k_lat * (dv2 + t2), dkt * e1 + k_lat * (dv2 - t2)
        out[(MOVED + 4) * LANES + n] = over * k_lat * e0 * (c0 - k_lat * e0 * by_limit * dlimit)
        out[(MOVED + 5) * LANES + n] = over * k_lat * e1 * (c1 - k_lat * e1 * by_limit * dlimit)
        dlat0 = -s0 * dslide if slide0 else -c0
        dlat1 = -s1 * dslide if slide1 else -c1
        df2v = 2.0 * (dlat0 + dlat1) + push[5 * LANES + n]
        droll = (2.0 * (dkr * load + k_roll * dload) - rolling * drad) * by_r
        dbw = db * w2 + b * dw2
        ddr = droll * dr + of_r * ((du2 + dbw) * by_w0 - rear_r * drad * by_r)
        ddl = droll * dl + of_l * ((du2 - dbw) * by_w0 - rear_l * drad * by_r)
        dadded = 4.0 * (dp[9 * LANES + n] - 2.0 * inertia * drad * by_r) * by_r * by_r
        dhb = (
            dvv * w2 + vv * dw2 + (darm * cg + arm * dcg) * w1 * (w1 - w2)
            + arm * cg * (dw1 * (w1 - w2) + w1 * (dw1 - dw2))
        )  # fmt: skip
        dgu = -ddr - ddl - dadded * a2u - added * (dl_sg * a1 + dhb)
        dml = dm * arm + m * darm
        dmll = (dm * arm + 2.0 * m * darm) * arm
        di = dp[8 * LANES + n] + dmw * (b * b + d * d) + 8.0 * wheel * (b * db + d * dd)
        dfu = dlo * cg + along * dcg - dla * sg - across * dsg
        dfv = dlo * sg + along * dsg + dla * cg + across * dcg
        qu = (
            dfu + dgu - 2.0 * dm * au - dml * (sg * a1 + cg * w1 * w1 + w2 * w2)
            - ml * (dsg * a1 + dcg * w1 * w1 + 2.0 * (cg * w1 * dw1 + w2 * dw2))
        )  # fmt: skip
        qv = (
            dfv + df2v - 2.0 * dm * av + dml * (cg * a1 + a2 - sg * w1 * w1)
            + ml * (dcg * a1 - dsg * w1 * w1 - 2.0 * sg * w1 * dw1)
        )  # fmt: skip
        q1 = (
            dturn + darm * (gu * sg - f2v * cg)
            + arm * (dgu * sg + gu * dsg - df2v * cg - f2v * dcg)
            - dml * (sg * au - cg * av) - ml * (dsg * au - dcg * av) - di * a1
            - dmll * (a1 + cg * a2 + sg * w2 * w2)
            - mll * (dcg * a2 + dsg * w2 * w2 + 2.0 * sg * w2 * dw2)
        )  # fmt: skip
        q2 = (
            push[6 * LANES + n]
            + 2.0 * dd * (lat0 - lat1) + 2.0 * d * (dlat0 - dlat1)
            - db * rolling * (dr - dl) - b * (ddr - ddl) - darm * f2v - arm * df2v
            + dml * av - dmll * (cg * a1 + a2 - sg * w1 * w1) - di * a2
            - mll * (dcg * a1 - dsg * w1 * w1 - 2.0 * sg * w1 * dw1)
            - dadded * b * b * a2 - 2.0 * added * b * db * a2
        )  # fmt: skip
        r1, r2 = q1 - mu_m * qu + 0.5 * arm * cg * qv, q2 + 0.5 * arm * qv
        da1, da2 = (m22 * r1 - m12 * r2) * by_det, (m11 * r2 - m12 * r1) * by_det
        dau, dav = (qu - mu * da1) * by_mass, (qv + ml * (cg * da1 + da2)) * by_half
        dth2 = dy[TH2 * LANES + n]
        out[X * LANES + n] = dvu * c2 - dvv * s2 - (vu * s2 + vv * c2) * dth2
        out[Y * LANES + n] = dvu * s2 + dvv * c2 + (vu * c2 - vv * s2) * dth2
        out[TH2 * LANES + n], out[G * LANES + n] = dw2, dw1 - dw2
        out[VU * LANES + n] = dau + dvv * w2 + vv * dw2
        out[VV * LANES + n] = dav - dvu * w2 - vu * dw2
        out[W1 * LANES + n], out[W2 * LANES + n] = da1, da2
        out[QR * LANES + n], out[QL * LANES + n] = dqr, dql


@kernel
def farthest(slides: Flags, excess: Floats) -> float:
    """Return how far the contact that is farthest beyond its branch is; negative: none is."""
    worst = -1.0
    for k in range(CONTACTS):
        worst = max(worst, -excess[k] if slides[k] else excess[k])
    return worst


@kernel
def place(p: Floats, dp: Floats, y: Floats, dy: Floats, tangent: Floats, moving: bool, pose: Floats,
          rate: Floats, moved: Floats) -> None:  # fmt: skip
    """Write the poses (6,) of both modules, their rates (6,) and, if ``moving``, derivatives."""
    arm, th1, th2 = p[6], y[TH2] + y[G], y[TH2]
    c1, s1, c2, s2 = math.cos(th1), math.sin(th1), math.cos(th2), math.sin(th2)
    w1, w2 = y[W1], y[W2]
    pose[0], pose[1], pose[2], pose[5] = y[X], y[Y], th1, th2
    pose[3], pose[4] = y[X] - arm * (c1 + c2), y[Y] - arm * (s1 + s2)
    rate[0], rate[1], rate[2], rate[5] = dy[X], dy[Y], w1, w2
    rate[3], rate[4] = dy[X] + arm * (s1 * w1 + s2 * w2), dy[Y] - arm * (c1 * w1 + c2 * w2)
    if moving:
        for n in range(TIME):
            d2 = tangent[TH2, n]
            d1 = d2 + tangent[G, n]
            moved[0, n], moved[1, n], moved[2, n] = tangent[X, n], tangent[Y, n], d1
            moved[3, n] = tangent[X, n] - dp[6, n] * (c1 + c2) + arm * (s1 * d1 + s2 * d2)
            moved[4, n] = tangent[Y, n] - dp[6, n] * (s1 + s2) - arm * (c1 * d1 + c2 * d2)
            moved[5, n] = d2


@kernel
def advance(p: Floats, dp: Floats, speeds: Floats, pushes: Floats, disturbed: bool, h: float,
            y: Floats, tangent: Floats, slides: Flags, moving: bool, new: Floats,
            new_tangent: Floats, k: Floats, kt: Floats, begun: Floats, w: Floats,
            excess: Floats) -> None:  # fmt: skip
    """Take a step of Runge-Kutta (4th order) to ``new``; ``k`` (6, STATES) and ``kt`` are work.

    ``speeds`` (2, 2) and ``pushes`` (2, DISTURBED, LANES) are those at its begin and its end. The
    rates at its begin are in ``k[0]`` and ``begun``, those at its end, and the contacts' excess
    there, come to ``k[4]``, ``w`` and ``excess``.
    """
    sixth, push = h / 6.0, pushes[2]
    if moving:
        push[:] = pushes[0]
        tangents(p, dp, y, tangent, slides, begun, push, kt[0])
    for stage in range(1, 5):
        share = 0.5 if stage < 3 else 1.0
        for j in range(STATES):
            if stage == 4:
                new[j] = y[j] + sixth * (k[0, j] + 2.0 * (k[1, j] + k[2, j]) + k[3, j])
            else:
                new[j] = y[j] + share * h * k[stage - 1, j]
        right = speeds[0, 0] + share * (speeds[1, 0] - speeds[0, 0])
        left = speeds[0, 1] + share * (speeds[1, 1] - speeds[0, 1])
        rates(p, right, left, new, slides, k[stage], w, excess)
        if moving and stage < 4:
            for j in range(STATES * LANES):
                new_tangent[j] = tangent[j] + share * h * kt[stage - 1, j]
            if disturbed:
                for j in range(DISTURBED * LANES):
                    push[j] = pushes[0, j] + share * (pushes[1, j] - pushes[0, j])
            tangents(p, dp, new, new_tangent, slides, w, push, kt[stage])
    if moving:
        for j in range(STATES * LANES):
            total = kt[0, j] + 2.0 * (kt[1, j] + kt[2, j]) + kt[3, j]
            new_tangent[j] = tangent[j] + sixth * total


@kernel
def leap(p: Floats, dp: Floats, speeds: Floats, slope: Floats, push: Floats, y: Floats,
         tangent: Floats, slides: Flags, moving: bool, k: Floats, kt: Floats, w: Floats,
         excess: Floats) -> None:  # fmt: skip
    """Change the branch of the contact that leaves it, and the derivatives by what that moves.

    ``speeds`` (2,) and their rates ``slope`` (2,) are those at the cut, as ``k[4]`` and ``excess``.
    """
    worst = 0
    for j in range(CONTACTS):
        beyond = -excess[j] if slides[j] else excess[j]
        if beyond > (-excess[worst] if slides[worst] else excess[worst]):
            worst = j
    if moving:
        for j in range(STATES):
            tangent[j * LANES + TIME] = k[4, j]
        push[TIME], push[LANES + TIME] = slope[0], slope[1]
        tangents(p, dp, y, tangent, slides, w, push, kt[5])
        push[TIME], push[LANES + TIME] = 0.0, 0.0
        for j in range(STATES):
            tangent[j * LANES + TIME] = 0.0
    slides[worst] = not slides[worst]
    moved = kt[5, (MOVED + worst) * LANES : (MOVED + worst + 1) * LANES]
    if moving and abs(moved[TIME]) > STOPPED:
        rates(p, speeds[0], speeds[1], y, slides, k[5], w, excess)
        for j in range(STATES):
            jump = (k[4, j] - k[5, j]) / moved[TIME]
            for n in range(TIME):
                tangent[j * LANES + n] -= jump * moved[n]


@kernel
def simulate(p: Floats, dp: Floats, speeds: Floats, grid: Floats, frames_at: Integers, late: float,
             disturbed: Floats, moving: bool) -> tuple[Floats, ...]:  # fmt: skip
    """Return what a camera sees, and the motors feel, at the frames in ``frames_at`` (f,).

    ``p`` (16,) are the parameters (NAMES) and WIDTH, ``dp`` (15, LANES) which of them a lane is the
    derivative to; ``speeds`` (n, 2) those of the wheels in rad/s, right and left, at the times
    ``grid`` (n,) in s, straight in between: a frame is at one of these, the last at the last;
    ``late`` is the latency in s. ``disturbed`` (n, DISTURBED, LANES), or none, is what moves the
    robot besides, for a unit of each lane. The front centre starts at rest in the origin, heading
    along x less the hinge's angle of the rear one.

    For the f frames: poses (f, 6) and their rates (f, 6), integrals of the contact torques (f, 2)
    in N m s, the derivatives of poses and integrals (f, 6, LANES), (f, 2, LANES); contact forces
    (f, CONTACTS, 3): along and across in N (rear: of a wheel, across alone), and whether it slides;
    and the largest force of each contact over its load without sliding (CONTACTS,).
    """
    n, frames, now = speeds.shape[0], frames_at.size, 0
    pose, rate, torque = np.zeros((frames, 6)), np.zeros((frames, 6)), np.zeros((frames, 2))
    lanes = LANES if moving else 0
    by_pose, by_torque = np.zeros((frames, 6, lanes)), np.zeros((frames, 2, lanes))
    forces, share = np.zeros((frames, CONTACTS, 3)), np.zeros(CONTACTS)
    y, new = np.zeros(STATES), np.zeros(STATES)
    tangent, new_tangent = np.zeros(STATES * LANES), np.zeros(STATES * LANES)
    k, kt = np.zeros((6, STATES)), np.zeros((6, ROWS * LANES))
    begun, w, excess = np.zeros(WORK), np.zeros(WORK), np.zeros(CONTACTS)
    slides = np.zeros(CONTACTS, np.bool_)
    two, pushes, slope = np.zeros((2, 2)), np.zeros((3, DISTURBED * LANES)), np.zeros(2)
    by, acting = dp.reshape(-1), disturbed.reshape(disturbed.shape[0], DISTURBED * LANES)
    acts, rows = acting.shape[0] > 0, tangent.reshape(STATES, LANES)
    at, after = np.zeros((2, 6)), np.zeros((2, 6))
    at_moved, after_moved = np.zeros((6, LANES)), np.zeros((6, LANES))
    y[TH2], y[G] = -p[11], p[11]
    for lane in range(LANES):
        rows[TH2, lane], rows[G, lane] = -dp[11, lane], dp[11, lane]
    rates(p, speeds[0, 0], speeds[0, 1], y, slides, k[4], w, excess)
    shown = 0
    for i in range(n):
        if i == frames_at[now]:
            frame = now
            now = min(now + 1, frames - 1)
            torque[frame, 0], torque[frame, 1] = y[QR], y[QL]
            if moving:
                by_torque[frame] = rows[QR:]
            for j in range(CONTACTS):
                if j < 4:
                    forces[frame, j, 0] = w[FRONT + 8 * j + 2]
                forces[frame, j, 1] = w[FRONT + 8 * j + 3] if j < 4 else w[LAT_F + j - 4]
                forces[frame, j, 2] = 1.0 if slides[j] else 0.0
        if i == n - 1:
            break
        step = grid[i + 1] - grid[i]
        seen = shown < frames and (grid[frames_at[shown]] - late < grid[i + 1] or i >= n - 2)
        if seen:
            place(p, dp, y, k[4], rows, moving, at[0], at[1], at_moved)
        done, events = 0.0, 0
        for j in range(2):
            slope[j] = (speeds[i + 1, j] - speeds[i, j]) / step
        while done < 1.0:
            end, left = 1.0, (1.0 - done) * step
            for j in range(2):
                two[0, j], two[1, j] = speeds[i, j] + done * step * slope[j], speeds[i + 1, j]
            if moving and acts:
                pushes[0] = acting[i] + done * (acting[i + 1] - acting[i])
                pushes[1] = acting[i + 1]
            k[0], begun[:] = k[4], w
            advance(p, by, two, pushes, acts, left, y, tangent, slides, moving, new, new_tangent,
                    k, kt, begun, w, excess)  # fmt: skip
            leaves = farthest(slides, excess) > BEYOND and events < EVENTS
            if leaves:
                low, high, located = done, 1.0, False
                while not located:
                    end = 0.5 * (low + high)
                    left = (end - done) * step
                    for j in range(2):
                        two[1, j] = speeds[i, j] + end * step * slope[j]
                    advance(p, by, two, pushes, acts, left, y, tangent, slides, False, new,
                            new_tangent, k, kt, begun, w, excess)  # fmt: skip
                    beyond = farthest(slides, excess)
                    located = abs(beyond) <= LOCATED or high - low <= LOCATED
                    low, high = (low, end) if beyond > 0.0 else (end, high)
                if moving:
                    if acts:
                        pushes[1] = acting[i] + end * (acting[i + 1] - acting[i])
                    advance(p, by, two, pushes, acts, left, y, tangent, slides, True, new,
                            new_tangent, k, kt, begun, w, excess)  # fmt: skip
            y[:] = new
            if moving:
                tangent[:] = new_tangent
            for j in range(CONTACTS):
                share[j] = max(share[j], math.sqrt(max(excess[j] + 1.0, 0.0)) * p[13])
            if leaves:
                leap(p, by, two[1], slope, pushes[1], y, tangent, slides, moving, k, kt, w, excess)
                events += 1
                rates(p, two[1, 0], two[1, 1], y, slides, k[4], w, excess)
            done = end
        if seen:
            place(p, dp, y, k[4], rows, moving, after[0], after[1], after_moved)
        while seen and shown < frames:
            due = grid[frames_at[shown]] - late
            if due >= grid[i + 1] and i < n - 2:
                break
            s = 0.0 if due < grid[0] else (due - grid[i]) / step
            for j in range(6):
                p0, p1, v0, v1 = at[0, j], after[0, j], step * at[1, j], step * after[1, j]
                rest = p1 - p0
                bend, twist = 3.0 * rest - 2.0 * v0 - v1, v0 + v1 - 2.0 * rest
                pose[shown, j] = p0 + s * (v0 + s * (bend + s * twist))
                pace = (v0 + s * (2.0 * bend + 3.0 * s * twist)) / step
                rate[shown, j] = 0.0 if due < grid[0] else pace
                if moving:
                    for lane in range(LANES):
                        m0, m1 = at_moved[j, lane], after_moved[j, lane]
                        by_pose[shown, j, lane] = m0 + s * (m1 - m0)
            shown += 1
    return pose, rate, torque, by_pose, by_torque, forces, share
