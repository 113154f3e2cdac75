"""Computes the physics of the articulated robot, in compiled code (numba).

The equations are the closed form of ``articulated.md`` sections 2 and 7, for any number of modules:
the centre of mass moves by the sum of all forces, the headings by n coupled equations, and each
spin (a wheel, or two that are geared together) by itself. Nothing is constrained: with slip the
robot is a plain Lagrangian system. Equation numbers are the paper's ("Modelling and experimental
validation of articulated mobile robots with hybrid locomotion system"); their misprints are
corrected as in ``articulated.md`` 1.

The integrator takes fixed steps by Runge-Kutta (4th order). The law of the paper jumps where a
contact begins to slide and where it grips again: each contact keeps its branch for a whole step,
and a step in which one leaves its branch is cut there. Sines and cosines of the stages follow
from those of the step by the angle between them; tanh is 1 beyond 20, and is then not computed.

All code that is compiled with the integrator is in this file, because numba's cache notices changes
only in the file of the entry point. The noise, which does not change, is in another.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigd.model.kernel import kernel
from rigd.sdk.noise import normal_pair
from rigd_sim.plants.articulated.records import Robot

#: One row of what records.py lays out.
Row = Any
Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

#: Laws and loads by their numbers in layout.py.
PAPER, SMOOTH = 0.0, 1.0
TRANSFER, VERTICAL = 2.0, 3.0
#: Columns of a module in ``work`` (records.WORK), and its states on the suspension (records.LEGS).
COS, SIN, FX, FY, MOMENT, AT, AT_COS, AT_SIN, ROW = 0, 1, 2, 3, 4, 5, 6, 7, 8
LEGS = 6
#: How far (squared force over squared limit, less 1) a contact must be beyond its branch.
BEYOND = 1e-9
#: How near to its branch's end a contact changes together with another.
TOGETHER = 1e-11
#: How near to it the end of a branch is located.
LOCATED = 1e-12
#: Events of one step; contacts that still alternate then keep their branch to its end.
EVENTS = 32
#: Steps after which sines and cosines are computed anew.
ANEW = 64


@kernel
def sign_of(ratio: float) -> float:
    """Return tanh, which is 1 to all digits beyond 20: the regularised sign of Eq. 12."""
    if ratio > 20.0:
        return 1.0
    if ratio < -20.0:
        return -1.0
    return math.tanh(ratio)


@kernel
def turn(work: Floats, i: int, heading: float) -> None:
    """Set cosine and sine of ``heading`` from those at a heading nearby."""
    angle = heading - work[i, AT]
    square = angle * angle
    if square > 4e-4:  # 0.02 rad: beyond, the series below err by more than 1e-19
        work[i, COS], work[i, SIN] = math.cos(heading), math.sin(heading)
        return
    s = angle * (1.0 - square / 6.0 * (1.0 - square / 20.0 * (1.0 - square / 42.0)))
    c = 1.0 - square / 2.0 * (1.0 - square / 12.0 * (1.0 - square / 30.0))
    work[i, COS] = work[i, AT_COS] * c - work[i, AT_SIN] * s
    work[i, SIN] = work[i, AT_SIN] * c + work[i, AT_COS] * s


@kernel
def share(c: Row, square: float, load: float, slides: bool) -> float:
    """Return the contact force over its trial force: Eq. 20, read as in articulated.md 1.3.

    ``square`` is the squared trial force, ``slides`` the branch of the paper's law. The smooth law
    goes from one branch to the other by a quintic between (1 - width) and (1 + width) mu_s f_n, and
    is the paper's beyond; the linear law has no limit.
    """
    if c.law == PAPER:
        return float(c.mu_d * load / math.sqrt(max(square, 1e-300))) if slides else 1.0
    if c.law != SMOOTH:
        return 1.0
    limit = c.mu_s * load
    low = (1.0 - c.width) * limit
    if square <= low * low:
        return 1.0
    force = math.sqrt(square)
    sliding = float(c.mu_d * load / force)
    if force >= (1.0 + c.width) * limit:
        return sliding
    at = (force - low) / (2.0 * c.width * limit)
    blend = at * at * at * (10.0 - at * (15.0 - 6.0 * at))
    return 1.0 + float(blend) * (sliding - 1.0)


@kernel
def motor_torque(c: Row, target: float, speed: float, integral: float) -> tuple[float, float]:
    """Return the motor's torque in N m, and the rate of the integral of its speed error in rad."""
    error = target - speed
    demand = c.kp * error + c.ki * integral
    if demand > c.torque_limit:
        return c.torque_limit, min(error, 0.0)
    if demand < -c.torque_limit:
        return -c.torque_limit, max(error, 0.0)
    return demand, error


