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

from rigd.model.machine.kernel import inlined, kernel
from rigd.sdk.noise import normal_pair
from rigd_sim.articulated.records import Robot

#: One row of what records.py lays out, and the array that holds it.
Row = Any
Rows = NDArray[np.void]
Integers = NDArray[np.int64]
Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

#: Laws and loads by their numbers in layout.py.
PAPER, SMOOTH = 0.0, 1.0
TRANSFER, VERTICAL = 2.0, 3.0
#: Columns of a module in ``work`` (records.WORK), and its states on the suspension (records.LEGS).
COS, SIN, FX, FY, MOMENT, AT, AT_COS, AT_SIN, ROW = 0, 1, 2, 3, 4, 5, 6, 7, 8
LEGS = 6
#: Bits of a number of modules or spins: with it the compiler knows that none is negative, and that
#: no index counts from the end.
COUNT = 0xFFFF
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


@inlined
def sign_of(ratio: float) -> float:
    """Return tanh, which is 1 to all digits beyond 20: the regularised sign of Eq. 12."""
    if ratio > 20.0:
        return 1.0
    if ratio < -20.0:
        return -1.0
    return math.tanh(ratio)


@inlined
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


@inlined
def saturated(c: Row, module: Row, square: float, load: float, slides: bool) -> float:
    """Return the contact force over its trial force: Eq. 20, read as in articulated.md 1.3.

    ``square`` is the squared trial force, ``slides`` the branch of the paper's law. The smooth law
    goes from one branch to the other by a quintic between (1 - width) and (1 + width) mu_s f_n, and
    is the paper's beyond; the linear law has no limit.
    """
    if c.law == PAPER:
        return float(module.mu_d * load / math.sqrt(max(square, 1e-300))) if slides else 1.0
    if c.law != SMOOTH:
        return 1.0
    limit = module.mu_s * load
    low = (1.0 - c.width) * limit
    if square <= low * low:
        return 1.0
    force = math.sqrt(square)
    sliding = float(module.mu_d * load / force)
    if force >= (1.0 + c.width) * limit:
        return sliding
    at = (force - low) / (2.0 * c.width * limit)
    blend = at * at * at * (10.0 - at * (15.0 - 6.0 * at))
    return 1.0 + float(blend) * (sliding - 1.0)


@inlined
def motor_torque(motor: Row, target: float, speed: float, integral: float) -> tuple[float, float]:
    """Return the motor's torque in N m, and the rate of the integral of its speed error in rad."""
    error = target - speed
    demand = motor.kp * error + motor.ki * integral
    if demand > motor.torque_limit:
        return motor.torque_limit, min(error, 0.0)
    if demand < -motor.torque_limit:
        return -motor.torque_limit, max(error, 0.0)
    return demand, error


@inlined
def leg(module: Row, y: Floats, legs: int, front: float, left: float) -> tuple[float, float]:
    """Return by how much a leg is pressed in m, and the upward speed of its top in m/s."""
    x, side = front * module.d, left * module.b
    rise = y[legs] + side * y[legs + 1] - x * y[legs + 2]
    rate = y[legs + 3] + side * y[legs + 4] - x * y[legs + 5]
    return module.load / module.stiffness - rise, rate


@inlined
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


@inlined
def stop_moment(behind: Row, angle: float, rate: float) -> tuple[float, float]:
    """Return the moment in N m on the module ahead, and its part that is spring, at a hinge.

    ``behind`` is the module behind the hinge, which has its stop.
    """
    if angle > behind.stop:
        spring = behind.stop_stiffness * (angle - behind.stop)
        return -max(0.0, spring * (1.0 + behind.stop_damping * rate)), -spring
    if angle < -behind.stop:
        spring = behind.stop_stiffness * (-behind.stop - angle)
        return max(0.0, spring * (1.0 - behind.stop_damping * rate)), spring
    return 0.0, 0.0


@inlined
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


@inlined
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


