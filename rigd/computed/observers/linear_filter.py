"""Runs the compiled linear filter on the memory of an observer."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rigd.computed.observers.kernel import Floats, Times, step_linear
from rigd.computed.observers.memory import Memory
from rigd.computed.observers.model import Matrix


class LinearFilter:
    """A linear Kalman filter with its state; the matrices are those of its plan."""

    def __init__(
        self,
        memory: Memory,
        *,
        f: Matrix,
        g: Matrix,
        h: Matrix,
        d: Matrix,
        q: Matrix,
        r: Matrix,
        x0: Sequence[float],
        p0: Matrix,
    ) -> None:
        n, inputs, measured = len(x0), memory.inputs, memory.measured
        self._tables = memory.join(
            (
                np.full(n, math.nan), np.zeros((n, n)), np.zeros(measured), np.zeros((n, n)),
                _array(f, n, n), _array(g, n, inputs), _array(h, measured, n),
                _array(d, measured, inputs), _array(q, n, n),
                _array(r, measured, measured), np.array(x0), _array(p0, n, n),
                np.ones(n),
            )
        )  # fmt: skip
        self._packed = memory.packed

    def step(self, t_ns: int, words: Times) -> None:
        """Compute the cycle at ``t_ns``."""
        step_linear(t_ns, words, *self._tables, self._packed)


def _array(matrix: Matrix, rows: int, columns: int) -> Floats:
    return np.array(matrix, dtype=float).reshape(rows, columns)
