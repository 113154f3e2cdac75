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

from rigd.model.kernel import kernel

Floats = NDArray[np.float64]
Times = NDArray[np.int64]

#: A time before all others: of a channel that has given no value yet.
NEVER: Final = -(2**62)
#: The places of ``clock``: time of the state, time of the last reading used, whether it has begun.
_AT, _READ, _BEGUN = 0, 1, 2
#: Bit 31 of the status: a channel is late or not known.
_LATE: Final = 2147483648.0
#: Bit 30: the filter has diverged in this cycle.
_DIVERGED: Final = 1073741824.0


@kernel
def take(
    t_ns: int,
    period_ns: int,
    lost_ns: int,
    given: Floats,
    ages: Times,
    held: Floats,
    current: Times,
    clock: Times,
) -> int:
    """Take the readings of the cycle at ``t_ns``; return how many periods to predict.

    ``given`` (l + m) are the newest values of the inputs, then of the measured channels. The rows
    of ``ages`` (3, l + m) are their times, the ages above which they are late, and the times of the
    last values that were used. ``held`` (l) keeps the last known inputs. ``current`` (l + m) gets 2
    for a value to use now, 1 for one that is not late, else 0. All times are in ns.

    0 means that the filter begins, for the first time or because nothing was measured for
    ``lost_ns`` before; -1 that the state is not known: nothing is measured for ``lost_ns``, or an
    input is not known for so long.
    """
    known, arrived, inputs = True, False, held.shape[0]
    for i in range(given.shape[0]):
        finite, stamp = math.isfinite(given[i]), ages[0, i]
        new = finite and (i < inputs or stamp > ages[2, i])
        current[i] = 1 if finite and t_ns - stamp <= ages[1, i] else 0
        if new:
            ages[2, i] = stamp
        if i < inputs:
            if finite:
                held[i] = given[i]
            known = known and t_ns - ages[2, i] <= lost_ns
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
    ph = np.zeros((n, m))  # P H'
    s = np.empty((m, m))  # S = H P H' + R, then its Cholesky factor L
    for b in range(m):
        for i in range(n):
            for k in range(n):
                ph[i, b] += p[i, k] * h[rows[b], k]
    for a in range(m):
        for b in range(m):
            total = r[rows[a], rows[b]]
            for k in range(n):
                total += h[rows[a], k] * ph[k, b]
            s[a, b] = total
    for b in range(m):
        for a in range(b, m):
            total = s[a, b]
            for k in range(b):
                total -= s[a, k] * s[b, k]
            s[a, b] = math.sqrt(total) if a == b else total / s[b, b]
    y = np.empty(m)  # L^-1 y
    nis = 0.0
    for a in range(m):
        total = off[rows[a]]
        for k in range(a):
            total -= s[a, k] * y[k]
        y[a] = total / s[a, a]
        nis += y[a] * y[a]
    gain = np.empty((n, m))  # K L = P H' L'^-1, then K = (K L) L^-1
    for i in range(n):
        for b in range(m):
            total = ph[i, b]
            for k in range(b):
                total -= gain[i, k] * s[b, k]
            gain[i, b] = learned[i] * total / s[b, b]
            x[i] += gain[i, b] * y[b]
        for b in range(m - 1, -1, -1):
            total = gain[i, b]
            for k in range(b + 1, m):
                total -= gain[i, k] * s[k, b]
            gain[i, b] = total / s[b, b]
    for i in range(n):  # (I - K H) P
        for j in range(n):
            for b in range(m):
                p[i, j] -= gain[i, b] * ph[j, b]
    rest = np.zeros((n, m))  # (I - K H) P H' - K R, 0 but for states that are not learned
    for i in range(n):
        for b in range(m):
            for k in range(n):
                rest[i, b] += p[i, k] * h[rows[b], k]
            for a in range(m):
                rest[i, b] -= gain[i, a] * r[rows[a], rows[b]]
    for i in range(n):
        for j in range(i, n):
            for b in range(m):
                p[i, j] -= rest[i, b] * gain[j, b]
            p[j, i] = p[i, j]
    return nis


@kernel
def publish(
    known: bool, x: Floats, p: Floats, off: Floats, nis: float, held: int, current: Times,
    clock: Times, row: Floats,
) -> None:  # fmt: skip
    """Write ``row``: each state with its standard deviation, innovations, NIS and the status.

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
    row[2 * n + m + 1] = status + (_LATE if late else 0.0)


@kernel
def step_linear(
    t_ns: int, period_ns: int, lost_ns: int, given: Floats, ages: Times, held: Floats,
    current: Times, clock: Times, x: Floats, p: Floats, off: Floats, work: Floats,
    f: Floats, g: Floats, h: Floats, d: Floats, q: Floats, r: Floats, x0: Floats, p0: Floats,
    learned: Floats, row: Floats,
) -> None:  # fmt: skip
    """Compute a linear filter for the cycle at ``t_ns``: x+ = F x + G u, z = H x + D u.

    Shapes: ``f``, ``q``, ``p0`` (n, n); ``g`` (n, l); ``h`` (m, n); ``d`` (m, l); ``r`` (m, m);
    ``x0`` (n); ``work`` (n, n) is overwritten. For the others see :func:`take`, :func:`correct`.
    """
    n, m, inputs = x.shape[0], off.shape[0], held.shape[0]
    steps = take(t_ns, period_ns, lost_ns, given, ages, held, current, clock)
    nis = math.nan
    if steps == 0:
        x[:], p[:] = x0, p0
    for _ in range(steps):
        for i in range(n):
            total = 0.0
            for k in range(n):
                total += f[i, k] * x[k]
            for k in range(inputs):
                total += g[i, k] * held[k]
            work[0, i] = total
        x[:] = work[0]
        predict(x, p, f, q, work)
    if steps >= 0:
        for i in range(m):
            total = given[inputs + i]
            for k in range(n):
                total -= h[i, k] * x[k]
            for k in range(inputs):
                total -= d[i, k] * held[k]
            off[i] = total
        nis = correct(x, p, h, r, off, current, inputs, learned)
    publish(steps >= 0, x, p, off, nis, inputs, current, clock, row)
