"""Integrates one trial of the rig with its forward sensitivities (compiled code).

State y = (v, w, z): carriage speed in m/s, wheel speed in rad/s, bristle deflection times sigma_0.
With V = r w - v, u = V - |V| z / g(V) and S(s) = tanh(s / 1 mm/s) (lugre.md section 2, items 1 to
13, without lateral motion):

    m dv/dt = F_N f - (F_guide + mu_rol F_N) S(v) - c v - m a_slope + m v ripple(angle)
    I dw/dt = K (i + i_0) - T_0 S(r w) - b w - r F_N f
      dz/dt = sigma_0 u,   f = z + sigma_1 u + sigma_2 V,   ripple = A_c cos(N a) + A_s sin(N a)

K, T_0, b and I are at the wheel, behind gear and efficiency. The ripple follows the measured wheel
angle, a = measured + wheel_delay * its rate. Runge-Kutta of fourth order with the period of the
samples, or parts of it that are no longer than 1 ms: the fastest rate while sliding is about 350
1/s, that of dry friction at rest 2200 1/s, and steps beyond 2.8 of its times are not stable. A
period takes eight steps if the current jumps in it, which then follows the jump through the
amplifier's 1 kHz, and if carriage or wheel may turn: dry friction turns its sign within a
millisecond, and so do the derivatives. With 16 times as many steps (64 in a jump) slip travel moves
by 4e-8 m at most, a thousandth of a count, and carriage travel by 7e-7 m.

The sensitivities are those of the discrete recursion: exact derivatives of what is computed.
"""

from __future__ import annotations

import math

import numpy as np

from rigd.analysis.kernel import inlined, kernel
from rigd.analysis.result import FloatArray

#: Parameters of the recursion, in this order; the last is the trial's own.
NAMES = (
    "V_s", "mu_c", "ln(mu_s/mu_c)", "sigma_0", "sigma_1", "sigma_2", "drive_gain", "no_load",
    "wheel_viscous", "wheel_inertia", "guide_friction", "rolling_resistance", "drag", "slope",
    "wheel_radius", "current_zero", "ripple_cos", "ripple_sin", "wheel_delay", "first_bristle",
)  # fmt: skip
COUNT = len(NAMES)
SMOOTH_M_S = 1e-3  #: speed over which dry friction turns its sign
FINE_STEPS = 8  #: where the current jumps, and where carriage or wheel turn
TURNING_M_S = 6e-3
LONGEST_STEP_S = 1e-3
LOOP_RATE = 2.0 * math.pi * 1000.0  #: 1/s, of the amplifier's current loop
SATURATED = 19.1  #: beyond it tanh is 1 in double precision
#: Columns of the states: carriage position, wheel angle, acceleration, both speeds, z; the
#: sensitivities have all but the last.
POSITION, ANGLE, ACCELERATION, SPEED, WHEEL_SPEED, BRISTLE = range(6)


@kernel
def steps_of(period: float, fine: bool) -> int:
    """Return the steps of one period."""
    steps = max(1, math.ceil(period / LONGEST_STEP_S - 0.1))  # clocks are off by a little
    return steps * FINE_STEPS if fine else steps


@kernel
def turns(v: float, rim: float) -> bool:
    """Return whether carriage or rim, in m/s, may turn in the next period."""
    return min(abs(v), abs(rim)) < TURNING_M_S


@inlined
def _sign(x: float) -> float:
    """Return tanh(x); most samples are far from the turn, and need no exponential."""
    if x > SATURATED:
        return 1.0
    if x < -SATURATED:
        return -1.0
    return math.tanh(x)


