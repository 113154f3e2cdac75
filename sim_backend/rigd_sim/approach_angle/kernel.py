"""Computes the physics of the approach-angle rig, in compiled code (numba).

The integrator takes steps of 1/19200 s by Runge-Kutta (4th order). All code that is compiled with
the integrator is in this file, because numba's cache notices changes only in the file of the entry
point. Only the noise is shared with other files, and the noise code does not change.

In a dry friction the sign of a speed is tanh(speed / small). So a body at rest creeps by the small
speed times its load over its friction. Directions: e_r is the rolling direction of the wheel, at
alpha to the travel x of the platform; e_a is the wheel's axle. The free rollers turn about e_r.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigd.model.machine.kernel import inlined, kernel
from rigd.sdk.noise import normal_pair

Row = Any  # one row of what records.py lays out
Rows = NDArray[np.void]
Floats = NDArray[np.float64]
#: current; rotor angle and speed; wheel angle and speed; bristles (m); sliding distance;
#: platform's travel and speed; vertical position and speed of the platform on the surface
Moving = tuple[
    float, float, float, float, float, float, float, float, float, float, float
]  # fmt: skip

#: Small speeds of the dry frictions, in rad/s and m/s.
TURNING: float = 0.1
SLIDING: float = 2e-3
#: Speeds below which the rig rests once the current is gone, in rad/s and m/s.
REST_TURNING: float = 2e-4
REST_SLIDING: float = 1e-5
#: Shares of the bounce after which the contact opens and closes again.
BOUNCE = (0.2, 0.35, 0.6, 0.75)


@inlined
def contact_closed(c: Row, s: Row, now: float) -> bool:
    """Return whether the relay conducts at ``now`` s, after the command of ``s.command_at``."""
    since = now - s.command_at
    if s.command < 0.5:
        return bool(since < c.drop_out and s.was_closed > 0.5)
    if since < c.pick_up:
        return bool(s.was_closed > 0.5)
    if s.was_closed > 0.5 or since >= c.pick_up + c.bounce:
        return True
    share = (since - c.pick_up) / c.bounce
    return not (BOUNCE[0] <= share < BOUNCE[1] or BOUNCE[2] <= share < BOUNCE[3])


@inlined
def shaft_torque(c: Row, twist: float, rate: float) -> float:
    """Return the torque in N m through backlash and shaft; an open gap carries none."""
    torque = 0.0
    if twist > c.backlash:
        torque = max(0.0, c.shaft_stiffness * (twist - c.backlash) + c.shaft_damping * rate)
    elif twist < -c.backlash:
        torque = min(0.0, c.shaft_stiffness * (twist + c.backlash) + c.shaft_damping * rate)
    return torque


@inlined
def friction(
    c: Row, w: float, v: float, z: float, slid: float
) -> tuple[float, float, float, float]:
    """Return F_r/N, dz/dt in m/s, the sliding speed v_r in m/s and the limit of F_r/N.

    LuGre bristles with convection by rolling, which ends when they slide fully.
    """
    rim = c.effective_radius * w
    sliding = rim - v * c.cosine
    speed = abs(sliding)
    decades = math.log10((speed + c.speed_floor) / (c.peak_speed + c.speed_floor))
    limit = c.limit * math.exp(-c.hump * decades * decades)
    limit *= 1.0 + c.breakaway * math.exp(-slid / c.breakaway_slide)
    share = c.bristle_stiffness * z / limit
    free = max(0.0, 1.0 - share * share)
    rate = sliding - speed * share - c.convection * abs(rim) * z * free
    fading = sliding / c.damping_speed
    damping = c.bristle_damping * math.exp(-fading * fading)
    return c.bristle_stiffness * z + damping * rate, rate, sliding, limit


@inlined
def profile(c: Row, angle: float) -> tuple[float, float]:
    """Return height in m and slope in m/rad of the wheel's profile at ``angle``."""
    sides = c.rollers * angle + c.profile_phase
    rollers = 2.0 * sides
    height = c.profile_rollers * math.sin(rollers) + c.profile_sides * math.sin(sides)
    slope = c.rollers * (
        2.0 * c.profile_rollers * math.cos(rollers) + c.profile_sides * math.cos(sides)
    )
    return height, slope


@inlined
def normal_force(
    c: Row, relaxed: float, angle: float, w: float, x: float, y: float, vy: float, mu: float
) -> tuple[float, float]:
    """Return N and the vibrating part of it, in N; ``mu`` is F_r/N, which tilts the platform."""
    if c.load == 0.0:
        return 0.0, 0.0
    height, slope = profile(c, angle)
    vibrating = c.vertical_stiffness * (height - y) + c.vertical_damping * (slope * w - vy)
    base = c.load * (1.0 + c.rise * x / c.stop - c.relaxation * relaxed)
    return max(0.0, base + vibrating) / (1.0 - c.tilting * mu), vibrating