@kernel
def leg(module: Row, y: Floats, legs: int, front: float, left: float) -> tuple[float, float]:
    """Return by how much a leg is pressed in m, and the upward speed of its top in m/s."""
    x, side = front * module.d, left * module.b
    rise = y[legs] + side * y[legs + 1] - x * y[legs + 2]
    rate = y[legs + 3] + side * y[legs + 4] - x * y[legs + 5]
    return module.load / module.stiffness - rise, rate


@kernel
def wheel_load(c: Row, module: Row, y: Floats, legs: int, front: float, left: float) -> float:
    """Return the normal force in N of the wheel at (``front`` d, ``left`` b).

    ``legs`` is where the module's suspension is in ``y``. With load transfer the lagged forces
    tilt the module; with vertical dynamics a leg is a spring and damper that never pulls.
    """
    if c.loads == TRANSFER:
        along = module.height * y[legs] / (4.0 * module.d)
        across = module.height * y[legs + 1] / (4.0 * module.b)
        return float(max(0.0, module.load - front * along - left * across))
    if c.loads == VERTICAL:
        pressed, rate = leg(module, y, legs, front, left)
        return float(max(0.0, module.stiffness * pressed - module.damping * rate))
    return float(module.load)


@kernel
def contact(
    c: Row, module: Row, y: Floats, legs: int, front: float, left: float,
    slip: float, eta: float, slides: bool,
) -> tuple[float, float, float, float]:  # fmt: skip
    """Return normal force, f_lon and f_lat of a wheel in N, and how far it is beyond mu_s f_n.

    ``slip`` is r phi' - rho', ``eta`` the lateral speed, both in m/s. The last value is the squared
    trial force over the square of mu_s f_n, less 1.
    """
    load, k_lon, k_lat = module.load, module.k_lon, module.k_lat
    if c.loads >= TRANSFER:  # coefficients in proportion to the load: without, nothing changes
        load = wheel_load(c, module, y, legs, front, left)
        k_lon *= load / module.load
        k_lat *= load / module.load
    f_lon, f_lat = k_lon * slip, -k_lat * eta
    square = f_lon * f_lon + f_lat * f_lat
    limit = c.mu_s * load
    excess = square / (limit * limit) - 1.0 if limit > 0.0 else -1.0
    if slides or c.law == SMOOTH:
        scale = share(c, square, load, slides)
        f_lon *= scale
        f_lat *= scale
    return load, f_lon, f_lat, excess


@kernel
def body_speeds(
    c: Row, module: Row, beta: Floats, work: Floats, y: Floats, i: int, n: int, legs: int
) -> tuple[float, float]:
    """Return the speeds in m/s, forward and to the left, with which a module moves its wheels."""
    vx, vy = y[n + 2], y[n + 3]
    for j in range(n):
        rim = beta[i, j] * y[n + 4 + j]
        vx -= rim * work[j, SIN]
        vy += rim * work[j, COS]
    forward = work[i, COS] * vx + work[i, SIN] * vy
    aside = work[i, COS] * vy - work[i, SIN] * vx
    if c.loads == VERTICAL:
        forward -= module.lever * y[legs + 5]
        aside += module.height * y[legs + 4]
    return forward, aside


@kernel
def stop_moment(c: Row, angle: float, rate: float) -> tuple[float, float]:
    """Return the moment in N m on the module ahead, and its part that is spring, at a hinge."""
    if angle > c.stop:
        spring = c.stop_stiffness * (angle - c.stop)
        return -max(0.0, spring * (1.0 + c.stop_damping * rate)), -spring
    if angle < -c.stop:
        spring = c.stop_stiffness * (-c.stop - angle)
        return max(0.0, spring * (1.0 - c.stop_damping * rate)), spring
    return 0.0, 0.0


@kernel
def solve(work: Floats, rates: Floats, n: int, at: int) -> None:
    """Solve the symmetric equations in ``work``, whose right side is in ``rates[at:at + n]``."""
    for i in range(n):
        pivot = 1.0 / work[i, ROW + i]
        for j in range(i + 1, n):
            factor = work[i, ROW + j] * pivot
            for k in range(j, n):
                work[j, ROW + k] -= factor * work[i, ROW + k]
            rates[at + j] -= factor * rates[at + i]
    for i in range(n - 1, -1, -1):
        value = rates[at + i]
        for j in range(i + 1, n):
            value -= work[i, ROW + j] * rates[at + j]
        rates[at + i] = value / work[i, ROW + i]