@inlined
def rates(
    stage: int, v: float, w: float, z: float, q: FloatArray, static: float, i: float,
    cosine: float, sine: float, hurry: float, mass: float, normal: float, sensitive: bool,
    rate: FloatArray, by_state: FloatArray, by_q: FloatArray,
) -> None:  # fmt: skip
    """Write dy/dt, its derivatives to y and to ``q``, into row ``stage`` of the last three.

    ``rate`` (4, 3), ``by_state`` (4, 3, 3), ``by_q`` (4, 3, 20); the last two only if
    ``sensitive``. Entries of ``by_q`` that are always 0 are not written. ``static`` is mu_s,
    ``hurry`` the rate of the ripple's phase in rad/s.
    """
    v_s, mu_c, s_0, s_1, s_2 = q[0], q[1], q[3], q[4], q[5]
    gain, no_load, viscous, inertia, radius = q[6], q[7], q[8], q[9], q[14]
    slip = radius * w - v
    speed = abs(slip)
    root = math.sqrt(speed / v_s)
    decay = math.exp(-root)
    g = mu_c + (static - mu_c) * decay
    stress = z / g
    u = slip - speed * stress
    force = z + s_1 * u + s_2 * slip
    dry = _sign(v / SMOOTH_M_S)
    turn = _sign(radius * w / SMOOTH_M_S)
    resistance = q[10] + q[11] * normal
    ripple = q[16] * cosine + q[17] * sine
    acceleration = (normal * force - resistance * dry - q[12] * v) / mass - q[13] + v * ripple
    turning = (
        gain * (i + q[15]) - no_load * turn - viscous * w - radius * normal * force
    ) / inertia
    rate[stage, 0], rate[stage, 1], rate[stage, 2] = acceleration, turning, s_0 * u
    if not sensitive:
        return

    sign = 1.0 if slip > 0.0 else (-1.0 if slip < 0.0 else 0.0)
    bend = 0.5 * (static - mu_c) * decay * root  # -|V| dg/d|V|, finite at rest
    u_slip = 1.0 - sign * stress * (1.0 + bend / g)
    u_z = -speed / g
    u_g = speed * stress / g
    f_slip = s_1 * u_slip + s_2
    f_z = 1.0 + s_1 * u_z
    dry_slope = (1.0 - dry * dry) / SMOOTH_M_S
    turn_slope = (1.0 - turn * turn) / SMOOTH_M_S
    push, pull = normal / mass, -radius * normal / inertia
    by_state[stage, 0, 0] = -push * f_slip - (resistance * dry_slope + q[12]) / mass + ripple
    by_state[stage, 0, 1] = push * f_slip * radius
    by_state[stage, 0, 2] = push * f_z
    by_state[stage, 1, 0] = -pull * f_slip
    by_state[stage, 1, 1] = (
        pull * f_slip * radius - (no_load * turn_slope * radius + viscous) / inertia
    )
    by_state[stage, 1, 2] = pull * f_z
    by_state[stage, 2, 0] = -s_0 * u_slip
    by_state[stage, 2, 1] = s_0 * u_slip * radius
    by_state[stage, 2, 2] = s_0 * u_z

    g_by = (bend / v_s, g / mu_c, static * decay)
    for k in range(3):
        by_q[stage, 0, k] = push * s_1 * u_g * g_by[k]
        by_q[stage, 1, k] = pull * s_1 * u_g * g_by[k]
        by_q[stage, 2, k] = s_0 * u_g * g_by[k]
    by_q[stage, 2, 3] = u
    by_q[stage, 0, 4], by_q[stage, 1, 4] = push * u, pull * u
    by_q[stage, 0, 5], by_q[stage, 1, 5] = push * slip, pull * slip
    by_q[stage, 1, 6] = (i + q[15]) / inertia
    by_q[stage, 1, 7] = -turn / inertia
    by_q[stage, 1, 8] = -w / inertia
    by_q[stage, 1, 9] = -turning / inertia
    by_q[stage, 0, 10] = -dry / mass
    by_q[stage, 0, 11] = -push * dry
    by_q[stage, 0, 12] = -v / mass
    by_q[stage, 0, 13] = -1.0
    by_q[stage, 0, 14] = push * f_slip * w
    by_q[stage, 1, 14] = pull * f_slip * w - (no_load * turn_slope * w + normal * force) / inertia
    by_q[stage, 2, 14] = s_0 * u_slip * w
    by_q[stage, 1, 15] = gain / inertia
    by_q[stage, 0, 16] = v * cosine
    by_q[stage, 0, 17] = v * sine
    by_q[stage, 0, 18] = v * (q[17] * cosine - q[16] * sine) * hurry


