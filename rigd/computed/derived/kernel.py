"""Computes a graph of derived channels, compiled once for all graphs: a graph is data.

Every value has two times: ``oldest``, of the oldest channel of a device in it, which is the age of
the value; and ``newest``, at which a block with memory (a derivative, a filter) takes a step. A
channel that comes at 25 Hz is thus differentiated over its own 40 ms, in a cycle of any rate.

NaN means that a value is not known; a value that is not finite becomes NaN. NaN goes through every
operation. What a block with memory does about it stands in ``docs/derived.md`` and beside each
block here.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rigd.language.operations import Op
from rigd.model.machine.kernel import inlined, kernel

Floats = NDArray[np.float64]
Times = NDArray[np.int64]
Words = NDArray[np.uint32]

#: A time before all others: of what never changes.
NEVER: Final = -(2**62)
#: A time after all others: a constant makes nothing older.
ALWAYS: Final = 2**62

_INPUT = int(Op.INPUT)
_ADD, _SUBTRACT = int(Op.ADD), int(Op.SUBTRACT)
_MULTIPLY, _DIVIDE = int(Op.MULTIPLY), int(Op.DIVIDE)
_NEGATE, _ABS, _SQRT = int(Op.NEGATE), int(Op.ABS), int(Op.SQRT)
_SIN, _COS, _TAN, _ATAN2 = int(Op.SIN), int(Op.COS), int(Op.TAN), int(Op.ATAN2)
_MIN, _MAX = int(Op.MIN), int(Op.MAX)
_LESS, _NOT_ABOVE = int(Op.LESS), int(Op.NOT_ABOVE)
_AND, _OR, _NOT = int(Op.AND), int(Op.OR), int(Op.NOT)
_WHERE, _HOLD, _DEADBAND, _LOOKUP = int(Op.WHERE), int(Op.HOLD), int(Op.DEADBAND), int(Op.LOOKUP)
_DERIVATIVE, _LOWPASS, _INTEGRAL = int(Op.DERIVATIVE), int(Op.LOWPASS), int(Op.INTEGRAL)
_MEAN, _RMS, _HIGHEST, _LOWEST = int(Op.MEAN), int(Op.RMS), int(Op.HIGHEST), int(Op.LOWEST)
_RATE_LIMIT, _DELAY, _EDGES = int(Op.RATE_LIMIT), int(Op.DELAY), int(Op.EDGES)


@kernel
def compute(t_ns: int, begun_ns: int, words: Times, own: Times) -> None:
    """Compute all groups for the cycle at ``t_ns``, Unix time, in a run that began at ``begun_ns``.

    A compiled function takes 0.1 us for each array that it is given: so ``words`` has all tables of
    the cycle (:class:`rigd.model.tables.Tables`), ``own`` all of the graph, behind one another:
    first the places at which each of the others begins and the last ends, then the floats, inputs
    (n), parameters, state and values (m), then the integers, ages (4, n), rows (r, 8), times
    (3, m), layout and the places of ``taken``, at last the packed rows. The rows of ages are the
    times of the inputs since the beginning of the run, how old each may be, and where in the tables
    its value and its time stand, which is 0 for an input that the rig lacks. Times of rows are:
    oldest, newest, and of the last step. See :func:`evaluate` and :func:`gather`.
    """
    tables, floats = words.view(np.float64), own.view(np.float64)
    inputs, values = floats[own[0] : own[1]], floats[own[3] : own[4]]
    ages = own[own[4] : own[5]].reshape((4, inputs.shape[0]))
    rows = own[own[5] : own[6]].reshape(((own[6] - own[5]) // 8, 8))
    times = own[own[6] : own[7]].reshape((3, values.shape[0]))
    for i in range(inputs.shape[0]):
        inputs[i], stamp = tables[ages[2, i]], words[ages[3, i]]
        ages[0, i] = stamp - begun_ns if stamp != 0 else 0
    evaluate(
        inputs, ages[0], rows, floats[own[1] : own[2]], floats[own[2] : own[3]],
        values, times[0], times[1], times[2],
    )  # fmt: skip
    gather(
        t_ns, begun_ns, own[own[7] : own[8]], values, times, ages, words, tables,
        own[own[8] : own[9]], own[own[9] : own[10]].view(np.uint32),
    )  # fmt: skip


@kernel
def replay(
    t_ns: Times, begun_ns: int, inputs: Floats, stamps: Times, words: Times, own: Times,
    packed: Words,
) -> None:  # fmt: skip
    """Compute the rows of n cycles, one after the other, as :func:`compute` does in the cycle.

    ``t_ns`` (n,) are their times, ``inputs`` and ``stamps`` (n, k) the values and times of the
    inputs in each; ``packed`` (n, w) gets the rows of all groups, behind one another.
    """
    tables, count = words.view(np.float64), inputs.shape[1]
    ages = own[own[4] : own[5]].reshape((4, count))
    row = own[own[9] : own[10]].view(np.uint32)
    for cycle in range(t_ns.shape[0]):
        for i in range(count):
            tables[ages[2, i]] = inputs[cycle, i]
            words[ages[3, i]] = stamps[cycle, i]
        compute(t_ns[cycle], begun_ns, words, own)
        for place in range(packed.shape[1]):
            packed[cycle, place] = row[place]


@inlined
def evaluate(
    inputs: Floats,
    stamps: Times,
    rows: Times,
    parameters: Floats,
    state: Floats,
    values: Floats,
    oldest: Times,
    newest: Times,
    stepped: Times,
) -> None:
    """Compute ``values``, ``oldest`` and ``newest`` of every row.

    ``inputs`` are the values of the n channels used, ``stamps`` their times in ns, all since the
    start of the run, so that seconds keep their digits. ``rows`` has
    shape (m, 8): place, operation, a, b, c, p, s, size; p and s are where the block begins in
    ``parameters`` and ``state``. It is without the rows of constants, whose values and times stand
    in their places already. ``stepped`` has the time at which each block took its last step.
    """
    for at in range(rows.shape[0]):
        row, op, a, b, c = rows[at, 0], rows[at, 1], rows[at, 2], rows[at, 3], rows[at, 4]
        p, s, size = rows[at, 5], rows[at, 6], rows[at, 7]
        if op == _INPUT:
            values[row], oldest[row], newest[row] = inputs[a], stamps[a], stamps[a]
            if not math.isfinite(values[row]):
                values[row] = math.nan
            continue
        x, y = values[a], values[b]
        oldest[row], newest[row] = oldest[a], newest[a]
        if op <= _DIVIDE or _ATAN2 <= op <= _OR or op in (_WHERE, _HOLD):
            oldest[row] = min(oldest[a], oldest[b])
            newest[row] = max(newest[a], newest[b])
        if op == _WHERE:
            oldest[row] = min(oldest[row], oldest[c])
            newest[row] = max(newest[row], newest[c])
        if op == _MULTIPLY:  # the usual ones at once
            values[row] = x * y
        elif op == _ADD:
            values[row] = x + y
        elif op == _SUBTRACT:
            values[row] = x - y
        elif op < _DERIVATIVE:
            values[row] = _plain(op, x, y, values[c], parameters, p, size, state, s)
        elif newest[row] > stepped[row]:
            passed_s = 1e-9 * (newest[row] - stepped[row])
            stepped[row] = newest[row]
            values[row] = _block(op, x, newest[row], passed_s, parameters, p, state, s, size)
        if math.isinf(values[row]):
            values[row] = math.nan


@inlined
def gather(
    t_ns: int,
    begun_ns: int,
    layout: Times,
    values: Floats,
    times: Times,
    ages: Times,
    words: Times,
    tables: Floats,
    taken: Times,
    packed: Words,
) -> None:
    """Write the row of every group, with its status and its times, to the tables of the cycle.

    ``layout`` has for each group where its row and its time stand there (below 0: nowhere), the
    number of its channels, their rows, the number of its inputs and these, the number of its
    parameters and their rows. ``taken`` (2) has where the Unix times of the oldest reading in each
    channel stand, and of the newest, from ``times`` of its row. The status is 2^31 if an input is
    older than it may be (``ages``), or no trial gives a parameter its value; else 0. ``packed``
    gets the rows as a ring has them (:func:`rigd.model.rows.row_dtype`): time, values, and the
    status as uint32.
    """
    at = word = channel = 0
    bits = values.view(np.uint32)
    while at < layout.shape[0]:
        packed[word], packed[word + 1] = t_ns & 0xFFFFFFFF, t_ns >> 32
        word += 2
        place, count = layout[at], layout[at + 2]
        if layout[at + 1] >= 0:
            words[layout[at + 1]] = t_ns
        at += 3
        for row in layout[at : at + count]:
            if place >= 0:
                tables[place] = values[row]
                place += 1
            packed[word], packed[word + 1] = bits[2 * row], bits[2 * row + 1]
            word += 2
            words[taken[0] + channel] = min(begun_ns + times[0, row], t_ns)
            words[taken[1] + channel] = min(begun_ns + times[1, row], t_ns)
            channel += 1
        at += count
        count = layout[at]
        late = False
        for read in layout[at + 1 : at + 1 + count]:
            late = late or t_ns - begun_ns - ages[0, read] > ages[1, read]
        at += 1 + count
        count = layout[at]
        for row in layout[at + 1 : at + 1 + count]:
            late = late or math.isnan(values[row])
        at += 1 + count
        if place >= 0:
            tables[place] = 2147483648.0 if late else 0.0
        packed[word] = 2147483648 if late else 0
        word += 1


@inlined
def _plain(
    op: int, x: float, y: float, z: float, parameters: Floats, p: int, size: int,
    state: Floats, s: int,
) -> float:  # fmt: skip
    """Return the value of another operation that computes in every cycle."""
    if op == _DIVIDE:
        return x / y if y != 0.0 else math.nan
    if op == _NEGATE:
        return -x
    if op == _ABS:
        return abs(x)
    if op == _SQRT:
        return math.sqrt(x) if x >= 0.0 else math.nan
    if op == _SIN:
        return math.sin(x)
    if op == _COS:
        return math.cos(x)
    if op == _TAN:
        return math.tan(x)
    if op == _NOT:
        return 1.0 - x
    if op == _DEADBAND:
        if math.isnan(x):
            return x
        band = parameters[p]
        return x - band if x > band else (x + band if x < -band else 0.0)
    if op == _LOOKUP:
        return _interpolated(x, parameters, p, size)
    if op == _HOLD:  # an unknown condition forgets the value: what is held would look known
        if math.isnan(y):
            state[s] = math.nan
        elif y != 0.0:
            state[s] = x
        value: float = state[s]
        return value
    if op == _WHERE:
        if math.isnan(x):
            return math.nan
        return y if x != 0.0 else z
    if math.isnan(x) or math.isnan(y):
        return math.nan
    if op == _ATAN2:
        return math.atan2(x, y)
    if op == _MIN:
        return x if x < y else y
    if op == _MAX:
        return x if x > y else y
    if op == _LESS:
        return 1.0 if x < y else 0.0
    if op == _NOT_ABOVE:
        return 1.0 if x <= y else 0.0
    if op == _AND:
        return x * y
    return x if x > y else y  # OR


@inlined
def _interpolated(x: float, parameters: Floats, p: int, size: int) -> float:
    """Return the value at ``x`` of a table of ``size`` points; NaN outside of it."""
    if not parameters[p] <= x <= parameters[p + size - 1]:
        return math.nan
    low, high = 0, size - 1
    while high - low > 1:
        middle = (low + high) // 2
        if parameters[p + middle] <= x:
            low = middle
        else:
            high = middle
    x0, x1 = parameters[p + low], parameters[p + high]
    y0, y1 = parameters[p + size + low], parameters[p + size + high]
    value: float = y0 + (y1 - y0) * (x - x0) / (x1 - x0)
    return value


@inlined
def _block(
    op: int, x: float, t_ns: int, passed_s: float, parameters: Floats, p: int,
    state: Floats, s: int, size: int,
) -> float:  # fmt: skip
    """Take a step of a block with memory for the new value ``x``; return what it gives.

    The memory of a block that was emptied is NaN.
    """
    if op == _DERIVATIVE:  # begins at 0; after NaN the change since the last value is not known
        last, begun = state[s], state[s + 1] == 1.0
        state[s] = x
        if begun or math.isnan(x):
            rate: float = (x - last) / passed_s
            return rate
        state[s + 1] = 1.0
        return 0.0
    if op == _LOWPASS:
        return _lowpass(x, passed_s, parameters[p], state, s)
    if op in (_INTEGRAL, _EDGES):
        return _total(op, x, passed_s, state, s)
    if op == _RATE_LIMIT:
        last, most = state[s], parameters[p] * passed_s
        if math.isnan(last) or math.isnan(x) or abs(x - last) <= most:
            state[s] = x
        else:
            state[s] = last + most if x > last else last - most
        value: float = state[s]
        return value
    return _windowed(op, x, t_ns, parameters[p], state, s, size)


@inlined
def _total(op: int, x: float, passed_s: float, state: Floats, s: int) -> float:
    """Take a step of an integral (by trapezoids), or of a count of changes from false to true.

    From index ``s`` on ``state`` has the total, the last value, and 1 if a NaN came once begun.
    What passes during a NaN is not known, and with it the total: it is NaN until it is reset.
    """
    total, last, lost = state[s], state[s + 1], state[s + 2] == 1.0
    if lost or math.isnan(x):
        state[s + 2] = 1.0 if lost or not math.isnan(total) else 0.0
        return math.nan
    state[s + 1] = x
    if math.isnan(total):
        state[s] = 0.0
    elif op == _INTEGRAL:
        state[s] = total + 0.5 * (last + x) * passed_s
    elif x > last:
        state[s] = total + 1.0
    value: float = state[s]
    return value


@inlined
def _lowpass(x: float, passed_s: float, omega: float, state: Floats, s: int) -> float:
    """Take a step of a Butterworth filter of second order, exact for a value held since then.

    y'' + sqrt(2) w y' + w^2 y = w^2 x, for any time between steps. It delays slow signals by
    sqrt(2) / w. It begins, also after NaN, settled at the value.
    """
    if math.isnan(x) or math.isnan(state[s]):
        state[s], state[s + 1] = x, 0.0
        return x
    if passed_s != state[s + 2]:
        decay = omega / math.sqrt(2.0)
        fade = math.exp(-decay * passed_s)
        sine, cosine = fade * math.sin(decay * passed_s), fade * math.cos(decay * passed_s)
        state[s + 2] = passed_s
        state[s + 3], state[s + 4], state[s + 5] = sine, cosine, decay
    sine, cosine, decay = state[s + 3], state[s + 4], state[s + 5]
    off, speed = state[s] - x, state[s + 1]
    state[s] = x + off * (cosine + sine) + speed * sine / decay
    state[s + 1] = speed * (cosine - sine) - 2.0 * decay * off * sine
    value: float = state[s]
    return value


@inlined
def _windowed(
    op: int, x: float, t_ns: int, window_s: float, state: Floats, s: int, size: int
) -> float:
    """Add ``x`` to the samples of the last ``window_s`` and return what ``op`` makes of them.

    A NaN makes the result NaN for as long as it is in the window. The samples are a ring of
    ``size`` values, then their ages; the first two numbers are where it begins and how many it has.
    """
    head = 5 if op in (_MEAN, _RMS) else 2
    if math.isnan(state[s]):
        state[s], state[s + 1] = 0.0, 0.0
        if head == 5:
            state[s + 2], state[s + 3], state[s + 4] = 0.0, 0.0, 0.0
    begin, count, ring = int(state[s]), int(state[s + 1]), s + head
    now_s = 1e-9 * t_ns
    while count > 0:
        age_s = now_s - state[ring + size + begin]
        if count < size and (age_s < window_s - 1e-9 if op != _DELAY else True):
            break
        if head == 5:
            _take(state, s, state[ring + begin], op, -1.0)
        begin = begin + 1 if begin + 1 < size else 0
        count -= 1
    place = begin + count
    place = place if place < size else place - size
    state[ring + place], state[ring + size + place] = x, now_s
    count += 1
    if head == 5:
        _take(state, s, x, op, 1.0)
    state[s], state[s + 1] = float(begin), float(count)
    if op == _DELAY:
        return _delayed(now_s - window_s, state, s, ring, size)
    if head == 5:
        if state[s + 4] > 0.0:
            return math.nan
        mean = (state[s + 2] + state[s + 3]) / count
        return math.sqrt(mean if mean > 0.0 else 0.0) if op == _RMS else mean
    result = state[ring + begin]
    for index in range(count):
        place = begin + index
        value = state[ring + (place if place < size else place - size)]
        if math.isnan(value):
            return math.nan
        if (value > result) if op == _HIGHEST else (value < result):
            result = value
    found: float = result
    return found


@inlined
def _take(state: Floats, s: int, x: float, op: int, sign: float) -> None:
    """Add ``sign * x`` (or its square) to the sum of a window, compensated after Neumaier."""
    term = sign * (x * x if op == _RMS else x)
    if not math.isfinite(term):
        state[s + 4] += sign
        return
    total = state[s + 2]
    added = total + term
    state[s + 3] += (total - added) + term if abs(total) >= abs(term) else (term - added) + total
    state[s + 2] = added


@inlined
def _delayed(then_s: float, state: Floats, s: int, ring: int, size: int) -> float:
    """Return the newest sample not later than ``then_s``, or the first; older ones are dropped."""
    begin, count = int(state[s]), int(state[s + 1])
    while count > 1:
        after = begin + 1 if begin + 1 < size else 0
        if state[ring + size + after] > then_s + 1e-9:
            break
        begin, count = after, count - 1
    state[s], state[s + 1] = float(begin), float(count)
    result: float = state[ring + begin]
    return result


def warm() -> None:
    """Load the compiled functions, or compile them: no cycle has time for that."""
    compute(0, 0, np.zeros(0, dtype=np.int64), np.zeros(11, dtype=np.int64))