@kernel
def legs_rates(
    c: Row, module: Row, y: Floats, dy: Floats, legs: int, along: float, across: float,
    lift: float, roll: float, pitch: float, torque: float,
) -> None:  # fmt: skip
    """Set the rates of a module on its suspension.

    ``along, across`` are the sums of the contact forces in N; ``lift, roll, pitch`` force and
    moments of the legs about the centre of mass; ``torque`` what the motors turn the wheels with.
    """
    if c.loads == TRANSFER:
        dy[legs] = module.lag * (along - y[legs])
        dy[legs + 1] = module.lag * (across - y[legs + 1])
        return
    dy[legs], dy[legs + 1], dy[legs + 2] = y[legs + 3], y[legs + 4], y[legs + 5]
    dy[legs + 3] = (lift - 4.0 * module.load) / module.mass
    dy[legs + 4] = (roll + module.height * across) / module.roll_inertia
    dy[legs + 5] = (pitch - module.lever * along - torque) / module.pitch_inertia


@kernel
def evaluate(
    robot: Robot, commands: Floats, y: Floats, dy: Floats, slides: Flags, excess: Floats,
    torques: Floats, work: Floats,
) -> None:  # fmt: skip
    """Set ``dy``, the rates of the state ``y`` (records.Robot.size has the order).

    ``excess`` gets for each wheel how far it is beyond mu_s f_n (see :func:`contact`); ``torques``
    the torque of each motor in N m, then the regularised sign of each spin's speed.
    """
    c, modules, spins = robot.constants[0], robot.modules, robot.spins
    beta, gram = robot.beta, robot.gram
    n, m = modules.size, spins.size
    moving, turning = n + 2, 2 * n + 4
    sums, angles, energy = turning + m, turning + 2 * m, turning + 3 * m
    supplied, lost = 0.0, 0.0
    for j in range(m):
        speed = y[turning + j]
        dy[angles + j] = speed
        torques[j], dy[sums + j] = 0.0, 0.0
        if spins[j].driven > 0.5 and commands[j, 1] > 0.5:
            motor = spins[j].ratio * speed
            torques[j], dy[sums + j] = motor_torque(c, commands[j, 0], motor, y[sums + j])
        dy[turning + j] = spins[j].ratio * torques[j]
        torques[m + j] = sign_of(speed / c.rest)
        supplied += dy[turning + j] * speed
    for i in range(moving):
        dy[i] = y[moving + i]
    for i in range(n):
        turn(work, i, y[2 + i])

    total_x, total_y = 0.0, 0.0
    for i in range(n):
        module = modules[i]
        cosine, sine, omega = work[i, COS], work[i, SIN], y[moving + 2 + i]
        legs = energy + 2 + LEGS * i
        forward, aside = body_speeds(c, module, beta, work, y, i, n, legs)
        swings = c.loads == VERTICAL
        along, across, moment = 0.0, 0.0, 0.0
        lift, roll, pitch = 0.0, 0.0, 0.0
        for k in range(4):
            front = 1.0 if k < 2 else -1.0
            left = 1.0 if k & 1 else -1.0
            j = robot.wheel_spin[i, k]
            spin = y[turning + j]
            slip = module.r * spin - forward + left * module.b * omega
            eta = aside + front * module.d * omega
            load, f_lon, f_lat, excess[4 * i + k] = contact(
                c, module, y, legs, front, left, slip, eta, slides[4 * i + k]
            )
            along += f_lon
            across += f_lat
            moment += front * module.d * f_lat - left * module.b * f_lon
            rolling = module.k_roll * load * torques[m + j]
            dy[turning + j] -= module.r * f_lon + rolling
            lost += f_lon * slip - f_lat * eta + rolling * spin
            if swings:
                pressed, rate = leg(module, y, legs, front, left)
                lost += (module.stiffness * max(0.0, pressed) - load) * rate
                lift += load
                roll += left * module.b * load
                pitch -= front * module.d * load
        work[i, FX] = cosine * along - sine * across
        work[i, FY] = sine * along + cosine * across
        work[i, MOMENT] = moment
        total_x += work[i, FX]
        total_y += work[i, FY]
        if c.loads >= TRANSFER:
            torque = 0.0
            for j in range(m):
                if swings and spins[j].module == i:
                    torque += spins[j].ratio * torques[j]
            supplied -= torque * y[legs + 5]
            legs_rates(c, module, y, dy, legs, along, across, lift, roll, pitch, torque)
    for j in range(m):
        dy[turning + j] /= spins[j].inertia
    dy[moving], dy[moving + 1] = total_x / c.mass, total_y / c.mass

    for i in range(n):
        cosine, sine = work[i, COS], work[i, SIN]
        right = work[i, MOMENT]
        for j in range(n):
            right += beta[j, i] * (cosine * work[j, FY] - sine * work[j, FX])
            rate = y[moving + 2 + j]
            apart = sine * work[j, COS] - cosine * work[j, SIN]
            right -= gram[i, j] * apart * rate * rate
            work[i, ROW + j] = gram[i, j] * (cosine * work[j, COS] + sine * work[j, SIN])
        work[i, ROW + i] += modules[i].inertia
        dy[moving + 2 + i] = right
    for i in range(n - 1):
        rate = y[moving + 2 + i] - y[moving + 3 + i]
        stop, spring = stop_moment(c, y[2 + i] - y[3 + i], rate)
        dy[moving + 2 + i] += stop
        dy[moving + 3 + i] -= stop
        lost += (spring - stop) * rate
    solve(work, dy, n, moving + 2)
    dy[energy], dy[energy + 1] = supplied, lost