@inlined
def evaluate(
    c: Row, modules: Rows, spins: Rows, beta: Floats, gram: Floats, wheel_spin: Integers,
    commands: Floats, y: Floats, dy: Floats, slides: Flags, excess: Floats, torques: Floats,
    work: Floats, shown: Floats | None,
) -> None:  # fmt: skip
    """Set ``dy``, the rates of the state ``y`` in SI units (records.Robot.size has the order).

    ``c`` has the constants of the robot, ``modules`` and ``spins`` a row for each, ``commands`` the
    target of each motor in rad/s and whether it is on; ``beta``, ``gram`` and ``wheel_spin`` are as
    in :class:`~rigd_sim.articulated.records.Robot`, ``work`` is room for what is computed on the
    way.

    ``excess`` gets for each wheel the squared trial force over the square of mu_s f_n, less 1;
    ``torques`` the torque of each motor in N m, then the regularised sign of each spin's speed. If
    ``shown`` is given, shape (4 n, 5), it gets longitudinal and lateral slip in m/s, f_lon, f_lat
    and normal force in N. Arrays are passed one by one: a slice, or a field of a tuple, would be
    counted as a reference, which costs as much as a wheel.
    """
    n, m = modules.size & COUNT, spins.size & COUNT
    moving, turning = n + 2, 2 * n + 4
    sums, angles, energy = turning + m, turning + 2 * m, turning + 3 * m
    supplied, lost = 0.0, 0.0
    for j in range(m):
        speed = y[turning + j]
        dy[angles + j] = speed
        torques[j], dy[sums + j] = 0.0, 0.0
        if spins[j].driven > 0.5 and commands[j, 1] > 0.5:
            motor = spins[j].ratio * speed
            torques[j], dy[sums + j] = motor_torque(spins[j], commands[j, 0], motor, y[sums + j])
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
        vx, vy = y[moving], y[moving + 1]
        for j in range(n):
            rim = beta[i, j] * y[moving + 2 + j]
            vx -= rim * work[j, SIN]
            vy += rim * work[j, COS]
        forward, aside = cosine * vx + sine * vy, cosine * vy - sine * vx
        has_suspension = c.loads == VERTICAL
        if has_suspension:
            forward -= module.lever * y[legs + 5]
            aside += module.height * y[legs + 4]
        k_lon, k_lat, load = module.k_lon, module.k_lat, module.load
        limit = module.mu_s * load
        bend = (1.0 - c.width) * (1.0 - c.width) - 1.0  # where the smooth law leaves the line
        along, across, moment = 0.0, 0.0, 0.0
        lift, roll, pitch = 0.0, 0.0, 0.0
        for k in range(4):
            front = 1.0 if k < 2 else -1.0
            left = 1.0 if k & 1 else -1.0
            j = wheel_spin[i, k]
            spin = y[turning + j]
            slip = module.r * spin - forward + left * module.b * omega
            eta = aside + front * module.d * omega
            if c.loads >= TRANSFER:  # coefficients in proportion to the load
                load = wheel_load(c, module, y, legs, front, left)
                share = load / module.load
                k_lon, k_lat = share * module.k_lon, share * module.k_lat
                limit = module.mu_s * load
            f_lon, f_lat = k_lon * slip, -k_lat * eta
            square = f_lon * f_lon + f_lat * f_lat
            excess[4 * i + k] = square / (limit * limit) - 1.0 if limit > 0.0 else -1.0
            if slides[4 * i + k] or (c.law == SMOOTH and excess[4 * i + k] > bend):
                scale = saturated(c, module, square, load, slides[4 * i + k])
                f_lon *= scale
                f_lat *= scale
            if shown is not None:
                shown[4 * i + k, 0], shown[4 * i + k, 1] = slip, eta
                shown[4 * i + k, 2], shown[4 * i + k, 3], shown[4 * i + k, 4] = f_lon, f_lat, load
            along += f_lon
            across += f_lat
            moment += front * module.d * f_lat - left * module.b * f_lon
            rolling = module.k_roll * load * torques[m + j]
            dy[turning + j] -= module.r * f_lon + rolling
            lost += f_lon * slip - f_lat * eta + rolling * spin
            if has_suspension:
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
                if has_suspension and spins[j].module == i:
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
        stop, spring = stop_moment(modules[i + 1], y[2 + i] - y[3 + i], rate)
        dy[moving + 2 + i] += stop
        dy[moving + 3 + i] -= stop
        lost += (spring - stop) * rate
    solve(work, dy, n, moving + 2)
    dy[energy], dy[energy + 1] = supplied, lost


