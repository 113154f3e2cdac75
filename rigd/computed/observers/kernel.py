"""Computes a Kalman filter for one cycle, compiled once for all filters.

A filter holds the state x (n) and its covariance P (n, n), for inputs u (l) and measured values z
(m). Equations after Simon, Optimal State Estimation (2006): prediction (5.19), update in the form
of Joseph (5.19, first form of P+), multiplied out from the left, which keeps P symmetric.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rigd.model.machine.kernel import kernel

Floats = NDArray[np.float64]
Times = NDArray[np.int64]
Words = NDArray[np.uint32]

#: A time before all others: of a channel that has given no value yet.
NEVER: Final = -(2**62)
#: The places of ``clock``: time of the state, time of the last reading used, whether it has begun,
#: and where in the tables of the cycle the row and its time stand, below 0: nowhere.
_AT, _READ, _BEGUN, ROW, ROW_TIME = 0, 1, 2, 3, 4
CLOCK: Final = 5
#: Rows of ``ages``: see :func:`take`.
LATE, USED, FROM_VALUE, FROM_STAMP = range(4)
AGES: Final = 4
#: Bit 31 of the status: a channel is late or not known.
_LATE: Final = 2147483648.0
#: Bit 30: the filter has diverged in this cycle.
_DIVERGED: Final = 1073741824.0


@kernel
def cut(floats: Floats, places: Times, number: int) -> Floats:
    """Return table ``number`` of those that lie in ``floats`` one after the other.

    ``places`` are where they begin (:meth:`rigd.computed.observers.memory.Memory.join`).
    """
    return floats[places[number] : places[number + 1]]


@kernel
def square(floats: Floats, places: Times, number: int, columns: int) -> Floats:
    """Return table ``number`` as a matrix of ``columns``."""
    table = cut(floats, places, number)
    return table.reshape((table.shape[0] // columns, columns))


@kernel
def cut_times(times: Times, count: int) -> tuple[Times, Times, Times, int, int]:
    """Return ages (4, count), current (count), clock (5), period and ``lost_ns`` of ``times``."""
    ages = times[: AGES * count].reshape((AGES, count))
    at = (AGES + 1) * count
    then = at + CLOCK
    return ages, times[AGES * count : at], times[at:then], times[then], times[then + 1]


@kernel
def take(
    t_ns: int,
    words: Times,
    period_ns: int,
    lost_ns: int,
    given: Floats,
    ages: Times,
    held: Floats,
    current: Times,
    clock: Times,
) -> int:
    """Take the readings of the cycle at ``t_ns``; return how many periods to predict.

    ``words`` are the tables of the cycle (:class:`rigd.model.tables.Tables`). ``given`` (l + m)
    gets the newest values of the inputs, then of the measured channels. The rows of ``ages``
    (4, l + m) are the ages above which they are late, the times of the last values that were used,
    and where in the tables values and times stand. ``held`` (l) keeps the last known inputs.
    ``current`` (l + m) gets 2 for a value to use now, 1 for one that is not late, else 0. All times
    are in ns.

    0 means that the filter begins, for the first time or because nothing was measured for
    ``lost_ns`` before; -1 that the state is not known: nothing is measured for ``lost_ns``, or an
    input is not known for so long.
    """
    known, arrived, inputs = True, False, held.shape[0]
    tables = words.view(np.float64)
    for i in range(given.shape[0]):
        given[i], stamp = tables[ages[FROM_VALUE, i]], words[ages[FROM_STAMP, i]]
        finite = math.isfinite(given[i])
        new = finite and (i < inputs or stamp > ages[USED, i])
        current[i] = 1 if finite and t_ns - stamp <= ages[LATE, i] else 0
        if new:
            ages[USED, i] = stamp
        if i < inputs:
            if finite:
                held[i] = given[i]
            known = known and t_ns - ages[USED, i] <= lost_ns
        elif new:
            current[i] = 2
            arrived = True
    if arrived:
        if t_ns - clock[_READ] > lost_ns:  # no cycle ran: too long for one to make up for
            clock[_BEGUN] = 0
        clock[_READ] = t_ns
    if not known or t_ns - clock[_READ] > lost_ns:
        clock[_BEGUN] = 0
        return -1
    steps = max(1, (t_ns - clock[_AT] + period_ns // 2) // period_ns)
    if clock[_BEGUN] == 0:
        if not arrived:
            return -1
        clock[_BEGUN], steps = 1, 0
    clock[_AT] = t_ns
    return int(steps)


@kernel
def predict(x: Floats, p: Floats, f: Floats, q: Floats, work: Floats) -> None:
    """Set ``p`` to F P F' + Q; ``work`` (n, n) is overwritten. ``x`` gives only its size."""
    n = x.shape[0]  # F has few entries that are not 0
    for i in range(n):
        for j in range(n):
            work[i, j] = 0.0
        for k in range(n):
            factor = f[i, k]
            if factor != 0.0:
                for j in range(n):
                    work[i, j] += factor * p[k, j]
    p[:] = q
    for j in range(n):
        for k in range(n):
            factor = f[j, k]
            if factor != 0.0:
                for i in range(j + 1):
                    p[i, j] += work[i, k] * factor
        for i in range(j):
            p[j, i] = p[i, j]