@kernel
def refer(work: Floats, y: Floats, n: int, exactly: bool) -> None:
    """Let the next sines and cosines be computed from those at the headings of ``y``."""
    for i in range(n):
        if exactly:
            work[i, AT_COS], work[i, AT_SIN] = math.cos(y[2 + i]), math.sin(y[2 + i])
        else:
            work[i, AT_COS], work[i, AT_SIN] = work[i, COS], work[i, SIN]
        work[i, AT] = y[2 + i]


@kernel
def farthest(slides: Flags, excess: Floats) -> float:
    """Return how far the contact that is farthest beyond its branch is; negative: none is."""
    worst = -1.0
    for wheel in range(slides.size):
        worst = max(worst, -excess[wheel] if slides[wheel] else excess[wheel])
    return worst


@kernel
def sort_branches(slides: Flags, excess: Floats, least: float) -> None:
    """Change the branch of every contact that is beyond its own by more than ``least``."""
    for wheel in range(slides.size):
        if (-excess[wheel] if slides[wheel] else excess[wheel]) > least:
            slides[wheel] = not slides[wheel]


@kernel
def keep_poses(track: Floats, row: int, beta: Floats, work: Floats, y: Floats, n: int) -> None:
    """Write the centres in m and headings in rad of all modules to a row of ``track``."""
    for i in range(n):
        x, aside = y[0], y[1]
        for j in range(n):
            x += beta[i, j] * work[j, COS]
            aside += beta[i, j] * work[j, SIN]
        track[row, 3 * i], track[row, 3 * i + 1], track[row, 3 * i + 2] = x, aside, y[2 + i]


@kernel
def runge_kutta(
    robot: Robot, commands: Floats, state: Floats, h: float, active: int, slides: Flags,
    rates: Floats, excess: Floats, torques: Floats, work: Floats,
) -> None:  # fmt: skip
    """Take a step of ``h`` s from ``state``, whose rates are in row 0 of ``rates``.

    The new state goes to row 5, its rates to row 6; each contact keeps its branch.
    """
    k1, k2, k3, k4, y, tried = rates[0], rates[1], rates[2], rates[3], rates[4], rates[5]
    half, sixth = 0.5 * h, h / 6.0
    for i in range(active):
        y[i] = state[i] + half * k1[i]
    evaluate(robot, commands, y, k2, slides, excess, torques, work)
    for i in range(active):
        y[i] = state[i] + half * k2[i]
    evaluate(robot, commands, y, k3, slides, excess, torques, work)
    for i in range(active):
        y[i] = state[i] + h * k3[i]
    evaluate(robot, commands, y, k4, slides, excess, torques, work)
    for i in range(active):
        tried[i] = state[i] + sixth * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i])
    evaluate(robot, commands, tried, rates[6], slides, excess, torques, work)