@inlined
def refer(work: Floats, y: Floats, n: int, exactly: bool) -> None:
    """Let the next sines and cosines be computed from those at the headings of ``y``."""
    for i in range(n):
        if exactly:
            work[i, AT_COS], work[i, AT_SIN] = math.cos(y[2 + i]), math.sin(y[2 + i])
        else:
            work[i, AT_COS], work[i, AT_SIN] = work[i, COS], work[i, SIN]
        work[i, AT] = y[2 + i]


@inlined
def farthest(slides: Flags, excess: Floats) -> float:
    """Return how far the contact that is farthest beyond its branch is; negative: none is."""
    worst = -1.0
    for wheel in range(slides.size):
        worst = max(worst, -excess[wheel] if slides[wheel] else excess[wheel])
    return worst


@inlined
def sort_branches(slides: Flags, excess: Floats, least: float) -> None:
    """Change the branch of every contact that is beyond its own by more than ``least``."""
    for wheel in range(slides.size):
        if (-excess[wheel] if slides[wheel] else excess[wheel]) > least:
            slides[wheel] = not slides[wheel]


@inlined
def keep_poses(track: Floats, row: int, beta: Floats, work: Floats, y: Floats, n: int) -> None:
    """Write the centres in m and headings in rad of all modules to a row of ``track``."""
    for i in range(n):
        x, aside = y[0], y[1]
        for j in range(n):
            x += beta[i, j] * work[j, COS]
            aside += beta[i, j] * work[j, SIN]
        track[row, 3 * i], track[row, 3 * i + 1], track[row, 3 * i + 2] = x, aside, y[2 + i]


@inlined
def integrate(
    robot: Robot, commands: Floats, state: Floats, slides: Flags, scratch: Floats, track: Floats,
    first: int, step: float, steps: int, anew: bool,
) -> None:  # fmt: skip
    """Advance ``state`` by ``steps`` of ``step`` s with ``commands`` held.

    Without ``anew`` it goes on with the ``scratch`` of the call before, whose commands and last
    state are these: bit for bit as if both were one call.
    The poses after step k are written to row ``(first + k) % rows`` of ``track``, if it has rows.
    A step in which contacts leave their branch is cut where the first does, by bisection.
    """
    c, n, m, size = robot.constants[0], robot.modules.size, robot.spins.size, state.size
    modules, spins, beta, gram = robot.modules, robot.spins, robot.beta, robot.gram
    wheels = robot.wheel_spin
    for j in range(m):
        if commands[j, 1] < 0.5:
            state[2 * n + 4 + m + j] = 0.0  # a drive that is off forgets its integral
    active = size if c.loads >= TRANSFER else size - LEGS * n
    rates = scratch[: 7 * size].reshape(7, size)
    k1, k2, k3, k4, y, new, k_new = (
        rates[0], rates[1], rates[2], rates[3], rates[4], rates[5], rates[6]
    )  # fmt: skip
    at = 7 * size + n * (ROW + n)
    work = scratch[7 * size : at].reshape(n, ROW + n)
    t, e = scratch[at : at + 2 * m], scratch[at + 2 * m : at + 2 * m + 4 * n]
    u, s, none = commands, slides, None

    if anew:
        refer(work, state, n, True)
        evaluate(c, modules, spins, beta, gram, wheels, u, state, k1, s, e, t, work, none)
        if c.law == PAPER and farthest(slides, e) > BEYOND:
            sort_branches(slides, e, BEYOND)
            evaluate(c, modules, spins, beta, gram, wheels, u, state, k1, s, e, t, work, none)
    for number in range(steps):
        rest, events = step, 0
        while rest > 0.0:
            refer(work, state, n, (first + number) % ANEW == 0)
            h, low, high, searching = rest, 0.0, rest, False
            while True:
                half, sixth = 0.5 * h, h / 6.0
                for i in range(active):
                    y[i] = state[i] + half * k1[i]
                evaluate(c, modules, spins, beta, gram, wheels, u, y, k2, s, e, t, work, none)
                for i in range(active):
                    y[i] = state[i] + half * k2[i]
                evaluate(c, modules, spins, beta, gram, wheels, u, y, k3, s, e, t, work, none)
                for i in range(active):
                    y[i] = state[i] + h * k3[i]
                evaluate(c, modules, spins, beta, gram, wheels, u, y, k4, s, e, t, work, none)
                for i in range(active):
                    new[i] = state[i] + sixth * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i])
                evaluate(c, modules, spins, beta, gram, wheels, u, new, k_new, s, e, t, work, none)
                if c.law != PAPER or events >= EVENTS:
                    break
                beyond = farthest(slides, e)
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
                state[i] = new[i]
                k1[i] = k_new[i]
            rest -= h
            if searching:
                sort_branches(slides, e, -TOGETHER)
                events += 1
                evaluate(c, modules, spins, beta, gram, wheels, u, state, k1, s, e, t, work, none)
        if track.shape[0] > 0:
            keep_poses(track, (first + number + 1) % track.shape[0], beta, work, state, n)


