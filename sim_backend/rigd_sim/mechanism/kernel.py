"""Computes the physics of a mechanism, in compiled code (numba): one call integrates one cycle.

A step is one of the Rosenbrock method ROS4 of order 4 (Hairer and Wanner, Solving Ordinary
Differential Equations II, section IV.7, the L-stable coefficients of Table 7.2; here in the form
without products by the Jacobian, as KPP has it). L-stable: stiff bristles and buffers are followed
without small steps, and a fast mode that a step cannot resolve decays. Indices from data are
unsigned: numba then does not ask whether they are negative, which saves a tenth.

The unknowns are the positions x and speeds v of the degrees of freedom and one state z of each
element. An element has a force F(e, v, z, N) and a rate G(e, v, z), and acts along one strain
e = a x_i + b x_j. So the linear system of a stage is reduced to one of the size of v:

* x: s u_x - u_v = r_x
* z: (s - G_z) u_z - G_e (c u_x) - G_v (c u_v) = r_z
* v: s M u_v + sum c (F_e (c u_x) + F_v (c u_v) + F_z u_z + F_N dN) = M r_v

with s = 1/(gamma h) and c the row (a, b) of the element. What a spring presses changes by
dN = -(F_e, F_v) of that spring.

Where |v| has its kink, and where a drive saturates, the order falls to 2 for that step. All code
that is compiled with the integrator is in this file, because numba's cache notices changes only in
the file of the entry point. Only the noise is shared with other files, and it does not change.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigd.model.machine.kernel import inlined, kernel
from rigd.sdk.noise import normal_pair

#: One row of what records.py lays out, and the array of such rows.
Row = Any
Rows = NDArray[np.void]
Floats = NDArray[np.float64]

GAMMA = 0.57282
A21 = 2.0
A31, A32 = 1.867943637803922, 0.2344449711399156
C21 = -7.137615036412310
C31, C32 = 2.580708087951457, 0.6515950076447975
C41, C42, C43 = -2.137148994382534, -0.3214669691237626, -0.6949742501781779
M1, M2, M3, M4 = 2.255570073418735, 0.2870493262186792, 0.4353179431840180, 1.093502252409163

SPRING, CONSTANT, PENDULUM, STOP, SLIDING, BRISTLES, CURRENT, SPEED, POSITION = (
    0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0,
)  # fmt: skip
AT_POSITION, AT_SPEED, AT_FORCE, AT_LOAD, AT_TEMPERATURE = 0.0, 1.0, 2.0, 3.0, 4.0


@inlined
def limited(value: float, limit: float) -> float:
    """Return ``value`` within plus or minus ``limit``."""
    return min(max(value, -limit), limit)


@inlined
def fall(el: Row, v: float) -> tuple[float, float]:
    """Return g(v), and |v| dg/d|v|, which unlike the slope itself is finite at rest."""
    excess = el.f_s - el.f_c
    if excess == 0.0:
        return el.f_c, 0.0
    ratio = abs(v) / el.v_s
    if el.shape == 2.0:
        power = ratio * ratio
    elif el.shape == 1.0:
        power = ratio
    else:
        power = ratio**el.shape
    part = excess * math.exp(-power)
    return el.f_c + part, -el.shape * power * part


@inlined
def sliding(el: Row, v: float, load: float, out: Row) -> None:
    """Fill ``out`` with a law of speed alone."""
    pushed, slope = el.visc * v, el.visc
    if el.f_s > 0.0:
        g, bend = fall(el, v)
        sign = math.tanh(v / el.smooth)
        pushed += g * sign
        slope += g * (1.0 - sign * sign) / el.smooth
        if v != 0.0:
            slope += bend * sign / v
    out.pushed = pushed
    out.f, out.f_v = load * pushed, load * slope
    out.power = out.f * v


@inlined
def bristles(el: Row, v: float, z: float, load: float, out: Row) -> None:
    """Fill ``out`` with the LuGre law; g(v) is in shares of the load."""
    g, bend = fall(el, v)
    speed = abs(v)
    sign = 1.0 if v > 0.0 else -1.0 if v < 0.0 else 0.0
    back = el.s_0 * z / g
    rate = v - speed * back
    out.g = rate
    out.g_v = 1.0 - sign * back * (1.0 - bend / g)
    out.g_z = -el.s_0 * speed / g
    pushed = el.s_0 * z + el.s_1 * rate + el.visc * v
    out.pushed = pushed
    out.f = load * pushed
    out.f_v = load * (el.s_1 * out.g_v + el.visc)
    out.f_z = load * (el.s_0 + el.s_1 * out.g_z)
    out.power = out.f * v - load * el.s_0 * z * rate
    out.stored = 0.5 * load * el.s_0 * z * z


@inlined
def spring(el: Row, e: float, v: float, out: Row) -> None:
    """Fill ``out`` with a spring and its damper; within its play it has no force."""
    stretch = e
    if el.play > 0.0:
        stretch = e - limited(e, el.play)
        if stretch == 0.0:
            return
    force = el.k * stretch + el.d * v
    if el.play > 0.0 and force * stretch < 0.0:  # it would pull across the play
        out.stored = 0.5 * el.k * stretch * stretch
        out.power = -el.k * stretch * v
        return
    out.f, out.f_e, out.f_v = force, el.k, el.d
    out.power = el.d * v * v
    out.stored = 0.5 * el.k * stretch * stretch


@inlined
def stop(el: Row, e: float, v: float, out: Row) -> None:
    """Fill ``out`` with the buffer in contact; it never pulls."""
    pressed = e - min(max(e, el.low), el.high)
    if pressed == 0.0:
        return
    force = el.k * pressed + el.d * v
    out.stored = 0.5 * el.k * pressed * pressed
    if force * pressed < 0.0:
        out.power = -el.k * pressed * v
        return
    out.f, out.f_e, out.f_v = force, el.k, el.d
    out.power = el.d * v * v


@inlined
def current(el: Row, v: float, z: float, command: float, on: float, out: Row) -> None:
    """Fill ``out`` with a current z and its force; the supply may not drive what is demanded."""
    goal = limited(command, el.limit) if on > 0.5 else 0.0
    slope = 0.0
    if el.supply > 0.0:
        emf = el.k * v
        high, low = (el.supply - emf) / el.resistance, (-el.supply - emf) / el.resistance
        if goal > high or goal < low:
            goal = high if goal > high else low
            slope = -el.k / el.resistance
    out.f, out.f_z = -el.k * z, -el.k
    out.g, out.g_v, out.g_z = el.rate * (goal - z), el.rate * slope, -el.rate


@inlined
def servo(el: Row, e: float, v: float, z: float, command: float, on: float, out: Row) -> None:
    """Fill ``out`` with a PI controller of speed, behind one of position if that is its kind."""
    if on < 0.5:
        return
    target, outer = command, 0.0
    if el.kind == POSITION:
        target, outer = el.outer * (command - e), el.outer
    if abs(target) > el.fastest:
        target, outer = limited(target, el.fastest), 0.0
    error = target - v
    force = el.d * error + el.k * z
    if abs(force) <= el.limit:
        out.f, out.f_v, out.f_e, out.f_z = -force, el.d, el.d * outer, -el.k
    else:
        force = limited(force, el.limit)
        out.f = -force
        if error * force > 0.0:  # winds no further
            return
    out.g, out.g_v, out.g_e = error, -1.0, -outer


@inlined
def clear(out: Row) -> None:
    """Set all fields to 0."""
    out.f, out.f_e, out.f_v, out.f_z = 0.0, 0.0, 0.0, 0.0
    out.g, out.g_e, out.g_v, out.g_z = 0.0, 0.0, 0.0, 0.0
    out.pushed, out.press_e, out.press_v, out.power, out.stored = 0.0, 0.0, 0.0, 0.0, 0.0


@inlined
def evaluate(elements: Rows, commands: Floats, y: Floats, bodies: int, terms: Rows) -> None:
    """Fill ``terms`` with what every element does in the state ``y``."""
    speeds, inner = np.uint32(bodies + 1), np.uint32(2 * bodies + 2)
    for n in range(len(elements)):
        el, out = elements[n], terms[n]
        i, j = np.uint32(el.i), np.uint32(el.j)
        e = el.a * y[i] + el.b * y[j] + el.offset
        v = el.a * y[speeds + i] + el.b * y[speeds + j]
        z = y[inner + np.uint32(n)]
        clear(out)
        load = el.load
        if el.press >= 0.0:
            by = terms[int(el.press)]
            load = 0.0
            if by.f < 0.0:
                load, out.press_e, out.press_v = -by.f, -by.f_e, -by.f_v
        kind = el.kind
        if kind == SPRING:
            spring(el, e, v, out)
        elif kind == SLIDING:
            sliding(el, v, load, out)
        elif kind == BRISTLES:
            bristles(el, v, z, load, out)
        elif kind == CURRENT:
            c = int(el.command)
            current(el, v, z, commands[c, 0], commands[c, 1], out)
        elif kind >= SPEED:
            c = int(el.command)
            servo(el, e, v, z, commands[c, 0], commands[c, 1], out)
        elif kind == STOP:
            stop(el, e, v, out)
        elif kind == PENDULUM:
            out.f, out.f_e = el.k * math.sin(e), el.k * math.cos(e)
            out.stored = el.k * (1.0 - math.cos(e))
        else:
            out.f = el.k
            out.stored = el.k * e


@inlined
def factorise(
    masses: Floats, elements: Rows, terms: Rows, bodies: int, s: float, matrix: Floats
) -> None:
    """Fill ``matrix`` with the LU decomposition of the system for u_v; shape (bodies, bodies).

    The inverse of the diagonal of U stands on the diagonal. No pivots: the masses carry it, and
    steps are chosen so that a falling friction law takes at most half of them. ``terms`` get what
    :func:`solve` needs of each element.
    """
    for row in range(bodies):
        for column in range(bodies):
            matrix[row, column] = 0.0
        matrix[row, row] = s * masses[row]
    short = 1.0 / s
    for n in range(len(elements)):
        el, term = elements[n], terms[n]
        i, j = np.uint32(el.i), np.uint32(el.j)
        value = term.f_e * short + term.f_v
        term.way_f = term.f_e * short
        if el.kind >= BRISTLES:
            term.settled = 1.0 / (s - term.g_z)
            term.z_f = term.f_z * term.settled
            term.way_f += term.z_f * term.g_e * short
            value += term.z_f * (term.g_e * short + term.g_v)
        if value != 0.0:
            matrix[i, i] += value * el.a * el.a
            if j < bodies:
                matrix[i, j] += value * el.a * el.b
                matrix[j, i] += value * el.a * el.b
                matrix[j, j] += value * el.b * el.b
        if el.press >= 0.0:
            by = elements[int(el.press)]
            value = term.pushed * (term.press_e * short + term.press_v)
            p, q = np.uint32(by.i), np.uint32(by.j)
            matrix[i, p] += value * el.a * by.a
            if q < bodies:
                matrix[i, q] += value * el.a * by.b
            if j < bodies:
                matrix[j, p] += value * el.b * by.a
                if q < bodies:
                    matrix[j, q] += value * el.b * by.b
    for k in range(bodies):
        matrix[k, k] = 1.0 / matrix[k, k]
        for row in range(k + 1, bodies):
            if matrix[row, k] != 0.0:
                factor = matrix[row, k] * matrix[k, k]
                matrix[row, k] = factor
                for column in range(k + 1, bodies):
                    matrix[row, column] -= factor * matrix[k, column]


@inlined
def solve(elements: Rows, terms: Rows, bodies: int, s: float, matrix: Floats, u: Floats) -> None:
    """Replace ``u``, the right-hand side (r_x, r_v, r_z), by the solution of a stage.

    r_v is in the unit of forces: M times the acceleration.
    """
    speeds, inner = np.uint32(bodies + 1), np.uint32(2 * bodies + 2)
    for n in range(len(elements)):
        el, term = elements[n], terms[n]
        i, j = np.uint32(el.i), np.uint32(el.j)
        force = term.way_f * (el.a * u[i] + el.b * u[j])
        if el.kind >= BRISTLES:
            force += term.z_f * u[inner + np.uint32(n)]
            if el.press >= 0.0:
                force += pressing(elements, terms, u, n, s)
        elif el.kind == SLIDING and el.press >= 0.0:
            force += pressing(elements, terms, u, n, s)
        u[speeds + i] -= el.a * force
        if j < bodies:
            u[speeds + j] -= el.b * force
    for row in range(1, bodies):
        for k in range(row):
            u[speeds + np.uint32(row)] -= matrix[row, k] * u[speeds + np.uint32(k)]
    for row in range(bodies - 1, -1, -1):
        for k in range(row + 1, bodies):
            u[speeds + np.uint32(row)] -= matrix[row, k] * u[speeds + np.uint32(k)]
        u[speeds + np.uint32(row)] *= matrix[row, row]
    short = 1.0 / s
    for row in range(bodies):
        u[row] = (u[row] + u[speeds + np.uint32(row)]) * short
    for n in range(len(elements)):
        el = elements[n]
        if el.kind >= BRISTLES:
            term = terms[n]
            i, j = np.uint32(el.i), np.uint32(el.j)
            way = el.a * u[i] + el.b * u[j]
            speed = el.a * u[speeds + i] + el.b * u[speeds + j]
            u[inner + np.uint32(n)] = (
                u[inner + np.uint32(n)] + term.g_e * way + term.g_v * speed
            ) * term.settled


@inlined
def pressing(elements: Rows, terms: Rows, u: Floats, n: int, s: float) -> float:
    """Return what the way r_x of the spring that presses element ``n`` adds to its force."""
    by = elements[int(elements[n].press)]
    force: float = (
        terms[n].pushed
        * terms[n].press_e
        * (by.a * u[np.uint32(by.i)] + by.b * u[np.uint32(by.j)])
        / s
    )
    return force


@inlined
def rates(elements: Rows, terms: Rows, y: Floats, bodies: int, u: Floats) -> None:
    """Fill ``u`` with the rates of (x, v, z) in the state ``y``; those of v times the masses."""
    speeds, inner = np.uint32(bodies + 1), np.uint32(2 * bodies + 2)
    for row in range(bodies):
        u[row] = y[speeds + np.uint32(row)]
        u[speeds + np.uint32(row)] = 0.0
    u[bodies], u[speeds + np.uint32(bodies)] = 0.0, 0.0
    for n in range(len(elements)):
        el, term = elements[n], terms[n]
        i, j = np.uint32(el.i), np.uint32(el.j)
        u[speeds + i] -= el.a * term.f
        if j < bodies:
            u[speeds + j] -= el.b * term.f
        u[inner + np.uint32(n)] = term.g


@inlined
def add(u: Floats, other: Floats, masses: Floats, bodies: int) -> None:
    """Add stages, weighted, to a right-hand side, whose speeds are times the masses."""
    speeds, inner = np.uint32(bodies + 1), np.uint32(2 * bodies + 2)
    for i in range(bodies):
        u[i] += other[i]
        u[speeds + i] += masses[i] * other[speeds + i]
    for i in range(inner, len(u)):
        u[i] += other[i]


@inlined
def step(
    masses: Floats, elements: Rows, commands: Floats, y: Floats, terms: Rows, again: Rows,
    u1: Floats, u2: Floats, u3: Floats, u4: Floats, between: Floats, matrix: Floats,
    bodies: int, h: float,
) -> None:  # fmt: skip
    """Take one step of ``h`` s; ``terms`` are those of ``y``, all behind them is scratch."""
    size = len(y)
    s = 1.0 / (GAMMA * h)
    factorise(masses, elements, terms, bodies, s, matrix)

    rates(elements, terms, y, bodies, u1)
    solve(elements, terms, bodies, s, matrix, u1)

    for k in range(size):
        between[k] = y[k] + A21 * u1[k]
    evaluate(elements, commands, between, bodies, again)
    rates(elements, again, between, bodies, u2)
    for k in range(size):
        between[k] = C21 / h * u1[k]
    add(u2, between, masses, bodies)
    solve(elements, terms, bodies, s, matrix, u2)

    for k in range(size):
        between[k] = y[k] + A31 * u1[k] + A32 * u2[k]
    evaluate(elements, commands, between, bodies, again)
    rates(elements, again, between, bodies, u3)
    for k in range(size):
        u4[k] = u3[k]
        between[k] = C31 / h * u1[k] + C32 / h * u2[k]
    add(u3, between, masses, bodies)
    solve(elements, terms, bodies, s, matrix, u3)

    for k in range(size):
        between[k] = C41 / h * u1[k] + C42 / h * u2[k] + C43 / h * u3[k]
    add(u4, between, masses, bodies)
    solve(elements, terms, bodies, s, matrix, u4)

    for k in range(size):
        y[k] += M1 * u1[k] + M2 * u2[k] + M3 * u3[k] + M4 * u4[k]
    inner = 2 * bodies + 2
    for n in range(len(elements)):
        el = elements[n]
        if el.kind == BRISTLES:  # |z| never exceeds g(0) / sigma_0
            y[inner + np.uint32(n)] = limited(y[inner + np.uint32(n)], el.f_s / el.s_0)


@inlined
def count(
    elements: Rows, terms: Rows, y: Floats, bodies: int, tally: Rows, half: float
) -> None:  # fmt: skip
    """Add the energy since the last instant by the trapezoidal rule; ``half`` a step in s."""
    now = tally[0]
    given, lost = 0.0, 0.0
    for n in range(len(elements)):
        el = elements[n]
        if el.kind >= CURRENT:
            i = int(el.i)
            given -= terms[n].f * el.a * y[bodies + 1 + i]
        else:
            lost += terms[n].power
    now.supplied += half * (now.given + given)
    now.dissipated += half * (now.lost + lost)
    now.given, now.lost = given, lost


@inlined
def measured(
    sensor: Row, elements: Rows, terms: Rows, filters: Rows, sensors: int, y: Floats, bodies: int
) -> float:
    """Return the quantity of a sensor as it is."""
    index, measure = int(sensor.index), sensor.measure
    if measure == AT_POSITION:
        value = sensor.lever * y[index] + sensor.offset
    elif measure == AT_SPEED:
        value = sensor.lever * y[bodies + 1 + index]
    elif measure == AT_FORCE:
        value = terms[index].f
    elif measure == AT_LOAD:
        el = elements[index]
        value = el.load if el.press < 0.0 else max(0.0, -terms[int(el.press)].f)
    elif measure == AT_TEMPERATURE:
        value = filters[sensors + index].out
    else:
        value = y[2 * bodies + 2 + index]
    result: float = sensor.factor * value
    return result


@inlined
def prepare(filters: Rows, number: int, rate: float, h: float) -> None:
    """Set what a filter of ``rate`` 1/s keeps over ``h`` s, exact for an input on a line."""
    if rate > 0.0 and h > 0.0:
        keep = math.exp(-rate * h)
        filters[number].keep, filters[number].slope = keep, (1.0 - keep) / (rate * h)
    else:
        filters[number].keep, filters[number].slope = 0.0, 0.0


@inlined
def follow(row: Row, value: float) -> None:
    """Bring a filter to the next instant, when its input is ``value``."""
    row.out = value + (row.out - row.last) * row.keep - (value - row.last) * row.slope
    row.last = value


@inlined
def look(
    elements: Rows, sensors: Rows, warm: Rows, heat: Floats, ambient: float, y: Floats,
    terms: Rows, filters: Rows, bodies: int, first: bool, begun: bool,
) -> None:  # fmt: skip
    """Bring all filters to the present instant; ``first`` sees new commands at an old one."""
    for k in range(len(warm)):
        power = 0.0
        for n in range(len(elements)):
            if heat[k, n] != 0.0:
                power += heat[k, n] * terms[n].power
        row, value = filters[len(sensors) + k], ambient + warm[k].rise * power
        if not begun:
            row.out = ambient
        if first:
            row.last = value
        else:
            follow(row, value)
    for k in range(len(sensors)):
        row = filters[k]
        value = measured(sensors[k], elements, terms, filters, len(sensors), y, bodies)
        if sensors[k].rate == 0.0 or not begun:
            row.out = value
        if first:
            row.last = value
        elif sensors[k].rate > 0.0:
            follow(row, value)


@inlined
def integrate(
    masses: Floats, elements: Rows, sensors: Rows, warm: Rows, heat: Floats, ambient: float,
    commands: Floats, y: Floats, terms: Rows, again: Rows, work: Floats, filters: Rows,
    tally: Rows, h: float, steps: int,
) -> None:  # fmt: skip
    """Advance the state ``y`` by ``steps`` of ``h`` s with ``commands`` held, and the filters."""
    bodies, now, size = len(masses) - 1, tally[0], len(y)
    u1, u2, u3, u4 = work[0, :size], work[1, :size], work[2, :size], work[3, :size]
    between = work[4, :size]
    matrix = work[5, : bodies * bodies].reshape(bodies, bodies)
    for n in range(len(elements)):
        if elements[n].kind >= SPEED and commands[int(elements[n].command), 1] < 0.5:
            y[2 * bodies + 2 + n] = 0.0  # a drive that is off has forgotten its integral
    for k in range(len(sensors)):
        prepare(filters, k, sensors[k].rate, h)
    for k in range(len(warm)):
        prepare(filters, len(sensors) + k, warm[k].rate, h)
    for n in range(steps + 1):
        evaluate(elements, commands, y, bodies, terms)
        look(
            elements, sensors, warm, heat, ambient, y, terms, filters, bodies, n == 0,
            now.begun > 0.5,
        )  # fmt: skip
        now.begun = 1.0
        if now.counting > 0.5:
            count(elements, terms, y, bodies, tally, 0.0 if n == 0 else 0.5 * h)
        if n < steps:
            step(
                masses, elements, commands, y, terms, again, u1, u2, u3, u4, between, matrix,
                bodies, h,
            )  # fmt: skip


@inlined
def show(sensors: Rows, filters: Rows, readings: Floats, seed: int, t_ns: int) -> None:
    """Fill ``readings`` with what the sensors show at ``t_ns``, then the true temperatures."""
    for k in range(len(sensors)):
        sensor = sensors[k]
        value = filters[k].out + sensor.zero
        if sensor.noise > 0.0:
            value += sensor.noise * normal_pair(seed, t_ns * 64 + k)[0]
        if sensor.resolution > 0.0:
            value = math.floor(value / sensor.resolution + 0.5) * sensor.resolution
        readings[k] = min(max(value, sensor.low), sensor.high)
    for k in range(len(sensors), len(filters)):
        readings[k] = filters[k].out


@kernel
def advance(
    masses: Floats, elements: Rows, sensors: Rows, warm: Rows, heat: Floats, ambient: float,
    commands: Floats, y: Floats, terms: Rows, again: Rows, work: Floats, filters: Rows,
    tally: Rows, readings: Floats, seed: int, t_ns: int, elapsed_ns: int, step_ns: float,
) -> None:  # fmt: skip
    """Advance by ``elapsed_ns`` to ``t_ns`` and fill ``readings``: one cycle."""
    # Whole steps in nanoseconds, so that 1 ms is the same steps in however long a call.
    steps = math.ceil(elapsed_ns / step_ns)
    h = elapsed_ns / steps * 1e-9 if steps > 0 else 0.0
    integrate(
        masses, elements, sensors, warm, heat, ambient, commands, y, terms, again, work, filters,
        tally, h, steps,
    )  # fmt: skip
    show(sensors, filters, readings, seed, t_ns)


@kernel
def stored(masses: Floats, terms: Rows, y: Floats) -> float:
    """Return the energy in J in motion, springs, bristles, buffers and height."""
    bodies = len(masses) - 1
    energy = 0.0
    for i in range(bodies):
        energy += 0.5 * masses[i] * y[bodies + 1 + i] ** 2
    for n in range(len(terms)):
        energy += terms[n].stored
    return energy