@kernel
def correct(
    x: Floats, p: Floats, h: Floats, r: Floats, off: Floats, current: Times, first: int,
    learned: Floats,
) -> float:  # fmt: skip
    """Update ``x`` and ``p`` with the measured values that are to be used; return their NIS.

    A state of which ``learned`` (n) is 0 stays as it is, and its uncertainty counts for the others
    (the Schmidt-Kalman filter, Simon, section 10.3); it is 1 for the others.

    ``h`` (m, n), ``r`` (m, m) are of all measured channels, ``off`` (m) is measured minus expected.
    Those with ``current[first + i] == 2`` are used. The normalised innovation squared y' S^-1 y has
    the mean of the number of values used, if the model fits. NaN without a value.
    """
    n, m = x.shape[0], 0
    rows = np.empty(h.shape[0], dtype=np.int64)
    for i in range(h.shape[0]):
        if current[first + i] == 2:
            rows[m] = i
            m += 1
    if m == 0:
        return math.nan
    # All in one memory; columns as rows, so that the inner loops run along it.
    work = np.zeros((3 * m + 1, max(n, m)))
    ph, gain, s, y = work[:m], work[m : 2 * m], work[2 * m : 3 * m], work[3 * m]
    for b in range(m):  # (P H')', of a P that is symmetric; H has few entries that are not 0
        for k in range(n):
            factor = h[rows[b], k]
            if factor != 0.0:
                for i in range(n):
                    ph[b, i] += p[k, i] * factor
    for a in range(m):  # S = H P H' + R, then its Cholesky factor L
        for b in range(m):
            total = r[rows[a], rows[b]]
            for k in range(n):
                total += h[rows[a], k] * ph[b, k]
            s[a, b] = total
    for b in range(m):
        for a in range(b, m):
            total = s[a, b]
            for k in range(b):
                total -= s[a, k] * s[b, k]
            s[a, b] = math.sqrt(total) if a == b else total / s[b, b]
    nis = 0.0
    for a in range(m):  # y = L^-1 times the innovations
        total = off[rows[a]]
        for k in range(a):
            total -= s[a, k] * y[k]
        y[a] = total / s[a, a]
        nis += y[a] * y[a]
    for b in range(m):  # K L = P H' L'^-1
        for k in range(b):
            for i in range(n):
                gain[b, i] -= gain[k, i] * s[b, k]
        for i in range(n):
            gain[b, i] = (ph[b, i] + gain[b, i]) / s[b, b] * learned[i]
            x[i] += gain[b, i] * y[b]
    for b in range(m - 1, -1, -1):  # K = (K L) L^-1
        for k in range(b + 1, m):
            for i in range(n):
                gain[b, i] -= gain[k, i] * s[k, b]
        for i in range(n):
            gain[b, i] /= s[b, b]
    for i in range(n):  # (I - K H) P
        for b in range(m):
            for j in range(n):
                p[i, j] -= gain[b, i] * ph[b, j]
    ph[:] = 0.0  # (I - K H) P H' - K R, 0 but for states that are not learned
    for b in range(m):
        for k in range(n):
            factor = h[rows[b], k]
            if factor != 0.0:
                for i in range(n):
                    ph[b, i] += p[i, k] * factor
        for a in range(m):
            for i in range(n):
                ph[b, i] -= gain[a, i] * r[rows[a], rows[b]]
    for i in range(n):
        for b in range(m):
            for j in range(i, n):
                p[i, j] -= ph[b, i] * gain[b, j]
        for j in range(i, n):
            p[j, i] = p[i, j]
    return nis


