"""Runs the compiled linear filter on the memory of an observer."""

from __future__ import annotations

import math

import numpy as np

from rigd.observers.kernel import Floats, step_linear
from rigd.observers.linear import LinearPlan, Matrix
from rigd.observers.memory import Memory


class LinearFilter:
    """A linear Kalman filter with its state."""

    def __init__(self, plan: LinearPlan, memory: Memory) -> None:
        states, inputs, measured = len(plan.x0), memory.inputs, memory.measured
        self._memory = memory
        self._f, self._g = _array(plan.f, states, states), _array(plan.g, states, inputs)
        self._h, self._d = _array(plan.h, measured, states), _array(plan.d, measured, inputs)
        self._q, self._r = _array(plan.q, states, states), _array(plan.r, measured, measured)
        self._x0, self._p0 = np.array(plan.x0), _array(plan.p0, states, states)
        self._x, self._p = np.full(states, math.nan), np.zeros((states, states))
        self._learned, self._off = np.ones(states), np.zeros(measured)
        self._work = np.zeros((states, states))

    def step(self, t_ns: int) -> None:
        """Compute the cycle at ``t_ns``."""
        memory = self._memory
        step_linear(
            t_ns, memory.period_ns, memory.lost_ns, memory.given, memory.ages, memory.held,
            memory.current, memory.clock, self._x, self._p, self._off, self._work, self._f,
            self._g, self._h, self._d, self._q, self._r, self._x0, self._p0, self._learned,
            memory.row,
        )  # fmt: skip


def _array(matrix: Matrix, rows: int, columns: int) -> Floats:
    return np.array(matrix, dtype=float).reshape(rows, columns)
