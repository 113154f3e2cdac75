"""Runs a filter cycle by cycle on the tables of the cycle."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from rigd.model.channels import ECHO
from rigd.observers.kernel import NEVER, Floats, step_linear
from rigd.observers.linear import Matrix

if TYPE_CHECKING:
    from rigd.observers.driver import ObserverConfig


class Runner:
    """The memory of a filter; :meth:`bind` connects it to the tables of the cycle."""

    def __init__(self, config: ObserverConfig) -> None:
        plan, inputs, measured = config.plan, len(config.inputs), len(config.measured)
        states, count = len(plan.x0), inputs + measured
        self._f, self._g = _array(plan.f, states, states), _array(plan.g, states, inputs)
        self._h, self._d = _array(plan.h, measured, states), _array(plan.d, measured, inputs)
        self._q, self._r = _array(plan.q, states, states), _array(plan.r, measured, measured)
        self._x0, self._p0 = np.array(plan.x0), _array(plan.p0, states, states)
        self._names = (*config.inputs, *config.measured)
        self._period_ns, self._lost_ns = config.period_ns, config.lost_ns
        self._given = np.full(count, math.nan)
        self._ages = np.zeros((3, count), dtype=np.int64)
        self._held = np.full(inputs, math.nan)
        self._current = np.zeros(count, dtype=np.int64)
        self._clock = np.zeros(3, dtype=np.int64)
        self._x, self._p = np.full(states, math.nan), np.zeros((states, states))
        self._off, self._work = np.zeros(measured), np.zeros((states, states))
        self._row = np.full(2 * states + measured + 2, math.nan)
        self._sources: list[tuple[int, int, int]] = []
        self._echoes: list[tuple[int, int]] = []
        self._cycle: tuple[Sequence[float], Sequence[int], Sequence[float]] = ((), (), ())
        self.begin()
        self.step(0)  # loads the compiled function, or compiles it: no cycle has time for that
        self._ages[:] = 0
        self.begin()

    def bind(
        self,
        readings: Mapping[str, int],
        device_of: Sequence[int],
        late_ns: Sequence[int],
        setpoints: Mapping[str, int],
        values: Sequence[float],
        stamps: Sequence[int],
        applied: Sequence[float],
    ) -> None:
        """Connect to the cycle's tables: ``values``, ``stamps`` of devices, setpoints ``applied``.

        ``late_ns`` has the age above which the row of each device counts as stale. A channel that
        the rig lacks is NaN.
        """
        self._cycle = values, stamps, applied
        for place, name in enumerate(self._names):
            if name in readings:
                index = readings[name]
                device = device_of[index]
                self._sources.append((place, index, device))
                self._ages[1, place] = late_ns[device]
            elif name.removesuffix(ECHO) in setpoints:
                self._echoes.append((place, setpoints[name.removesuffix(ECHO)]))

    def begin(self) -> None:
        """Forget the state, and all readings: the filter begins at the next one."""
        self._ages[2], self._clock[:] = NEVER, (0, NEVER, 0)
        self._held[:] = math.nan

    def step(self, t_ns: int) -> list[float]:
        """Return the row of the cycle at ``t_ns``: states, innovations, NIS and status."""
        values, stamps, applied = self._cycle
        for place, index, device in self._sources:
            self._given[place] = values[index]
            self._ages[0, place] = stamps[device]
        for place, index in self._echoes:
            self._given[place] = applied[index]
            self._ages[0, place] = t_ns
        step_linear(
            t_ns, self._period_ns, self._lost_ns, self._given, self._ages, self._held,
            self._current, self._clock, self._x, self._p, self._off, self._work,
            self._f, self._g, self._h, self._d, self._q, self._r, self._x0, self._p0, self._row,
        )  # fmt: skip
        row: list[float] = self._row.tolist()
        return row


def _array(matrix: Matrix, rows: int, columns: int) -> Floats:
    return np.array(matrix, dtype=float).reshape(rows, columns)