@kernel
def advance_derivatives(s: FloatArray, h: float, by_state: FloatArray, by_q: FloatArray) -> None:
    """Advance the derivatives ``s`` (5, 20) of position, angle, v, w, z by one step of ``h`` s.

    ``by_state`` and ``by_q`` are those of :func:`rates`. Columns stand at distances that the
    compiler knows, and what they share in names: only then it computes several columns at once,
    in half the time.
    """
    t, q = s.ravel(), by_q.ravel()
    half, sixth = 0.5 * h, h / 6.0
    a00, a01, a02 = by_state[0, 0, 0], by_state[0, 0, 1], by_state[0, 0, 2]
    a10, a11, a12 = by_state[0, 1, 0], by_state[0, 1, 1], by_state[0, 1, 2]
    a20, a21, a22 = by_state[0, 2, 0], by_state[0, 2, 1], by_state[0, 2, 2]
    b00, b01, b02 = by_state[1, 0, 0], by_state[1, 0, 1], by_state[1, 0, 2]
    b10, b11, b12 = by_state[1, 1, 0], by_state[1, 1, 1], by_state[1, 1, 2]
    b20, b21, b22 = by_state[1, 2, 0], by_state[1, 2, 1], by_state[1, 2, 2]
    c00, c01, c02 = by_state[2, 0, 0], by_state[2, 0, 1], by_state[2, 0, 2]
    c10, c11, c12 = by_state[2, 1, 0], by_state[2, 1, 1], by_state[2, 1, 2]
    c20, c21, c22 = by_state[2, 2, 0], by_state[2, 2, 1], by_state[2, 2, 2]
    d00, d01, d02 = by_state[3, 0, 0], by_state[3, 0, 1], by_state[3, 0, 2]
    d10, d11, d12 = by_state[3, 1, 0], by_state[3, 1, 1], by_state[3, 1, 2]
    d20, d21, d22 = by_state[3, 2, 0], by_state[3, 2, 1], by_state[3, 2, 2]
    for j in range(COUNT):
        v, w, z = t[2 * COUNT + j], t[3 * COUNT + j], t[4 * COUNT + j]
        a_v = q[j] + a00 * v + a01 * w + a02 * z
        a_w = q[COUNT + j] + a10 * v + a11 * w + a12 * z
        a_z = q[2 * COUNT + j] + a20 * v + a21 * w + a22 * z
        v_, w_, z_ = v + half * a_v, w + half * a_w, z + half * a_z
        b_v = q[3 * COUNT + j] + b00 * v_ + b01 * w_ + b02 * z_
        b_w = q[4 * COUNT + j] + b10 * v_ + b11 * w_ + b12 * z_
        b_z = q[5 * COUNT + j] + b20 * v_ + b21 * w_ + b22 * z_
        v_, w_, z_ = v + half * b_v, w + half * b_w, z + half * b_z
        c_v = q[6 * COUNT + j] + c00 * v_ + c01 * w_ + c02 * z_
        c_w = q[7 * COUNT + j] + c10 * v_ + c11 * w_ + c12 * z_
        c_z = q[8 * COUNT + j] + c20 * v_ + c21 * w_ + c22 * z_
        v_, w_, z_ = v + h * c_v, w + h * c_w, z + h * c_z
        d_v = q[9 * COUNT + j] + d00 * v_ + d01 * w_ + d02 * z_
        d_w = q[10 * COUNT + j] + d10 * v_ + d11 * w_ + d12 * z_
        d_z = q[11 * COUNT + j] + d20 * v_ + d21 * w_ + d22 * z_
        t[j] += h * v + h * sixth * (a_v + b_v + c_v)
        t[COUNT + j] += h * w + h * sixth * (a_w + b_w + c_w)
        t[2 * COUNT + j] = v + sixth * (a_v + 2.0 * b_v + 2.0 * c_v + d_v)
        t[3 * COUNT + j] = w + sixth * (a_w + 2.0 * b_w + 2.0 * c_w + d_w)
        t[4 * COUNT + j] = z + sixth * (a_z + 2.0 * b_z + 2.0 * c_z + d_z)


