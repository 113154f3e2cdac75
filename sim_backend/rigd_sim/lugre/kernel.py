"""Computes the physics of the LuGre rig, in compiled code (numba): one call integrates one cycle.

Equation numbers are the paper's ("Investigation of longitudinal friction characteristics of an
omnidirectional wheel via LuGre model"). sgn(u) is regularised as S(u) = tanh(u / v_eps) with
v_eps = 1 mm/s (``smooth``). So a body at rest creeps by v_eps times its load over its friction.

Each step of 125 us is a Strang splitting, of second order:

* *drift*: the speeds are constant; current and bristles relax exactly, positions and integrals
  advance;
* *kick*: current, bristles, positions and integrals are constant; the speeds take one linearly
  implicit midpoint step (A-stable) with the analytic Jacobian. The lateral speed does not depend on
  the other speeds and is computed first.

The second half drift of a step and the first half drift of the next step have the same speeds, so
the kernel takes both as one drift. All code that is compiled with the integrator is in this file,
because numba's cache notices changes only in the file of the entry point. Only the noise is shared
with other files, and the noise code does not change.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigd.model.machine.kernel import inlined, kernel
from rigd.sdk.noise import normal_pair

#: One row of what records.py lays out, and the array of one that holds it.
Row = Any
Rows = NDArray[np.void]
#: Speed (m/s) and integral (m) of the bridge below which it stands.
REST = 1e-12


@inlined
def stribeck(c: Row, slip: float) -> tuple[float, float]:
    """Return g(V_r) of Eq. 6 (with its missing '+') and -|V_r| dg/d|V_r|, both dimensionless.

    The slope itself is infinite at zero slip; this product, all that is needed, is not.
    """
    root = math.sqrt(abs(slip) / c.V_s)
    excess = (c.mu_s - c.mu_c) * math.exp(-root)
    return c.mu_c + excess, 0.5 * excess * root


@inlined
def bristles(c: Row, p: float, slip: float, g: float, duration: float) -> float:
    """Return p (m) after ``duration`` s at constant slip: the exact solution of Eq. 5."""
    if slip == 0.0:
        return p
    settled = math.copysign(g / c.sigma_0, slip)
    return settled + (p - settled) * math.exp(-c.sigma_0 * abs(slip) * duration / g)


@inlined
def traction(c: Row, p: float, slip: float, g: float, bend: float) -> tuple[float, float]:
    """Return F of Eqs. 41 and 42 in N and dF/dV_r in N s/m; ``g, bend`` by :func:`stribeck`."""
    stress = c.sigma_0 * p / g
    turn = c.sigma_1 * stress * (1.0 + bend / g)
    force = c.sigma_0 * p + c.sigma_1 * (slip - abs(slip) * stress) + c.sigma_2 * slip
    slope = c.sigma_1 + c.sigma_2 - (turn if slip > 0.0 else -turn if slip < 0.0 else 0.0)
    return c.weight * force, c.weight * slope


@inlined
def lateral_force(c: Row, speed: float) -> tuple[float, float]:
    """Return G of Eqs. 22, 25, 26 in N and dG/dv_z in N s/m: their closed form.

    With both rows loaded G = s m g. Once one is lifted, |F_r1| + |F_r2| depends on G itself
    (``coupling`` 0, as printed); 1 counts a lifted row as unloaded, 2 leaves the force out.
    """
    if c.coupling == 2.0:
        return 0.0, 0.0
    sign = math.tanh(speed / c.smooth)
    s = c.roller_dry * sign + c.roller_viscous * speed
    slope = c.roller_dry * (1.0 - sign * sign) / c.smooth + c.roller_viscous
    if c.coupling == 0.0:
        j, k, height = c.row_distance, c.mass_offset, c.height
        share = c.weight * (j + 2.0 * k)
        if -k - s * height < 0.0:
            rest = j - 2.0 * s * height
            return s * share / rest, slope * share * j / (rest * rest)
        if k + j + s * height < 0.0:
            rest = j + 2.0 * s * height
            return -s * share / rest, -slope * share * j / (rest * rest)
    return s * c.weight, slope * c.weight


@inlined
def servo(
    gain: float, integral: float, limit: float, error: float, error_sum: float
) -> tuple[float, float, bool]:
    """Return a belt's force in N, its slope against the carriage's speed, and whether limited."""
    force = gain * error + integral * error_sum
    if force > limit:
        return limit, 0.0, True
    if force < -limit:
        return -limit, 0.0, True
    return force, -gain, False


@inlined
def end_stop(
    low: float, high: float, stiffness: float, damping: float, position: float, speed: float
) -> tuple[float, float]:
    """Return the force in N of the buffer in contact, and its slope against speed; never a pull."""
    if position > high:
        force = -stiffness * (position - high) - damping * speed
        return (force, -damping) if force < 0.0 else (0.0, 0.0)
    if position < low:
        force = stiffness * (low - position) - damping * speed
        return (force, -damping) if force > 0.0 else (0.0, 0.0)
    return 0.0, 0.0


@inlined
def lateral_rate(c: Row, s: Row, vz: float, target: float, engaged: bool) -> tuple[float, float]:
    """Return dv_z/dt of Eq. 27 in m/s^2 and its derivative by v_z in 1/s."""
    force, slope = 0.0, 0.0
    if engaged:
        force, slope, _ = servo(
            c.lateral_kp, c.lateral_ki, c.lateral_limit, target - vz, s.lateral_sum
        )
    sign = math.tanh(vz / c.smooth)
    rail = c.rail_dry * sign + c.rail_viscous * vz
    rail_slope = c.rail_dry * (1.0 - sign * sign) / c.smooth + c.rail_viscous
    roller, roller_slope = lateral_force(c, vz)
    stop, stop_slope = end_stop(c.z_low, c.z_high, c.z_stiffness, c.z_damping, s.z, vz)
    change = slope - rail_slope - roller_slope + stop_slope
    return (force - rail - roller + stop) / c.lateral_mass, change / c.lateral_mass


@inlined
def loads(c: Row, lateral: float) -> tuple[float, float]:
    """Return |F_G| + |F_H| of the guide (Eqs. 21 to 23) and |F_A| + |F_B| of the bearings (48)."""
    moment = abs(c.guide_moment - lateral * c.height) / c.half_span
    guide = max(abs(lateral), moment)
    tilt = lateral * c.r
    near = (c.weight * (c.spacing + c.overhang) - tilt) / c.spacing
    far = (c.weight * c.overhang - tilt) / c.spacing
    return guide, abs(near) + abs(far)


@inlined
def resistances(c: Row, v: float, guide_load: float) -> tuple[float, float, float]:
    """Return F_D of Eq. 24 and F_rol of Eq. 20 in N, and the slope of their sum in N s/m."""
    sign = math.tanh(v / c.smooth)
    dry = c.guide_dry * guide_load
    guide = dry * sign + c.guide_viscous * guide_load * v
    rolling = c.rolling * c.weight
    slope = (dry + rolling) * (1.0 - sign * sign) / c.smooth + c.guide_viscous * guide_load
    return guide, rolling * sign, slope


@inlined
def shaft(c: Row, w: float, current: float, bearing_load: float) -> tuple[float, float]:
    """Return (K_t i - T_nl) E G_r - T_f of Eq. 51 in N m, and its slope against w."""
    rim = c.r * w
    sign = math.tanh(rim / c.smooth)
    sign_slope = (1.0 - sign * sign) * c.r / c.smooth
    arm = c.bearing_arm * bearing_load
    no_load = c.no_load_dry * sign + c.no_load_viscous * c.gear * w
    bearing = (c.bearing_dry * sign + c.bearing_viscous * w) * arm
    torque = (c.torque_constant * current - no_load) * c.ratio_efficiency - bearing
    slope = (
        -(c.no_load_dry * sign_slope + c.no_load_viscous * c.gear) * c.ratio_efficiency
        - (c.bearing_dry * sign_slope + c.bearing_viscous) * arm
    )
    return torque, slope


@inlined
def reachable_current(c: Row, w: float, demand: float) -> float:
    """Return the demanded current in A as far as the supply can drive it against the back-EMF."""
    emf = c.back_emf * c.gear * w
    high = (c.supply - emf) / c.resistance
    low = (-c.supply - emf) / c.resistance
    reachable: float = min(max(demand, low), high)
    return reachable


@inlined
def speed_rates(
    c: Row, s: Row, v: float, w: float, g: float, bend: float, lateral: float, belt: float, on: bool
) -> tuple[float, float, float, float, float, float]:
    """Return dv/dt, dw/dt (Eqs. 43, 51) and their derivatives (vv, vw, wv, ww).

    ``g, bend`` belong to the slip r w - v; ``lateral`` is G in N, ``belt`` the target in m/s of
    the belt servo if ``on``.
    """
    force, force_slope = traction(c, s.p, c.r * w - v, g, bend)
    guide_load, bearing_load = loads(c, lateral)
    guide, rolling, drag_slope = resistances(c, v, guide_load)
    torque, torque_slope = shaft(c, w, s.i, bearing_load)
    pull, pull_slope = 0.0, 0.0
    if on:
        pull, pull_slope, _ = servo(c.belt_kp, c.belt_ki, c.belt_limit, belt - v, s.belt_sum)
    stop, stop_slope = end_stop(c.x_low, c.x_high, c.x_stiffness, c.x_damping, s.x, v)
    shake = c.ripple * math.sin(c.transitions * s.theta) if c.ripple > 0.0 else 0.0
    return (
        (force - guide - rolling + pull + stop) / c.mass + shake * v,
        (torque - c.r * force) / c.inertia,
        (pull_slope + stop_slope - force_slope - drag_slope) / c.mass + shake,
        c.r * force_slope / c.mass,
        c.r * force_slope / c.inertia,
        (torque_slope - c.r * c.r * force_slope) / c.inertia,
    )


@inlined
def limited(value: float, limit: float) -> float:
    """Return ``value`` within plus or minus ``limit``."""
    return min(max(value, -limit), limit)


@inlined
def demanded_current(c: Row, u: Row) -> float:
    """Return the current in A that the amplifier regulates to; none while disabled."""
    return limited(u.wheel_current, c.current_limit) if u.wheel_enabled > 0.5 else 0.0


@inlined
def winding(gain: float, integral: float, limit: float, error: float, error_sum: float) -> bool:
    """Return whether a belt's integral may move on: not while limited and pushing further."""
    force = gain * error + integral * error_sum
    return abs(force) <= limit or error * force < 0.0