@kernel
def publish(
    t_ns: int, words: Times, known: bool, x: Floats, p: Floats, off: Floats, nis: float, held: int,
    current: Times, clock: Times, row: Floats, packed: Words,
) -> None:  # fmt: skip
    """Write ``row``: each state with its standard deviation, innovations, NIS and the status.

    ``words``, the tables of the cycle, get it too, and ``packed`` as a ring has it
    (:func:`rigd.model.rows.row_dtype`): ``t_ns``, values, and the status as uint32.

    Between two readings of a slow channel its innovation and the NIS stay; they are NaN while it is
    late. A state that is not finite, or a variance that is not or is below 0, means that the filter
    has diverged: the whole state is unknown, and the filter begins anew.
    """
    n, m = x.shape[0], off.shape[0]
    status = 0.0
    for i in range(n):
        if known and not (math.isfinite(x[i]) and 0.0 <= p[i, i] < math.inf):
            known, status = False, _DIVERGED
    if not known:
        clock[_BEGUN] = 0
    for i in range(n):
        row[2 * i] = x[i] if known else math.nan
        row[2 * i + 1] = math.sqrt(p[i, i]) if known else math.nan
    any_used, any_current, late = False, False, False
    for i in range(m):
        state = current[held + i]
        if not known or state == 0:
            row[2 * n + i] = math.nan
        elif state == 2:
            row[2 * n + i] = off[i]
        any_used = any_used or state == 2
        any_current = any_current or state > 0
    if not known or not any_current:
        row[2 * n + m] = math.nan
    elif any_used:
        row[2 * n + m] = nis
    for state in current:
        late = late or state == 0
    last = 2 * n + m + 1
    row[last] = status + (_LATE if late else 0.0)
    packed[0], packed[1] = t_ns & 0xFFFFFFFF, t_ns >> 32
    bits = row.view(np.uint32)
    for i in range(2 * last):
        packed[2 + i] = bits[i]
    packed[2 + 2 * last] = np.uint32(row[last])
    if clock[ROW] >= 0:
        words[clock[ROW_TIME]] = t_ns
        words[clock[ROW] : clock[ROW] + last + 1] = row.view(np.int64)


@kernel
def step_linear(
    t_ns: int, words: Times, times: Times, floats: Floats, places: Times, packed: Words
) -> None:
    """Compute a linear filter for the cycle at ``t_ns``: x+ = F x + G u, z = H x + D u.

    ``floats`` has, behind the tables of the memory: x (n), P (n, n), innovations (m), a matrix that
    is overwritten (n, n), F (n, n), G (n, l), H (m, n), D (m, l), Q (n, n), R (m, m), the first x
    and P, and ones (n).
    """
    given, held, row = cut(floats, places, 0), cut(floats, places, 1), cut(floats, places, 2)
    ages, current, clock, period_ns, lost_ns = cut_times(times, given.shape[0])
    x, off = cut(floats, places, 3), cut(floats, places, 5)
    n, m, inputs = x.shape[0], off.shape[0], held.shape[0]
    p, work = square(floats, places, 4, n), square(floats, places, 6, n)
    f, g = square(floats, places, 7, n), cut(floats, places, 8)
    h, d = square(floats, places, 9, n), cut(floats, places, 10)
    steps = take(t_ns, words, period_ns, lost_ns, given, ages, held, current, clock)
    nis = math.nan
    if steps == 0:
        x[:], p[:] = cut(floats, places, 13), square(floats, places, 14, n)
    for _ in range(steps):
        for i in range(n):
            total = 0.0
            for k in range(n):
                total += f[i, k] * x[k]
            for k in range(inputs):
                total += g[i * inputs + k] * held[k]
            work[0, i] = total
        x[:] = work[0]
        predict(x, p, f, square(floats, places, 11, n), work)
    if steps >= 0:
        for i in range(m):
            total = given[inputs + i]
            for k in range(n):
                total -= h[i, k] * x[k]
            for k in range(inputs):
                total -= d[i * inputs + k] * held[k]
            off[i] = total
        learned = cut(floats, places, 15)
        nis = correct(x, p, h, square(floats, places, 12, m), off, current, inputs, learned)
    publish(t_ns, words, steps >= 0, x, p, off, nis, inputs, current, clock, row, packed)