@inlined
def drag(c: Row, w: float, n: float) -> float:
    """Return the moment in N m downstream of the gauges: bearings, rolling and rubbing."""
    sign = math.tanh(w / TURNING)
    dry = c.bearing_constant + c.bearing_load * n + c.rolling_arm * n + c.rubbing
    moment: float = dry * sign + c.bearing_viscous * w
    return moment


@inlined
def platform_force(c: Row, x: float, v: float, rolling: float, n: float) -> float:
    """Return the force in N on the platform along its travel."""
    sign = math.tanh(v / SLIDING)
    axial = c.roller_drag * n * math.tanh(v * c.sine / SLIDING)
    across = rolling * c.sine + axial * c.cosine
    rails = (c.rail_constant + c.rail_load * (abs(n - c.weight) + abs(across))) * sign
    force: float = rolling * c.cosine - axial * c.sine - rails - c.rail_viscous * v
    if x > c.bumper:
        force += min(0.0, -c.bumper_stiffness * (x - c.bumper) - c.bumper_damping * v)
    elif x < c.back:
        force += max(0.0, c.bumper_stiffness * (c.back - x) - c.bumper_damping * v)
    return force


@inlined
def current_rate(c: Row, closed: bool, current: float, w: float) -> float:
    """Return di/dt in A/s: on the regulator, shorted by the brake, or through the diode."""
    across = 0.0
    if closed:
        across = c.voltage - c.circuit_resistance * current - c.back_emf * w
    elif c.brake > 0.5 or current > 0.0:
        across = -c.resistance * current - c.back_emf * w
    rate: float = across / c.inductance
    return rate


@inlined
def rates(c: Row, closed: bool, relaxed: float, m: Moving) -> Moving:
    """Return the derivatives of ``m`` in time."""
    i, rotor, rotor_speed, wheel, w, z, slid, x, v, y, vy = m
    mu, dz, sliding, _ = friction(c, w, v, z, slid)
    n, vibrating = normal_force(c, relaxed, wheel, w, x, y, vy, mu)
    rolling = mu * n
    di = current_rate(c, closed, i, rotor_speed)
    dv = platform_force(c, x, v, rolling, n) / c.mass
    if c.clamped > 0.5:
        return di, 0.0, 0.0, 0.0, 0.0, dz, abs(sliding), v, dv, vy, vibrating / c.mass
    torque = shaft_torque(c, rotor - wheel, rotor_speed - w)
    upstream = c.gearbox_drag * math.tanh(rotor_speed / TURNING)
    return (
        di,
        rotor_speed,
        (c.torque_per_current * i - upstream - torque) / c.rotor_inertia,
        w,
        (torque - drag(c, w, n) - c.effective_radius * rolling) / c.inertia,
        dz,
        abs(sliding),
        v,
        dv,
        vy,
        vibrating / c.mass,
    )


@inlined
def pressed(low: float, high: float, position: float) -> float:
    """Return by how much ``position`` lies beyond ``low`` or ``high``."""
    return position - min(max(position, low), high)


@inlined
def powers(c: Row, closed: bool, relaxed: float, m: Moving) -> tuple[float, float]:
    """Return the power in W that comes from the supply, and that which is dissipated.

    The wheel's profile lifts the platform without a reaction on the wheel: it supplies, too. The
    energy of the bristles does not follow a change of the normal force.
    """
    i, rotor, rotor_speed, wheel, w, z, slid, x, v, y, vy = m
    mu, dz, sliding, _ = friction(c, w, v, z, slid)
    n, vibrating = normal_force(c, relaxed, wheel, w, x, y, vy, mu)
    height, slope = profile(c, wheel)
    rolling = mu * n
    given = vibrating * slope * w
    lost = rolling * sliding - n * c.bristle_stiffness * z * dz
    lost += (rolling * c.cosine - platform_force(c, x, v, rolling, n)) * v
    lost -= c.bumper_stiffness * pressed(c.back, c.bumper, x) * v
    if c.load != 0.0:
        lost += (vibrating - c.vertical_stiffness * (height - y)) * (slope * w - vy)
    if closed:
        given += c.voltage * i
        lost += c.circuit_resistance * i * i
    else:
        lost += c.resistance * i * i
    if c.clamped > 0.5:
        return given, lost
    twist, rate = rotor - wheel, rotor_speed - w
    lost += (c.back_emf - c.torque_per_current) * i * rotor_speed
    lost += c.gearbox_drag * math.tanh(rotor_speed / TURNING) * rotor_speed + drag(c, w, n) * w
    bent = pressed(-c.backlash, c.backlash, twist)
    lost += (shaft_torque(c, twist, rate) - c.shaft_stiffness * bent) * rate
    return given, lost


