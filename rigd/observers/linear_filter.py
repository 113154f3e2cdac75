"""Runs the compiled linear filter on the memory of an observer."""

from __future__ import annotations

import math

import numpy as np

from rigd.observers.kernel import Floats, Times, step_linear
from rigd.observers.linear import LinearPlan, Matrix
from rigd.observers.memory import Memory


class LinearFilter:
    """A linear Kalman filter with its state."""

    def __init__(self, plan: LinearPlan, memory: Memory) -> None:
        n, inputs, measured = len(plan.x0), memory.inputs, memory.measured
        self._tables = memory.join(
            (
                np.full(n, math.nan), np.zeros((n, n)), np.zeros(measured), np.zeros((n, n)),
                _array(plan.f, n, n), _array(plan.g, n, inputs), _array(plan.h, measured, n),
                _array(plan.d, measured, inputs), _array(plan.q, n, n),
                _array(plan.r, measured, measured), np.array(plan.x0), _array(plan.p0, n, n),
                np.ones(n),
            )
        )  # fmt: skip
        self._packed = memory.packed

    def step(self, t_ns: int, words: Times) -> None:
        """Compute the cycle at ``t_ns``."""
        step_linear(t_ns, words, *self._tables, self._packed)


def _array(matrix: Matrix, rows: int, columns: int) -> Floats:
    return np.array(matrix, dtype=float).reshape(rows, columns)