@kernel
def integrate(
    robot: Robot, commands: Floats, state: Floats, slides: Flags, scratch: Floats, track: Floats,
    first: int, step: float, steps: int,
) -> None:  # fmt: skip
    """Advance ``state`` by ``steps`` of ``step`` s with ``commands`` held.

    The poses after step k are written to row ``(first + k) % rows`` of ``track``, if it has rows.
    A step in which contacts leave their branch is cut where the first does, by bisection.
    """
    c, n, m, size = robot.constants[0], robot.modules.size, robot.spins.size, state.size
    for j in range(m):
        if commands[j, 1] < 0.5:
            state[2 * n + 4 + m + j] = 0.0  # a drive that is off forgets its integral
    active = size if c.loads >= TRANSFER else size - LEGS * n
    rates = scratch[: 7 * size].reshape(7, size)
    at = 7 * size + n * (ROW + n)
    work = scratch[7 * size : at].reshape(n, ROW + n)
    torques, excess = scratch[at : at + 2 * m], scratch[at + 2 * m : at + 2 * m + 4 * n]

    refer(work, state, n, True)
    evaluate(robot, commands, state, rates[0], slides, excess, torques, work)
    if c.law == PAPER and farthest(slides, excess) > BEYOND:
        sort_branches(slides, excess, BEYOND)
        evaluate(robot, commands, state, rates[0], slides, excess, torques, work)
    for number in range(steps):
        rest, events = step, 0
        while rest > 0.0:
            refer(work, state, n, number % ANEW == 0)
            h, low, high, searching = rest, 0.0, rest, False
            while True:
                runge_kutta(robot, commands, state, h, active, slides, rates, excess, torques, work)
                if c.law != PAPER or events >= EVENTS:
                    break
                beyond = farthest(slides, excess)
                if not searching:
                    if beyond <= BEYOND:
                        break
                    searching = True
                elif abs(beyond) <= LOCATED or high - low <= 1e-14 * step:
                    break
                elif beyond > 0.0:
                    high = h
                else:
                    low = h
                h = 0.5 * (low + high)
            for i in range(active):
                state[i] = rates[5, i]
                rates[0, i] = rates[6, i]
            rest -= h
            if searching:
                sort_branches(slides, excess, -TOGETHER)
                events += 1
                evaluate(robot, commands, state, rates[0], slides, excess, torques, work)
        if track.shape[0] > 0:
            keep_poses(track, (first + number + 1) % track.shape[0], robot.beta, work, state, n)


@kernel
def sense(
    robot: Robot, commands: Floats, state: Floats, readings: Floats, seed: int, t_ns: int
) -> None:
    """Fill ``readings``, shape (m, 2), with motor speed (rad/s) and torque (N m) at ``t_ns``."""
    c, n, m = robot.constants[0], robot.modules.size, robot.spins.size
    for j in range(m):
        speed, torque = robot.spins[j].ratio * state[2 * n + 4 + j], 0.0
        if robot.spins[j].driven > 0.5 and commands[j, 1] > 0.5:
            torque, _ = motor_torque(c, commands[j, 0], speed, state[2 * n + 4 + m + j])
        noise_speed, noise_torque = normal_pair(seed, t_ns * 32 + j)
        readings[j, 0] = speed + c.speed_noise * noise_speed
        readings[j, 1] = torque + c.torque_noise * noise_torque


@kernel
def show(robot: Robot, state: Floats, slides: Flags, i: int, out: Floats) -> None:
    """Fill ``out`` with the hidden state of module ``i``, in the order of layout.TRUTH."""
    c, n, m = robot.constants[0], robot.modules.size, robot.spins.size
    beta, module, turning = robot.beta, robot.modules[i], 2 * n + 4
    legs = turning + 3 * m + 2 + LEGS * i
    work = np.zeros((n, 2))
    x, aside = state[0], state[1]
    for j in range(n):
        work[j, COS], work[j, SIN] = math.cos(state[2 + j]), math.sin(state[2 + j])
        x += beta[i, j] * work[j, COS]
        aside += beta[i, j] * work[j, SIN]
    omega = state[n + 4 + i]
    forward, left_speed = body_speeds(c, module, beta, work, state, i, n, legs)
    out[0], out[1], out[2] = x, aside, state[2 + i]
    out[3], out[4], out[5] = forward, left_speed, omega
    out[6] = state[1 + i] - state[2 + i] if i > 0 else 0.0
    at = 7
    for k in range(4):
        front = 1.0 if k < 2 else -1.0
        left = 1.0 if k & 1 else -1.0
        spin = state[turning + robot.wheel_spin[i, k]]
        slip = module.r * spin - forward + left * module.b * omega
        eta = left_speed + front * module.d * omega
        load, f_lon, f_lat, excess = contact(
            c, module, state, legs, front, left, slip, eta, slides[4 * i + k]
        )
        out[at], out[at + 1], out[at + 2] = spin, slip, eta
        out[at + 3], out[at + 4], out[at + 5] = f_lon, f_lat, load
        out[at + 6] = 1.0 if excess > 0.0 else 0.0
        at += 7