@kernel
def stored(constants: Rows, state: Rows) -> float:
    """Return the energy in J in winding, motion, shaft, bristles, tyre and bumpers."""
    c, s = constants[0], state[0]
    mu, _, _, _ = friction(c, s.w, s.v, s.z, s.slid)
    n, _ = normal_force(c, s.relaxed, s.wheel, s.w, s.x, s.y, s.vy, mu)
    height, _ = profile(c, s.wheel)
    twice = c.inductance * s.i**2 + c.rotor_inertia * s.rotor_speed**2 + c.inertia * s.w**2
    twice += c.mass * (s.v**2 + s.vy**2)
    if c.clamped < 0.5:
        twice += c.shaft_stiffness * pressed(-c.backlash, c.backlash, s.rotor - s.wheel) ** 2
    twice += n * c.bristle_stiffness * s.z**2
    twice += c.bumper_stiffness * pressed(c.back, c.bumper, s.x) ** 2
    if c.load != 0.0:
        twice += c.vertical_stiffness * (height - s.y) ** 2
    energy: float = 0.5 * twice
    return energy


@inlined
def moved(m: Moving, r: Moving, h: float) -> Moving:
    """Return ``m`` + ``h`` ``r``."""
    return (
        m[0] + h * r[0],
        m[1] + h * r[1],
        m[2] + h * r[2],
        m[3] + h * r[3],
        m[4] + h * r[4],
        m[5] + h * r[5],
        m[6] + h * r[6],
        m[7] + h * r[7],
        m[8] + h * r[8],
        m[9] + h * r[9],
        m[10] + h * r[10],
    )


@inlined
def stepped(c: Row, closed: bool, relaxed: float, m: Moving, h: float) -> Moving:
    """Return ``m`` after ``h`` s."""
    k1 = rates(c, closed, relaxed, m)
    k2 = rates(c, closed, relaxed, moved(m, k1, 0.5 * h))
    k3 = rates(c, closed, relaxed, moved(m, k2, 0.5 * h))
    k4 = rates(c, closed, relaxed, moved(m, k3, h))
    m = moved(m, k1, h / 6.0)
    m = moved(m, k2, h / 3.0)
    m = moved(m, k3, h / 3.0)
    return moved(m, k4, h / 6.0)


@inlined
def potentiometer(c: Row, turned: float, slope: float, phase: float) -> float:
    """Return the volts at ``turned`` rad from its end: a ten-turn one ends, it does not wrap."""
    at = min(max(turned, 0.0), c.pot_end)
    volts: float = c.pot_volts_per_rad * (slope * at + c.pot_cyclic * math.sin(at + phase))
    return volts


@inlined
def show(c: Row, s: Row, m: Moving, out: Floats) -> None:
    """Fill a row of the history (layout.HISTORY): voltages before noise, and the truth."""
    _, rotor, rotor_speed, wheel, w, z, slid, x, v, y, vy = m
    mu, _, sliding, limit = friction(c, w, v, z, slid)
    n, _ = normal_force(c, s.relaxed, wheel, w, x, y, vy, mu)
    twisting = shaft_torque(c, rotor - wheel, rotor_speed - w)
    torque = c.arm_torque if c.clamped > 0.5 else twisting
    shear = c.shear_per_torque * torque
    # The wheel's load bends the shaft upwards, a weight on the arm downwards.
    bending = c.bending_per_load * (n - c.arm_weight) * math.cos(wheel + c.gauge_phase)
    a = c.gain_a * (c.shear_a * shear + c.bending_a * bending) + c.drift_a + s.spike
    b = c.gain_b * (c.shear_b * shear + c.bending_b * bending) + c.drift_b - 0.5 * s.spike
    if c.swapped > 0.5:
        a, b = b, a
    out[0] = c.gauge_sensitivity * a
    out[1] = c.gauge_sensitivity * b
    turned = c.wheel_start + (0.0 if c.wheel_pot_dead > 0.5 else wheel)
    out[2] = potentiometer(c, turned, c.wheel_slope, c.wheel_phase)
    turned = (c.platform_start + (0.0 if c.platform_pot_dead > 0.5 else x)) / c.pulley
    out[3] = potentiometer(c, turned, c.platform_slope, c.platform_phase)
    out[4] = c.load_cell_volts_per_n * n + c.load_cell_zero
    out[5] = x
    out[6] = v
    out[7] = wheel
    out[8] = w
    out[9] = mu * n
    out[10] = n
    out[11] = torque
    out[12] = sliding
    out[13] = limit


