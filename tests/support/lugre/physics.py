"""The LuGre rig integrated by a third hand: lugre.md section 2, and what real rigs have besides.

It shares no code with the identification or with rigd_sim; a common one would hide its own bug.
Classical Runge-Kutta, straight motion. Each field of :class:`Physics` that is zero by
default is something that neither the paper's model nor the identification knows.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigd.model.machine.kernel import kernel

FloatArray = NDArray[np.float64]

G0 = 9.81
RADIUS_M = 0.05
GUIDE_DRY = 0.01956708695 * 0.012 / 0.030  #: 0.304 N at 3.9593 kg
TRACK_M = 1.15  #: where the carriage is braked
STEP_S = 25e-6  #: the fastest rate is the current loop's 6283 1/s
#: Columns of what :func:`drive` returns.
(
    TIME, SPEED, WHEEL_SPEED, BRISTLE, CURRENT, POSITION, WHEEL_ANGLE, ACCELERATION, BRAKED,
    WANTED, SENSED_SPEED, SENSED_POSITION, SENSED_ACCELERATION, MOTOR_ANGLE,
) = range(14)  # fmt: skip


class Physics(NamedTuple):
    """What moves, in SI. Angles and torques are at the wheel unless a name contains motor."""

    v_s: float
    mu_c: float
    mu_s: float
    s0: float
    s1: float
    s2: float
    mu_rol: float
    mass: float = 3.9593
    radius: float = RADIUS_M
    torque_constant: float = 0.0295
    gear_ratio: float = 20.25
    efficiency: float = 0.81
    no_load: float = 2.2e-3  #: at the motor
    no_load_viscous: float = 1.9e-6
    motor_inertia: float = 1.2e-6
    wheel_inertia: float = 4.5e-4
    supply: float = 24.0
    resistance: float = 3.2
    loop_hz: float = 1000.0  #: of the amplifier
    ripple: float = 0.3  #: (m/s^2)/(m/s), 18 times per turn
    # What the paper's model does not have.
    exponent: float = 0.5  #: of the Stribeck effect; 0.5 is the paper's
    relaxation: float = 0.0  #: 1/m: bristles that leave the contact as the wheel rolls
    dahl: float = 1.0  #: exponent of Dahl's bristle
    rigid: float = 0.0  #: m/s: no bristle, friction changes its sign over this speed
    backward: float = 0.0  #: share that friction loses when the carriage moves back
    stain: float = 0.0  #: share that friction gains around 0.5 m
    warming: float = 0.0  #: share that friction loses in the first 0.3 s of a drive
    by_angle: float = 0.0  #: share by which friction varies once a turn
    edge: float = 1e9  #: m: another floor begins here
    far_v_s: float = 1.0
    far_mu_c: float = 1.0
    far_mu_s: float = 1.0
    far_s0: float = 1.0
    far_s1: float = 1.0
    far_s2: float = 1.0
    slope: float = 0.0  #: m/s^2
    drag: float = 0.0  #: N s/m
    cable: float = 0.0  #: N
    square_drag: float = 0.0  #: N s^2/m^2
    rolling_by_speed: float = 0.0  #: 1/(m/s)
    guide_stiction: float = 0.0  #: guide friction at rest over that in motion, less one
    eccentric: float = 0.0  #: m, of the drive wheel
    efficiency_back: float = 0.0  #: of the gear when it is driven back, less the other one
    motor_fades: float = 0.0  #: share of K_t lost in each second of drive
    cogging: float = 0.0  #: N m at the motor, 8 times per motor turn
    ripple_7: float = 0.0  #: (m/s^2)/(m/s), 7 times per turn
    backlash: float = 0.0  #: rad
    sprung_hz: float = 0.0  #: half of the mass stands on a spring, with the sensors
    first_speed: float = 0.0  #: m/s, with which the recording begins
    first_angle: float = 0.0  #: rad, at which the wheel stands then
    strengthens: float = 0.0  #: share that friction gains with each e-fold of slip above 10 mm/s
    soft: float = 0.0  #: share of the load on bristles a quarter as stiff
    aged: float = 0.0  #: share that friction has more before the carriage has moved 5 mm
    dust: float = 0.0  #: share that friction gains in each metre of the track
    rocks: float = 0.0  #: share by which the load on the wheel swings, each 0.1 m
    lifts: float = 0.0  #: share of the load on the wheel that goes with each m/s
    guide_bears: float = 0.0  #: share of the weight that the guide carries
    spring: float = 0.0  #: N/m, of a cable
    undulates: float = 0.0  #: m/s^2: slope of the floor that comes and goes each 0.4 m
    joint: float = 0.0  #: N, at 0.6 m, 3 mm wide
    guide_wave: float = 0.0  #: share by which guide friction varies each 0.16 m
    seal: float = 0.0  #: share that the no-load torque has more at standstill, gone at 0.05 m/s
    load_loss: float = 0.0  #: share of the gear's efficiency lost at no load, gone at 10 mN m
    gear_ripple: float = 0.0  #: share by which the gear's torque varies, 4.5 times a turn
    swells: float = 0.0  #: m: by which the wheel's radius grows at 1 m/s
    shaft: float = 0.0  #: N m/rad, between motor and wheel; 0 is rigid
    hub: float = 0.0  #: rad/s for each N m by which the wheel creeps on its hub
    knock: float = 0.0  #: N, pushed for 50 ms


@kernel
def _rates(
    y: FloatArray, t: float, command: float, brake: float, q: Physics, out: FloatArray
) -> None:
    v, w, p, i, x, theta, w_m, theta_m, v_p, x_p, p_soft = y
    v_s, mu_c, mu_s, s0, s1, s2 = q.v_s, q.mu_c, q.mu_s, q.s0, q.s1, q.s2
    if q.edge < 1e8:
        b = 0.5 + 0.5 * np.tanh((abs(x) - q.edge) / 0.005)
        v_s += b * (q.far_v_s - v_s)
        mu_c += b * (q.far_mu_c - mu_c)
        mu_s += b * (q.far_mu_s - mu_s)
        s0 += b * (q.far_s0 - s0)
        s1 += b * (q.far_s1 - s1)
        s2 += b * (q.far_s2 - s2)
    radius = q.radius + q.eccentric * np.cos(theta) + q.swells * (q.radius * w) ** 2
    slip = radius * w - v
    g = mu_c + (mu_s - mu_c) * np.exp(-((abs(slip) / v_s) ** q.exponent))
    share = 1.0 + q.stain * np.exp(-(((abs(x) - 0.5) / 0.08) ** 2)) + q.by_angle * np.cos(theta)
    if t > 0.0:
        share -= q.warming * (1.0 - np.exp(-t / 0.3))
    if v < 0.0:
        share -= q.backward
    share += q.dust * (abs(x) - 0.5) + q.aged * np.exp(-abs(x) / 0.005)
    g *= share * (1.0 + q.strengthens * np.log1p(abs(slip) / 0.01))
    normal = q.mass * G0
    pressed = normal * (1.0 - q.guide_bears) * (1.0 - q.lifts * abs(v))
    pressed *= 1.0 + q.rocks * np.sin(2.0 * np.pi * x / 0.1)
    dp_soft = 0.0
    if q.rigid > 0.0:
        dp = 0.0
        force = pressed * (g * np.tanh(slip / q.rigid) + s2 * slip)
    else:
        if q.dahl == 1.0:
            dp = slip - s0 * abs(slip) * p / g
        else:
            left = 1.0 - s0 * p * np.sign(slip) / g
            dp = slip * np.sign(left) * abs(left) ** q.dahl
        dp -= q.relaxation * abs(radius * w) * p
        pull = s0 * p + s1 * dp
        if q.soft > 0.0:
            dp_soft = slip - 0.25 * s0 * abs(slip) * p_soft / g
            pull += q.soft * (0.25 * s0 * p_soft + s1 * dp_soft - pull)
        force = pressed * (pull + s2 * slip)
    sprung = q.sprung_hz > 0.0
    v_c = v_p if sprung else v
    sv = np.tanh(v_c / 1e-3)
    sw = np.tanh(radius * w / 1e-3)
    guide = 0.01956708695 * sv * normal * 0.012 / 0.030
    guide *= 1.0 + q.guide_stiction * np.exp(-abs(v_c) / 0.02)
    guide *= 1.0 + q.guide_wave * np.sin(2.0 * np.pi * x / 0.16)
    ripple = q.mass * v * (q.ripple * np.sin(18.0 * theta) + q.ripple_7 * np.sin(7.0 * theta))
    rolling = pressed * (q.mu_rol + q.rolling_by_speed * abs(v)) * np.tanh(v / 1e-3)
    held = guide + (q.drag + q.square_drag * abs(v_c)) * v_c + (q.cable + brake) * sv
    held += q.spring * x + q.joint * np.exp(-(((abs(x) - 0.6) / 0.003) ** 2)) * sv
    if 0.3 < t < 0.35:
        held += q.knock
    slope = q.slope + q.undulates * np.sin(2.0 * np.pi * x / 0.4)
    if sprung:
        half = 0.5 * q.mass
        rate = 2.0 * np.pi * q.sprung_hz
        spring = half * (rate * rate * (x - x_p) + 0.1 * rate * (v - v_p))
        out[0] = (force - rolling + ripple - spring) / half - slope
        out[8] = (spring - held) / half - slope
        out[9] = v_p
    else:
        out[0] = (force - held - rolling + ripple) / q.mass - slope
        out[8] = out[0]
        out[9] = v
    bearing = (0.002 * sw + 2e-5 * w) * (normal * 0.07 / 0.04 + normal * 0.03 / 0.04) * 0.01
    geared = q.backlash > 0.0 or q.shaft > 0.0
    turning = w_m if geared else w
    idle = q.no_load * np.tanh(q.radius * turning / 1e-3)
    idle *= 1.0 + q.seal * np.exp(-abs(q.radius * turning) / 0.05)
    idle += q.no_load_viscous * q.gear_ratio * turning
    motor = q.torque_constant * i * (1.0 - q.motor_fades * max(t, 0.0)) - idle
    motor += q.cogging * np.sin(8.0 * q.gear_ratio * theta_m)
    efficiency = q.efficiency
    if motor * turning < 0.0:
        efficiency += q.efficiency_back
    efficiency *= 1.0 - q.load_loss * np.exp(-abs(motor) / 0.01)
    torque = motor * efficiency * q.gear_ratio * (1.0 + q.gear_ripple * np.sin(4.5 * theta))
    rotor = q.motor_inertia * q.efficiency * q.gear_ratio**2
    if geared:
        gap = theta_m - theta
        beyond = gap - min(max(gap, -0.5 * q.backlash), 0.5 * q.backlash)
        stiffness = q.shaft if q.shaft > 0.0 else 400.0
        contact = stiffness * (beyond + (5e-4 * (w_m - w) if beyond != 0.0 else 0.0))
        out[1] = (contact - bearing - radius * force) / q.wheel_inertia
        out[6] = (torque - contact) / rotor
        out[7] = w_m
    else:
        out[1] = (torque - bearing - radius * force) / (q.wheel_inertia + rotor)
        out[6] = out[1]
        out[7] = w + q.hub * radius * force
    out[2] = dp
    out[10] = dp_soft
    back = q.torque_constant * q.gear_ratio * turning
    ref = min(max(command, (-q.supply - back) / q.resistance), (q.supply - back) / q.resistance)
    out[3] = 2.0 * np.pi * q.loop_hz * (ref - i)
    out[4] = v
    out[5] = w


@kernel
def drive(
    q: Physics, commands: FloatArray, rest: int, after: int, period: float, rows: int, step: float
) -> FloatArray:
    """Return what happens, ``rows`` in each ``period``: columns as named above, (n, 14).

    ``commands`` (k,) in A are held for a ``period`` each; the first ``rest`` are before the drive.
    The carriage is braked for ``after`` periods behind the track or the last command. ``step`` is
    that of the integration, in s.
    """
    steps = max(1, round(period / rows / step))
    h = period / rows / steps
    out = np.empty(((len(commands) + after) * rows, 14))
    y = np.zeros(11)
    y[0], y[1] = q.first_speed, q.first_speed / q.radius
    y[6], y[8] = y[1], y[0]
    y[5] = y[7] = q.first_angle
    at, k1, k2, k3, k4 = np.empty(11), np.empty(11), np.empty(11), np.empty(11), np.empty(11)
    left, n, row = after, 0, 0
    while n < len(commands) + after and left > 0:
        braking = abs(y[4]) > 1.15 or n >= len(commands)
        if braking:
            left -= 1
        command = 0.0 if braking else commands[n]
        brake = 15.0 if braking else 0.0
        for part in range(rows):
            t = (n - rest + part / rows) * period
            _rates(y, t, command, brake, q, k1)
            back = q.torque_constant * q.gear_ratio * y[6]
            wanted = min(
                max(command, (-q.supply - back) / q.resistance), (q.supply - back) / q.resistance
            )
            out[row, 0] = (n + part / rows) * period
            out[row, 1:7] = y[:6]
            out[row, 7], out[row, 8], out[row, 9] = k1[0], braking, wanted
            out[row, 10], out[row, 11], out[row, 12] = y[8], y[9], k1[8]
            out[row, 13] = y[7]
            row += 1
            for _ in range(steps):
                _rates(y, t, command, brake, q, k1)
                for d in range(11):
                    at[d] = y[d] + 0.5 * h * k1[d]
                _rates(at, t, command, brake, q, k2)
                for d in range(11):
                    at[d] = y[d] + 0.5 * h * k2[d]
                _rates(at, t, command, brake, q, k3)
                for d in range(11):
                    at[d] = y[d] + h * k3[d]
                _rates(at, t, command, brake, q, k4)
                for d in range(11):
                    y[d] += h / 6.0 * (k1[d] + 2.0 * k2[d] + 2.0 * k3[d] + k4[d])
        n += 1
    return out[:row]