@kernel
def integrate(
    q: FloatArray, current: FloatArray, jumps: FloatArray, angle: FloatArray, turning: FloatArray,
    transitions: float, mass: float, normal: float, period: float, sensitive: bool,
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """Return x, angle, dv/dt, v, w, z at each sample (n, 6), and their derivatives (n, 5, 20).

    ``current`` (n,) in A at the samples, ``jumps`` (n,) 1 if it jumps behind the sample,
    ``angle`` (n,) as measured, in rad, ``turning`` (n,) its rate in rad/s. Position and angle begin
    at 0, the speeds at rest. Without ``sensitive`` the derivatives are (1, 5, 20) zeros.
    """
    count = current.size
    out = np.zeros((count, 6))
    by_out = np.empty((count, 5, COUNT)) if sensitive else np.zeros((1, 5, COUNT))
    static, radius = q[1] * math.exp(q[2]), q[14]
    x, turned, v, w, z = 0.0, 0.0, 0.0, 0.0, q[19]
    s = np.zeros((5, COUNT))
    s[4, 19] = 1.0
    rate, by_state, by_q = np.zeros((4, 3)), np.zeros((4, 3, 3)), np.zeros((4, 3, COUNT))
    late = q[18]
    phase, hurry = transitions * (angle[0] + late * turning[0]), transitions * turning[0]
    cosine, sine = math.cos(phase), math.sin(phase)
    for k in range(count):
        i_0 = current[k]
        rates(
            0, v, w, z, q, static, i_0, cosine, sine, hurry, mass, normal, sensitive, rate,
            by_state, by_q,
        )  # fmt: skip
        out[k, 0], out[k, 1], out[k, 2], out[k, 3], out[k, 4] = x, turned, rate[0, 0], v, w
        out[k, 5] = z
        if sensitive:
            row = by_out[k]
            for j in range(COUNT):
                row[0, j], row[1, j] = s[0, j], s[1, j]
                row[2, j] = (
                    by_q[0, 0, j] + by_state[0, 0, 0] * s[2, j] + by_state[0, 0, 1] * s[3, j]
                    + by_state[0, 0, 2] * s[4, j]
                )  # fmt: skip
                row[3, j], row[4, j] = s[2, j], s[3, j]
        if k + 1 == count:
            break
        i_1 = current[k + 1]
        phase_0, hurry_0 = phase, transitions * turning[k]
        phase_1 = transitions * (angle[k + 1] + late * turning[k + 1])
        hurry_1 = transitions * turning[k + 1]
        jump = jumps[k] > 0.0
        steps = steps_of(period, jump or turns(v, radius * w))
        h = period / steps
        for step in range(steps):
            if step > 0:
                if jump:
                    i = i_1 + (i_0 - i_1) * math.exp(-LOOP_RATE * step * h)
                else:
                    i = i_0 + (i_1 - i_0) * step / steps
                rates(
                    0, v, w, z, q, static, i, cosine, sine, hurry, mass, normal, sensitive,
                    rate, by_state, by_q,
                )  # fmt: skip
            for stage in range(1, 4):
                share = 1.0 if stage == 3 else 0.5
                at = (step + share) / steps
                if stage != 2:
                    phase = phase_0 + (phase_1 - phase_0) * at
                    hurry = hurry_0 + (hurry_1 - hurry_0) * at
                    cosine, sine = math.cos(phase), math.sin(phase)
                    if jump:
                        i = i_1 + (i_0 - i_1) * math.exp(-LOOP_RATE * at * period)
                    else:
                        i = i_0 + (i_1 - i_0) * at
                reach = h * share
                rates(
                    stage, v + reach * rate[stage - 1, 0], w + reach * rate[stage - 1, 1],
                    z + reach * rate[stage - 1, 2], q, static, i, cosine, sine, hurry, mass,
                    normal, sensitive, rate, by_state, by_q,
                )  # fmt: skip
            x += h * v + h * h / 6.0 * (rate[0, 0] + rate[1, 0] + rate[2, 0])
            turned += h * w + h * h / 6.0 * (rate[0, 1] + rate[1, 1] + rate[2, 1])
            v += h / 6.0 * (rate[0, 0] + 2.0 * rate[1, 0] + 2.0 * rate[2, 0] + rate[3, 0])
            w += h / 6.0 * (rate[0, 1] + 2.0 * rate[1, 1] + 2.0 * rate[2, 1] + rate[3, 1])
            z += h / 6.0 * (rate[0, 2] + 2.0 * rate[1, 2] + 2.0 * rate[2, 2] + rate[3, 2])
            if sensitive:
                advance_derivatives(s, h, by_state, by_q)
    return out, by_out