@inlined
def buffer_loss(
    low: float, high: float, stiffness: float, damping: float, position: float, speed: float
) -> float:
    """Return the power in W that a buffer takes, beyond what its spring stores."""
    force, _ = end_stop(low, high, stiffness, damping, position, speed)
    pressed = position - min(max(position, low), high)
    return -(force + stiffness * pressed) * speed


@inlined
def powers(
    c: Row, s: Row, v: float, w: float, lateral: float, belt: float, on: bool, vz: float,
    across: float, lateral_on: bool,
) -> tuple[float, float]:  # fmt: skip
    """Return the power in W that comes from motor and belts, and that which is dissipated.

    What gearbox and winding lose before the shaft is not supplied; the push of the rollers'
    transitions, which has no reaction on the wheel, is. ``vz`` is the bridge's speed.
    """
    slip = c.r * w - v
    g, _ = stribeck(c, slip)
    bending = slip - c.sigma_0 * abs(slip) * s.p / g  # dp/dt of Eq. 5
    lost = c.weight * (
        c.sigma_0 * s.p * (slip - bending) + (c.sigma_1 * bending + c.sigma_2 * slip) * slip
    )
    guide_load, bearing_load = loads(c, lateral)
    guide, rolling, _ = resistances(c, v, guide_load)
    motor = c.torque_constant * s.i * c.ratio_efficiency
    lost += (guide + rolling) * v + (motor - shaft(c, w, s.i, bearing_load)[0]) * w
    lost += buffer_loss(c.x_low, c.x_high, c.x_stiffness, c.x_damping, s.x, v)
    lost += buffer_loss(c.z_low, c.z_high, c.z_stiffness, c.z_damping, s.z, vz)
    sign = math.tanh(vz / c.smooth)
    lost += (c.rail_dry * sign + c.rail_viscous * vz + lateral_force(c, vz)[0]) * vz
    given = motor * w
    if on:
        given += servo(c.belt_kp, c.belt_ki, c.belt_limit, belt - v, s.belt_sum)[0] * v
    if lateral_on:
        error = across - vz
        given += servo(c.lateral_kp, c.lateral_ki, c.lateral_limit, error, s.lateral_sum)[0] * vz
    if c.ripple > 0.0:
        given += c.mass * c.ripple * math.sin(c.transitions * s.theta) * v * v
    return given, lost


