"""Computes all controllers of a rig, compiled once: what they are is data.

The PID is in velocity form: each step adds to the output that was really set, after all limits, so
that nothing winds up and control passes from and to other hands without a bump (K. J. Astrom and
T. Hagglund, Advanced PID Control, 2006, sections 3.5, 3.6 and 13.4). With the error e = r - y, the
weight b of the setpoint, the filter Tf of the derivative and the time h since the last reading:

- P = kp (b r - y)
- I = (output set) - (P + D + F of the last step) + ki h e; without ki it stays as it began
- D = (Tf D_last - kd (y - y_last)) / (Tf + h), by backward differences
- output = P + I + D + F within its limits, F the feed-forward.

A step is taken when a reading comes. Between readings the output stays.

In place of the PID a relay, by which gains are found (the same book, section 8.3): the output is
B + d while the measured value is below the setpoint, B - d while it is above, and passes over when
the error exceeds the hysteresis. B begins at the output that was set, and is after each whole swing
the mean output of that swing, so that the swing becomes symmetric.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rigd.model.machine.kernel import inlined, kernel

Floats = NDArray[np.float64]
Times = NDArray[np.int64]

# Columns of the parameters.
KP, KI, KD, FILTER, WEIGHT, LOW, HIGH = 0, 1, 2, 3, 4, 5, 6
TARGET_LOW, TARGET_HIGH, TARGET_STEP = 7, 8, 9
STALE, FROZEN, STUCK = 10, 11, 12  # in ns
INNER: Final = 13  # the controller that it commands; -1: a device
RELAY, HYSTERESIS = 14, 15  # 0: a PID
MOVED: Final = 16  # a value without change is frozen once the output has moved by more
PARAMETERS: Final = 17
# Columns of what goes in: values; when the newest reading in the measured one came, and for three
# values from the measured one on the time of the oldest reading in each.
WANTED, APPLIED, MEASURED, FORWARD, SCHEDULE, ACTIVE = 0, 1, 2, 3, 4, 5
INPUTS: Final = 6
ARRIVAL, MEASURED_AGE = 0, 1
STAMPS: Final = 4
# Columns of the memory.
_TARGET, _R, _Y, _P, _I, _D, _F, _U, _ENGAGED = 0, 1, 2, 3, 4, 5, 6, 7, 8
_FROZEN_U, _BEST, _NEAREST, _SIDE = 9, 10, 11, 12
# Of the relay: its sides times their durations, the durations, and whether since a swing began.
_SUM, _SPAN, _WHOLE = 13, 14, 15
MEMORY: Final = 16
# Columns of the memory of times.
_TAKEN, _CHANGED, _PROGRESS = 0, 1, 2
TIMES: Final = 3
# Columns of the results: the time in ns as an integer, the channels and the setpoint within its
# limits, which together are the row as a ring has it (:func:`rigd.model.rows.row_dtype`);
R_TIME, R_MEASURED, R_ERROR, R_P, R_I, R_D, R_F, R_OUTPUT, R_SATURATED, R_ACTIVE = range(10)
R_TARGET: Final = 10
CHANNELS: Final = R_TARGET - R_MEASURED
# then why it gives up, and for which input.
R_FAULT, R_SOURCE = 11, 12
RESULTS: Final = 13
# Columns of the places in the tables of the cycle: of the values and times that go in, in the order
# above (below 0: it has none, and what stands there stays); of its setpoint as it is applied and of
# what it commands as it is wanted; of its row, and the time of this.
P_STAMPS: Final = ACTIVE
P_TARGET: Final = P_STAMPS + STAMPS
P_OUTPUT, P_ROW, P_TIME = P_TARGET + 1, P_TARGET + 2, P_TARGET + 3
PLACES: Final = P_TIME + 1
#: Where the columns of each kind begin in the two tables, that of floats and that of integers.
FLOATS: Final = (0, PARAMETERS, PARAMETERS + INPUTS, PARAMETERS + INPUTS + MEMORY)
INTEGERS: Final = (0, STAMPS, STAMPS + TIMES)

# Why a controller gives up, as numbers.
FINE, NAN, OLD, STILL, NO_PROGRESS, OVERFLOW, NO_SWING = 0, 1, 2, 3, 4, 5, 6

#: Part of the error by which it must shrink at a limit, or the measured value come nearer to the
#: setpoint, to count as progress: a setpoint may go away faster than the rig can follow.
_PROGRESS_PART: Final = 0.01


@kernel
def control(t_ns: int, words: Times, floats: Floats, integers: Times) -> int:
    """Take a step of each of the n controllers for the cycle at ``t_ns``.

    A controller stands before the one that it commands. ``floats`` has a row for each, with the
    columns above: parameters, what goes in, memory, results; ``integers`` times that go in, memory
    of times, and places in ``words``, the tables of the cycle
    (:class:`rigd.model.tables.Tables`). These get the row of each, its setpoint, and what it sets:
    its output if it acts, else its setpoint. The output of one that gives up stays. Returns the
    first that gives up, or -1.
    """
    parameters, inputs = floats[:, : FLOATS[1]], floats[:, FLOATS[1] : FLOATS[2]]
    memory, results = floats[:, FLOATS[2] : FLOATS[3]], floats[:, FLOATS[3] :]
    stamps, taken = integers[:, : INTEGERS[1]], integers[:, INTEGERS[1] : INTEGERS[2]]
    places = integers[:, INTEGERS[2] :]
    clock = floats.view(np.int64)[:, FLOATS[3] :]
    tables = words.view(np.float64)
    for c in range(parameters.shape[0]):
        for column in range(ACTIVE):
            if places[c, column] >= 0:
                inputs[c, column] = tables[places[c, column]]
        for column in range(STAMPS):
            if places[c, P_STAMPS + column] >= 0:
                stamps[c, column] = words[places[c, P_STAMPS + column]]
    fault = -1
    for c in range(parameters.shape[0]):
        inner = int(parameters[c, INNER])
        if inner >= 0:  # what is set there is the setpoint of the inner controller
            inputs[c, APPLIED] = memory[inner, _TARGET]
        sets, at = R_TARGET, places[c, WANTED]
        if inputs[c, ACTIVE] == 0.0:
            _track(c, parameters, inputs, memory, results)
        else:
            sets, at = R_OUTPUT, places[c, P_OUTPUT]
            results[c, R_FAULT], results[c, R_SOURCE] = FINE, 0.0
            _engage(c, t_ns, parameters, inputs, stamps, memory, taken)
            _check(c, t_ns, parameters, inputs, stamps, results)
            _limit(c, parameters, inputs, memory)
            if results[c, R_FAULT] == FINE:
                _step(c, parameters, inputs, stamps, memory, taken, results)
                _watch(c, t_ns, parameters, inputs, memory, taken, results)
            _report(c, inputs, memory, results)
            if results[c, R_FAULT] != FINE:
                fault = c if fault < 0 else fault
            elif inner >= 0:
                inputs[inner, WANTED] = memory[c, _U]
        clock[c, R_TIME] = t_ns
        tables[at], tables[places[c, P_TARGET]] = results[c, sets], results[c, R_TARGET]
        if places[c, P_ROW] >= 0:
            words[places[c, P_TIME]] = t_ns
            for channel in range(CHANNELS):
                tables[places[c, P_ROW] + channel] = results[c, R_MEASURED + channel]
    return fault


@inlined
def _track(c: int, parameters: Floats, inputs: Floats, memory: Floats, results: Floats) -> None:
    """Let the setpoint of a controller that is off follow the measured value, within its limits."""
    y = inputs[c, MEASURED]
    low, high = parameters[c, TARGET_LOW], parameters[c, TARGET_HIGH]
    if math.isfinite(y):
        memory[c, _TARGET] = min(max(y, low), high)
    memory[c, _ENGAGED] = 0.0
    for column in range(RESULTS):
        results[c, column] = 0.0
    results[c, R_MEASURED] = y
    results[c, R_OUTPUT] = inputs[c, APPLIED]
    results[c, R_TARGET] = memory[c, _TARGET]


@inlined
def _engage(
    c: int, t_ns: int, parameters: Floats, inputs: Floats, stamps: Times, memory: Floats,
    taken: Times,
) -> None:  # fmt: skip
    """Begin at the output that is set, and at the measured value as setpoint."""
    if memory[c, _ENGAGED] != 0.0 or not math.isfinite(inputs[c, MEASURED]):
        return
    y, u = inputs[c, MEASURED], inputs[c, APPLIED]
    low, high = parameters[c, TARGET_LOW], parameters[c, TARGET_HIGH]
    memory[c, _TARGET] = min(max(y, low), high)
    memory[c, _Y], memory[c, _R] = y, memory[c, _TARGET]
    memory[c, _D], memory[c, _U], memory[c, _ENGAGED] = 0.0, u, 1.0
    memory[c, _P], memory[c, _I], memory[c, _F] = 0.0, math.nan, 0.0
    memory[c, _FROZEN_U], memory[c, _BEST], memory[c, _SIDE] = u, math.inf, 0.0
    memory[c, _SUM], memory[c, _SPAN], memory[c, _WHOLE] = 0.0, 0.0, 0.0
    taken[c, _TAKEN] = stamps[c, ARRIVAL] - 1  # the reading that is there counts
    taken[c, _CHANGED], taken[c, _PROGRESS] = t_ns, t_ns


@inlined
def _check(
    c: int, t_ns: int, parameters: Floats, inputs: Floats, stamps: Times, results: Floats
) -> None:
    """Note an input that is not a number or too old."""
    for source in range(3):
        value = inputs[c, MEASURED + source]
        if not math.isfinite(value) or (MEASURED + source == SCHEDULE and value < 0.0):
            results[c, R_FAULT], results[c, R_SOURCE] = NAN, source
            return
        if t_ns - stamps[c, MEASURED_AGE + source] > parameters[c, STALE]:
            results[c, R_FAULT], results[c, R_SOURCE] = OLD, source
            return


@inlined
def _limit(c: int, parameters: Floats, inputs: Floats, memory: Floats) -> None:
    """Bring the setpoint nearer to what is wanted, within its limits in value and rate."""
    wanted, last = inputs[c, WANTED], memory[c, _TARGET]
    if not math.isfinite(wanted):
        return
    value = min(max(wanted, parameters[c, TARGET_LOW]), parameters[c, TARGET_HIGH])
    step = parameters[c, TARGET_STEP]
    if value - last > step:
        value = last + step
    elif last - value > step:
        value = last - step
    memory[c, _TARGET] = value


@inlined
def _step(
    c: int, parameters: Floats, inputs: Floats, stamps: Times, memory: Floats, taken: Times,
    results: Floats,
) -> None:  # fmt: skip
    """Take a step of the PID if there is a new reading; see the head of this module."""
    if stamps[c, ARRIVAL] <= taken[c, _TAKEN]:
        return
    if parameters[c, RELAY] != 0.0:
        _switch(c, parameters, inputs, stamps, memory, taken)
        return
    begins = math.isnan(memory[c, _I])
    h = 0.0 if begins else 1e-9 * (stamps[c, ARRIVAL] - taken[c, _TAKEN])
    y, r = inputs[c, MEASURED], memory[c, _TARGET]
    gain = inputs[c, SCHEDULE]
    kp, ki, kd = gain * parameters[c, KP], gain * parameters[c, KI], gain * parameters[c, KD]
    weight, lag = parameters[c, WEIGHT], parameters[c, FILTER]
    forward = inputs[c, FORWARD]
    before = kp * (weight * memory[c, _R] - memory[c, _Y])  # with the gains of now
    if begins:
        memory[c, _F] = forward
    integral = memory[c, _I]
    if begins or ki != 0.0:
        integral = inputs[c, APPLIED] - before - memory[c, _D] - memory[c, _F]
    else:
        integral += memory[c, _P] - before
    integral += ki * h * (r - y)
    derivative = memory[c, _D]
    if lag + h > 0.0:
        derivative = (lag * derivative - kd * (y - memory[c, _Y])) / (lag + h)
    proportional = kp * (weight * r - y)
    raw = proportional + integral + derivative + forward
    if not math.isfinite(raw):
        results[c, R_FAULT] = OVERFLOW
        return
    low, high = parameters[c, LOW], parameters[c, HIGH]
    output = min(max(raw, low), high)
    if ki != 0.0:
        integral = output - proportional - derivative - forward
    if y != memory[c, _Y]:
        taken[c, _CHANGED] = stamps[c, ARRIVAL]
        memory[c, _FROZEN_U] = output
    memory[c, _P], memory[c, _I], memory[c, _D] = proportional, integral, derivative
    memory[c, _F], memory[c, _U] = forward, output
    memory[c, _R], memory[c, _Y] = r, y
    side = 1.0 if raw >= high else (-1.0 if raw <= low else 0.0)
    if side != memory[c, _SIDE]:
        memory[c, _BEST] = math.inf
    memory[c, _SIDE] = side
    taken[c, _TAKEN] = stamps[c, ARRIVAL]


@inlined
def _switch(
    c: int, parameters: Floats, inputs: Floats, stamps: Times, memory: Floats, taken: Times
) -> None:
    """Take a step of the relay; see the head of this module."""
    y, r = inputs[c, MEASURED], memory[c, _TARGET]
    relay, least = parameters[c, RELAY], parameters[c, HYSTERESIS]
    size, last = abs(relay), memory[c, _P] / relay
    lowest, highest = parameters[c, LOW] + size, parameters[c, HIGH] - size
    if last == 0.0:
        memory[c, _I] = min(max(inputs[c, APPLIED], lowest), highest)
        side = 1.0 if r >= y else -1.0
    else:
        h = 1e-9 * (stamps[c, ARRIVAL] - taken[c, _TAKEN])
        memory[c, _SUM] += h * last
        memory[c, _SPAN] += h
        side = 1.0 if r - y > least else (-1.0 if y - r > least else last)
    if side != last or r != memory[c, _R]:
        taken[c, _PROGRESS] = stamps[c, ARRIVAL]
    if side > last and last != 0.0:  # a swing ends here and the next begins
        if memory[c, _WHOLE] != 0.0:
            mean = memory[c, _I] + relay * memory[c, _SUM] / memory[c, _SPAN]
            memory[c, _I] = min(max(mean, lowest), highest)
        memory[c, _SUM], memory[c, _SPAN], memory[c, _WHOLE] = 0.0, 0.0, 1.0
    memory[c, _P] = side * relay
    memory[c, _U] = memory[c, _I] + memory[c, _P]
    if y != memory[c, _Y]:
        taken[c, _CHANGED] = stamps[c, ARRIVAL]
        memory[c, _FROZEN_U] = memory[c, _U]
    memory[c, _R], memory[c, _Y] = r, y
    taken[c, _TAKEN] = stamps[c, ARRIVAL]


@inlined
def _watch(
    c: int, t_ns: int, parameters: Floats, inputs: Floats, memory: Floats, taken: Times,
    results: Floats,
) -> None:  # fmt: skip
    """Note a measured value that is frozen, and an output at a limit without progress."""
    if results[c, R_FAULT] != FINE:
        return
    moved = abs(memory[c, _U] - memory[c, _FROZEN_U])
    if t_ns - taken[c, _CHANGED] > parameters[c, FROZEN] and moved > parameters[c, MOVED]:
        results[c, R_FAULT] = STILL
        return
    if parameters[c, RELAY] != 0.0:
        if t_ns - taken[c, _PROGRESS] > parameters[c, STUCK]:
            results[c, R_FAULT] = NO_SWING
        return
    y = inputs[c, MEASURED]
    error = abs(memory[c, _TARGET] - y)
    nearer = math.copysign(1.0, memory[c, _TARGET] - y) * (y - memory[c, _NEAREST])
    if memory[c, _SIDE] == 0.0 or memory[c, _BEST] == math.inf:
        memory[c, _BEST] = error if memory[c, _SIDE] != 0.0 else math.inf
        memory[c, _NEAREST] = y
        taken[c, _PROGRESS] = t_ns
    elif max(memory[c, _BEST] - error, nearer) > _PROGRESS_PART * error:
        memory[c, _BEST] = min(error, memory[c, _BEST])
        memory[c, _NEAREST] = y
        taken[c, _PROGRESS] = t_ns
    elif t_ns - taken[c, _PROGRESS] > parameters[c, STUCK]:
        results[c, R_FAULT] = NO_PROGRESS


@inlined
def _report(c: int, inputs: Floats, memory: Floats, results: Floats) -> None:
    """Write the results of a controller that acts."""
    results[c, R_MEASURED] = inputs[c, MEASURED]
    results[c, R_ERROR] = memory[c, _TARGET] - inputs[c, MEASURED]
    results[c, R_P], results[c, R_I], results[c, R_D] = (
        memory[c, _P], memory[c, _I], memory[c, _D],
    )  # fmt: skip
    results[c, R_F], results[c, R_OUTPUT] = memory[c, _F], memory[c, _U]
    results[c, R_SATURATED], results[c, R_ACTIVE] = memory[c, _SIDE], 1.0
    results[c, R_TARGET] = memory[c, _TARGET]