@kernel
def advance(
    robot: Robot, commands: Floats, state: Floats, slides: Flags, scratch: Floats, track: Floats,
    first: int, step: float, steps: int, anew: bool, readings: Floats, seed: int, t_ns: int,
) -> None:  # fmt: skip
    """Take ``steps``, as :func:`integrate` does, and read the motors at ``t_ns``: one cycle.

    ``readings``, shape (m, 2), gets motor speed in rad/s and torque in N m, with their noise.
    """
    if steps > 0:
        integrate(robot, commands, state, slides, scratch, track, first, step, steps, anew)
    c, n, m = robot.constants[0], robot.modules.size, robot.spins.size
    for j in range(m):
        speed, torque = robot.spins[j].ratio * state[2 * n + 4 + j], 0.0
        if robot.spins[j].driven > 0.5 and commands[j, 1] > 0.5:
            sums = 2 * n + 4 + m
            torque, _ = motor_torque(robot.spins[j], commands[j, 0], speed, state[sums + j])
        noise_speed, noise_torque = normal_pair(seed, t_ns * 32 + j)
        readings[j, 0] = speed + c.speed_noise * noise_speed
        readings[j, 1] = torque + c.torque_noise * noise_torque


@kernel
def show(
    robot: Robot, commands: Floats, state: Floats, slides: Flags, scratch: Floats, module: int,
    out: Floats,
) -> None:  # fmt: skip
    """Fill ``out`` with the hidden state of a module, in the order of layout.TRUTH."""
    n, m, size = robot.modules.size, robot.spins.size, state.size
    at = 7 * size + n * (ROW + n)
    work = scratch[7 * size : at].reshape(n, ROW + n)
    excess, shown = scratch[at + 2 * m : at + 2 * m + 4 * n], np.zeros((4 * n, 5))
    refer(work, state, n, True)
    evaluate(
        robot.constants[0], robot.modules, robot.spins, robot.beta, robot.gram, robot.wheel_spin,
        commands, state, scratch[size : 2 * size], slides, excess, scratch[at : at + 2 * m], work,
        shown,
    )  # fmt: skip
    x, y, vx, vy = state[0], state[1], state[n + 2], state[n + 3]
    for j in range(n):
        reach, rim = robot.beta[module, j], robot.beta[module, j] * state[n + 4 + j]
        x, y = x + reach * work[j, COS], y + reach * work[j, SIN]
        vx, vy = vx - rim * work[j, SIN], vy + rim * work[j, COS]
    cosine, sine = work[module, COS], work[module, SIN]
    out[0], out[1], out[2] = x, y, state[2 + module]
    out[3], out[4], out[5] = cosine * vx + sine * vy, cosine * vy - sine * vx, state[n + 4 + module]
    out[6] = state[1 + module] - state[2 + module] if module > 0 else 0.0
    for k in range(4):
        wheel = 4 * module + k
        out[7 + 7 * k] = state[2 * n + 4 + robot.wheel_spin[module, k]]
        for column in range(5):
            out[8 + 7 * k + column] = shown[wheel, column]
        out[13 + 7 * k] = 1.0 if excess[wheel] > 0.0 else 0.0