@kernel
def stored(constants: Rows, state: Rows) -> float:
    """Return the energy in J in motion, bristles and buffers."""
    c, s = constants[0], state[0]
    pressed = s.x - min(max(s.x, c.x_low), c.x_high)
    aside = s.z - min(max(s.z, c.z_low), c.z_high)
    twice = c.mass * s.v**2 + c.inertia * s.w**2 + c.lateral_mass * s.vz**2
    twice += c.weight * c.sigma_0 * s.p**2
    twice += c.x_stiffness * pressed**2 + c.z_stiffness * aside**2
    energy: float = 0.5 * twice
    return energy


@inlined
def integrate(constants: Rows, state: Rows, commands: Rows, step: float, steps: int) -> None:
    """Advance ``state`` by ``steps`` of ``step`` s with ``commands`` held."""
    if steps < 1:
        return
    c, s, u = constants[0], state[0], commands[0]
    demand = demanded_current(c, u)
    belt, belt_on = limited(u.belt_speed, c.belt_speed), u.belt_engaged > 0.5
    across, lateral_on = limited(u.lateral_speed, c.lateral_speed), u.lateral_engaged > 0.5
    if not belt_on:
        s.belt_sum = 0.0
    if not lateral_on:
        s.lateral_sum = 0.0
    bridge = (lateral_on and across != 0.0) or abs(s.vz) + abs(s.lateral_sum) > REST
    if not bridge and c.z_low <= s.z <= c.z_high:
        # Settled: without this the servo's tail would decay for minutes, into denormals at last.
        s.vz, s.lateral_sum = 0.0, 0.0
    else:
        bridge = True
    half = 0.5 * step
    keep_step, keep_half = math.exp(-c.loop_rate * step), math.exp(-c.loop_rate * half)

    v, w = s.v, s.w
    slip = c.r * w - v
    g, bend = stribeck(c, slip)
    duration, keep = half, keep_half
    for n in range(steps + 1):
        s.p = bristles(c, s.p, slip, g, duration)
        goal = reachable_current(c, w, demand)
        s.i = goal + (s.i - goal) * keep
        s.x += v * duration
        s.theta += w * duration
        if belt_on and winding(c.belt_kp, c.belt_ki, c.belt_limit, belt - v, s.belt_sum):
            s.belt_sum += (belt - v) * duration
        if bridge:
            s.z += s.vz * duration
            error = across - s.vz
            if lateral_on and winding(
                c.lateral_kp, c.lateral_ki, c.lateral_limit, error, s.lateral_sum
            ):
                s.lateral_sum += error * duration
        if n == steps:
            break
        lateral, vz = 0.0, s.vz
        if bridge:
            rate, slope = lateral_rate(c, s, s.vz, across, lateral_on)
            rate /= 1.0 - half * slope
            lateral, _ = lateral_force(c, s.vz + half * rate)
            s.vz += step * rate
        fv, fw, vv, vw, wv, ww = speed_rates(c, s, v, w, g, bend, lateral, belt, belt_on)
        a, b = 1.0 - half * vv, 1.0 - half * ww
        scale = step / (a * b - half * half * vw * wv)
        dv, dw = scale * (b * fv + half * vw * fw), scale * (a * fw + half * wv * fv)
        if s.counting > 0.5:
            given, lost = powers(
                c, s, v + 0.5 * dv, w + 0.5 * dw, lateral, belt, belt_on, 0.5 * (vz + s.vz),
                across, lateral_on,
            )  # fmt: skip
            s.supplied += step * given
            s.dissipated += step * lost
        v += dv
        w += dw
        slip = c.r * w - v
        g, bend = stribeck(c, slip)
        if n == steps - 1:
            duration, keep = half, keep_half
        else:
            duration, keep = step, keep_step
    s.v, s.w = v, w


