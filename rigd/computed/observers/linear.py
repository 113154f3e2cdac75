"""Defines a linear Kalman filter as plain data, and checks and discretises its matrices."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rigd.computed.observers.model import Filter, Matrix, ObserverPlan

if TYPE_CHECKING:
    from rigd.computed.observers.memory import Memory

Floats = NDArray[np.float64]

#: A matrix counts as singular below this ratio of its singular values, rows and columns scaled.
_SINGULAR = 1e-9


@dataclass(frozen=True)
class LinearPlan(ObserverPlan):
    """A filter for one period of the cycle: x+ = F x + G u + w, z = H x + D u + v, in SI.

    Shapes for n states, l inputs, m measured channels: ``f``, ``q`` (of w), ``p0`` (n, n); ``g``
    (n, l); ``h`` (m, n); ``d`` (m, l); ``r`` (of v) (m, m); ``x0`` (n).
    """

    f: Matrix
    g: Matrix
    h: Matrix
    d: Matrix
    q: Matrix
    r: Matrix
    x0: tuple[float, ...]
    p0: Matrix

    def filter(self, memory: Memory) -> Filter:
        """Return the filter on ``memory``."""
        from rigd.computed.observers.linear_filter import LinearFilter  # it loads numba

        return LinearFilter(
            memory, f=self.f, g=self.g, h=self.h, d=self.d, q=self.q, r=self.r, x0=self.x0,
            p0=self.p0,
        )  # fmt: skip


def discretised(a: Floats, b: Floats, q: Floats, period_s: float) -> tuple[Floats, Floats, Floats]:
    """Return F, G and Q of one period for dx/dt = A x + B u + w, u constant in the period.

    ``a`` (n, n) in 1/s, ``b`` (n, l), ``q`` (n, n) the spectral density of the white noise w. It
    is exact: a short part of the period by the exponential of one matrix each, after Van Loan, IEEE
    Trans. Automatic Control 23 (1978) 395-404; then doubled, which keeps fast decays exact too.
    """
    n, inputs = b.shape
    doublings = max(0, math.frexp(period_s * float(np.abs(a).sum(axis=1).max()))[1] + 1)
    part_s = period_s / 2.0**doublings
    held = np.zeros((n + inputs, n + inputs))
    held[:n, :n], held[:n, n:] = a, b
    whole = _series(held * part_s)
    f, g = whole[:n, :n], whole[:n, n:]
    loan = np.zeros((2 * n, 2 * n))
    loan[:n, :n], loan[:n, n:], loan[n:, n:] = -a, q, a.T
    noise = f @ _series(loan * part_s)[:n, n:]
    for _ in range(doublings):
        noise, g, f = f @ noise @ f.T + noise, f @ g + g, f @ f
    return f, g, (noise + noise.T) / 2


def _series(matrix: Floats) -> Floats:
    """Return the exponential of ``matrix``, whose diagonal blocks have a norm of at most 1/2."""
    total = term = np.eye(len(matrix))
    for order in range(1, 19):  # the next term is below 1e-22
        term = term @ matrix / order
        total = total + term
    return total


def unequal_place(matrix: Floats) -> tuple[int, int] | None:
    """Return row and column of an entry that differs from its mirror image; None if symmetric."""
    for row, column in zip(*np.nonzero(~np.isclose(matrix, matrix.T, rtol=1e-9)), strict=True):
        return int(row), int(column)
    return None


def is_covariance(matrix: Floats, *, definite: bool = False) -> bool:
    """Return whether a symmetric ``matrix`` has no negative eigenvalue (``definite``: nor zero).

    Rows and columns are scaled by the roots of the diagonal, so that units do not matter.
    """
    diagonal = np.diag(matrix)
    if np.any(diagonal < 0) or (definite and np.any(diagonal <= 0)):
        return False
    empty = diagonal == 0
    if np.any(matrix[empty] != 0):
        return False
    scale = np.where(empty, 1.0, np.sqrt(diagonal))
    least = float(np.linalg.eigvalsh(matrix / np.outer(scale, scale)).min())
    return least > 1e-12 if definite else least > -1e-9


def unseen(f: Floats, h: Floats, period_s: float, names: Sequence[str]) -> list[str]:
    """Return the states that the measured channels do not show and that do not die out either.

    The test of Popov, Belevitch and Hautus: for each eigenvalue s of (F - I) / period that does not
    decay, the rank of [s I - (F - I) / period; H] must be n. ``f`` (n, n), ``h`` (m, n).
    """
    n = len(f)
    rate = (f - np.eye(n)) / period_s
    found: set[str] = set()
    for value in np.linalg.eigvals(f):
        if abs(value) < 1.0 - 1e-9:
            continue
        stacked = np.vstack([(value - 1.0) / period_s * np.eye(n) - rate, h.astype(complex)])
        columns = np.abs(stacked).max(axis=0)
        if np.any(columns == 0):
            found |= {name for name, size in zip(names, columns, strict=True) if size == 0}
            continue
        stacked = stacked / columns
        rows = np.abs(stacked).max(axis=1, keepdims=True)
        stacked = stacked / np.where(rows > 0, rows, 1.0)
        _, sizes, modes = np.linalg.svd(stacked)
        if sizes[-1] < _SINGULAR * sizes[0]:
            share = np.abs(modes[-1])
            most = 1e-3 * share.max()
            found |= {name for name, part in zip(names, share, strict=True) if part > most}
    return [name for name in names if name in found]