@kernel
def show_now(constants: Rows, state: Rows, out: Floats) -> None:
    """Fill a row of the history with the state as it stands."""
    s = state[0]
    m = (s.i, s.rotor, s.rotor_speed, s.wheel, s.w, s.z, s.slid, s.x, s.v, s.y, s.vy)
    show(constants[0], s, m, out)


@kernel
def touch(constants: Rows, state: Rows) -> None:
    """Lay the wheel on the surface again: bristles straight, breakaway surplus there."""
    s = state[0]
    s.z, s.slid, s.vy = 0.0, 0.0, 0.0
    s.y, _ = profile(constants[0], s.wheel)


@inlined
def weigh(c: Row, s: Row, scale: Floats, seed: int) -> None:
    """Take a reading of the scale: ``scale`` holds the last ones, in kg, the newest first."""
    tick = int(s.readings)
    noise, _ = normal_pair(seed, tick)
    mass = c.scale_gain * s.shown_load / c.gravity + c.scale_noise * noise
    mass += c.scale_shake * math.sin(2.1 * tick)
    if c.scale_division > 0.0:
        mass = math.floor(mass / c.scale_division + 0.5) * c.scale_division
    for k in range(scale.size - 1, 0, -1):
        scale[k] = scale[k - 1]
    scale[0] = mass
    s.readings += 1.0


@kernel
def advance(
    constants: Rows,
    state: Rows,
    history: Floats,
    scale: Floats,
    seed: int,
    first: int,
    last: int,
    step_s: float,
) -> None:
    """Take the steps ``first`` + 1 to ``last``; each fills its row of ``history``."""
    c, s = constants[0], state[0]
    rows = history.shape[0]
    m = (s.i, s.rotor, s.rotor_speed, s.wheel, s.w, s.z, s.slid, s.x, s.v, s.y, s.vy)
    keep_spike = math.exp(-step_s / c.spike_time)
    relaxing = -math.expm1(-step_s / c.relaxation_time)
    follow = -math.expm1(-step_s / c.scale_time)
    per_reading = round(c.scale_interval / step_s)
    resting = False
    load = c.load
    for n in range(first + 1, last + 1):
        now = (n - 1) * step_s
        row = history[n % rows]
        closed = contact_closed(c, s, now)
        awake = closed or s.awake > 0.5 or s.spike != 0.0
        if closed != (s.closed > 0.5):
            s.spike = c.spike if closed else -c.spike
            s.closed = 1.0 if closed else 0.0
        if closed:
            s.started = 1.0
        if awake:
            before = m
            m = stepped(c, closed, s.relaxed, m, step_s)
            if s.counting > 0.5:
                given, lost = powers(c, closed, s.relaxed, before)
                given_then, lost_then = powers(c, closed, s.relaxed, m)
                s.supplied += 0.5 * step_s * (given + given_then)
                s.dissipated += 0.5 * step_s * (lost + lost_then)
            if not closed and c.brake < 0.5 and m[0] < 0.0:
                m = (0.0, m[1], m[2], m[3], m[4], m[5], m[6], m[7], m[8], m[9], m[10])
            s.spike = 0.0 if abs(s.spike) < 1e-3 * c.spike else s.spike * keep_spike
            if s.started > 0.5:
                s.relaxed += (1.0 - s.relaxed) * relaxing
            s.awake = 1.0
            if (
                not closed
                and s.command < 0.5
                and s.spike == 0.0
                and abs(m[0]) < 1e-6
                and abs(m[2]) + abs(m[4]) < REST_TURNING
                and abs(m[8]) + abs(m[10]) < REST_SLIDING
            ):
                # Contact at rest: the breakaway surplus is there again.
                m = (0.0, m[1], 0.0, m[3], 0.0, m[5], 0.0, m[7], 0.0, m[9], 0.0)
                s.awake = 0.0
            show(c, s, m, row)
            load = row[10]
            resting = False
        elif resting:
            row[:] = history[(n - 1) % rows]
        else:
            show(c, s, m, row)
            load = row[10]
            resting = True
        s.shown_load += (load + c.known_weight - s.shown_load) * follow
        if n % per_reading == 0:
            weigh(c, s, scale, seed)
    s.i, s.rotor, s.rotor_speed, s.wheel, s.w, s.z, s.slid, s.x, s.v, s.y, s.vy = m