@inlined
def shown(c: Row, value: float, resolution: float) -> float:
    """Return ``value`` in whole multiples of ``resolution``, or exactly with ideal sensors."""
    if c.real_sensors == 0.0:
        return value
    return math.floor(value / resolution + 0.5) * resolution


@inlined
def belt_status(clutched: bool, at_limit: bool, at_stop: bool) -> float:
    """Return the sum of the BELT_* bits of layout.py that the physics uses."""
    return clutched * 2.0 + (clutched and at_limit) * 4.0 + at_stop * 8.0


@inlined
def sense(constants: Rows, state: Rows, commands: Rows, readings: Rows, seed: int, t: int) -> None:
    """Fill ``readings`` with what every sensor shows of ``state`` at ``t`` ns."""
    c, s, u, out = constants[0], state[0], commands[0], readings[0]
    belt, belt_on = limited(u.belt_speed, c.belt_speed), u.belt_engaged > 0.5
    across, lateral_on = limited(u.lateral_speed, c.lateral_speed), u.lateral_engaged > 0.5
    slip = c.r * s.w - s.v
    g, bend = stribeck(c, slip)
    lateral, _ = lateral_force(c, s.vz)
    acceleration = speed_rates(c, s, s.v, s.w, g, bend, lateral, belt, belt_on)[0]
    noise_a, noise_i = normal_pair(seed, t)

    out.motor_counts = shown(c, s.theta * c.motor_scale, 1.0)
    out.guide_counts = shown(c, s.x / c.guide_resolution, 1.0)
    shake = c.acc_shake * s.v * math.sin(2.0 * c.transitions * s.theta)
    felt = c.acc_gain * acceleration + shake + c.acc_bias + c.acc_noise * noise_a
    volts = shown(c, felt * c.acc_sensitivity, c.card_resolution)
    out.acceleration_volts = limited(volts, c.card_range)
    monitored = (s.i + c.monitor_zero + c.monitor_noise * noise_i) * c.monitor_sensitivity
    out.current_volts = limited(shown(c, monitored, c.card_resolution), c.card_range)
    demand = demanded_current(c, u)
    out.amplifier_status = (
        (u.wheel_enabled > 0.5) * 1.0
        + (abs(u.wheel_current) > c.current_limit) * 2.0
        + (reachable_current(c, s.w, demand) != demand) * 4.0
    )

    force, _, at_limit = servo(c.belt_kp, c.belt_ki, c.belt_limit, belt - s.v, s.belt_sum)
    out.belt_position = shown(c, s.x, c.belt_position)
    out.belt_speed = shown(c, s.v, c.belt_speed_lsb)
    out.belt_force = shown(c, force, c.belt_force_lsb) if belt_on else 0.0
    out.belt_status = belt_status(belt_on, at_limit, s.x < c.x_low or s.x > c.x_high)
    force, _, at_limit = servo(
        c.lateral_kp, c.lateral_ki, c.lateral_limit, across - s.vz, s.lateral_sum
    )
    out.bridge_position = shown(c, s.z, c.belt_position)
    out.bridge_speed = shown(c, s.vz, c.belt_speed_lsb)
    out.bridge_force = shown(c, force, c.belt_force_lsb) if lateral_on else 0.0
    out.bridge_status = belt_status(lateral_on, at_limit, s.z < c.z_low or s.z > c.z_high)

    out.carriage_position, out.carriage_speed, out.wheel_speed = s.x, s.v, s.w
    out.slip_speed, out.bristle_deflection = slip, s.p
    out.traction_force = traction(c, s.p, slip, g, bend)[0]
    out.motor_current = s.i
    guide, rolling, _ = resistances(c, s.v, loads(c, lateral)[0])
    out.guide_friction, out.rolling_resistance = guide, rolling
    out.lateral_speed, out.lateral_force = s.vz, lateral


@kernel
def advance(
    constants: Rows,
    state: Rows,
    commands: Rows,
    readings: Rows,
    seed: int,
    t_ns: int,
    elapsed_ns: int,
) -> None:
    """Advance ``state`` by ``elapsed_ns`` to ``t_ns`` and fill ``readings``: one cycle."""
    # Whole steps in nanoseconds, so that 1 ms is the same 8 steps in however long a call.
    steps = math.ceil(elapsed_ns / constants[0].step_ns)
    if steps > 0:
        integrate(constants, state, commands, elapsed_ns / steps * 1e-9, steps)
    sense(constants, state, commands, readings, seed, t_ns)
