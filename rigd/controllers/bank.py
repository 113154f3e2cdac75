"""Computes the controllers of a rig once per cycle, from the tables of the cycle."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, MutableSequence, Sequence

import numpy as np

from rigd.controllers import kernel
from rigd.controllers.chain import sequence
from rigd.controllers.driver import ControllerConfig
from rigd.model.limits import SetpointLimit
from rigd.model.units import format_quantity

_SOURCES = ("measured", "forward", "schedule")


class Bank:
    """Computes all controllers of a rig; :meth:`bind` connects it to the tables of the cycle.

    ``limits`` has the limits of each setpoint by name, those of the controllers included.
    """

    def __init__(
        self,
        configs: Sequence[ControllerConfig],
        limits: Mapping[str, SetpointLimit],
        period_s: float,
    ) -> None:
        by_setpoint = {config.setpoint: config for config in configs}
        #: What each controller commands, by their setpoints; an outer controller before an inner.
        self.loops = {config.setpoint: config.output for config in configs}
        ordered = sequence(self.loops)
        if ordered is None:
            raise ValueError("controllers command one another in a circle")
        self.loops = {name: self.loops[name] for name in ordered}
        self.configs = [by_setpoint[name] for name in ordered]
        #: The index of each controller in :attr:`rows`, by its name.
        self.places = {config.name: index for index, config in enumerate(self.configs)}
        count = len(ordered)
        #: What each controller did in the last cycle: the values of its channels.
        self.rows: list[list[float]] = [[math.nan] * kernel.R_TARGET for _ in range(count)]
        own = [limits[name] for name in ordered]
        self._limits = own
        self._parameters = np.array(
            [
                (c.kp, c.ki, c.kd, c.filter_s, c.weight, c.low, c.high,
                 limit.low, limit.high, limit.rate * period_s)
                for c, limit in zip(self.configs, own, strict=True)
            ]
        ).reshape(count, kernel.PARAMETERS)  # fmt: skip
        self._limits_ns = np.array(
            [[round(1e9 * s) for s in (c.stale_s, c.frozen_s, c.stuck_s)] for c in self.configs],
            dtype=np.int64,
        ).reshape(count, 3)
        self._used = np.array(
            [[True, c.forward is not None, c.schedule is not None] for c in self.configs]
        ).reshape(count, 3)
        index = {name: place for place, name in enumerate(ordered)}
        self._commands = np.array(
            [index.get(config.output, -1) for config in self.configs], dtype=np.int64
        )
        self._active = np.zeros(count, dtype=np.bool_)
        self._inputs = np.zeros((count, kernel.INPUTS))
        self._stamps = np.zeros((count, 3), dtype=np.int64)
        self._memory = np.zeros((count, kernel.MEMORY))
        self._taken = np.zeros((count, kernel.TIMES), dtype=np.int64)
        self._results = np.zeros((count, kernel.RESULTS))
        self._faults = np.zeros((count, 2), dtype=np.int64)
        for place, limit in enumerate(own):  # a setpoint begins at rest
            self._memory[place, 0] = limit.rest
        self._readings: list[tuple[int, int, int, int]] = []
        self._setpoints: list[tuple[int, int]] = []
        self._begun_ns: int | None = None
        kernel.warm()

    def bind(
        self,
        readings: Mapping[str, int],
        device_of: Sequence[int],
        setpoints: Mapping[str, int],
    ) -> None:
        """Note the places of channels and setpoints in the tables of the cycle."""
        for c, config in enumerate(self.configs):
            for source, name in enumerate((config.measured, config.forward, config.schedule)):
                if name is not None:
                    place = readings[name]
                    self._readings.append((c, source, place, device_of[place]))
            self._setpoints.append((setpoints[config.setpoint], setpoints[config.output]))

    def step(
        self,
        t_ns: int,
        active: Collection[str],
        values: Sequence[float],
        stamps: Sequence[int],
        wanted: MutableSequence[float],
        applied: MutableSequence[float],
    ) -> str:
        """Compute all controllers for the cycle at ``t_ns``; return why one gives up, or "".

        ``active`` are the setpoints of those that act. ``wanted`` gets their outputs, and the
        measured values as setpoints of those that do not act; ``applied`` the setpoints of all,
        within their limits. If one gives up, what it commands stays.
        """
        if self._begun_ns is None:
            self._begun_ns = t_ns
        begun_ns, inputs, times = self._begun_ns, self._inputs, self._stamps
        for c, source, place, device in self._readings:
            inputs[c, source] = values[place]
            times[c, source] = stamps[device] - begun_ns
        for c, (target, output) in enumerate(self._setpoints):
            inputs[c, kernel.WANTED] = wanted[target]
            inputs[c, kernel.APPLIED] = applied[output]
            self._active[c] = self.configs[c].setpoint in active
        kernel.control(
            t_ns - begun_ns, self._active, self._commands, self._parameters, self._limits_ns,
            self._used, inputs, times, self._memory, self._taken, self._results, self._faults,
        )  # fmt: skip
        results, acting = self._results.tolist(), self._active.tolist()
        for c, (target, output) in enumerate(self._setpoints):
            *row, goal = results[c]
            self.rows[c] = row
            applied[target] = goal
            if not acting[c]:
                wanted[target] = goal
            else:
                wanted[output] = row[kernel.R_OUTPUT]
        return "" if not self._faults[:, 0].any() else self._why()

    def _why(self) -> str:
        c = int(np.flatnonzero(self._faults[:, 0])[0])
        config, row, (fault, source) = self.configs[c], self.rows[c], self._faults[c].tolist()
        name = getattr(config, _SOURCES[source])
        reason = "its output is too large a number"
        if fault == kernel.NAN:
            reason = f"{name} is not a number" + (" of at least 0" if source == 2 else "")
        elif fault == kernel.OLD:
            reason = f"{name} is stale: its last reading is over {1e3 * config.stale_s:g} ms old"
        elif fault == kernel.STILL:
            reason = (
                f"{name} is frozen: it has not changed at all for {config.frozen_s:g} s, while "
                f"{config.output} did"
            )
        elif fault == kernel.NO_PROGRESS:
            output = format_quantity(row[kernel.R_OUTPUT], config.output_unit)
            away = format_quantity(abs(row[kernel.R_ERROR]), config.unit)
            reason = (
                f"{config.output} has been at its limit of {output} for {config.stuck_s:g} s, and "
                f"{name} comes no nearer to its setpoint, which is {away} away: the gains have the "
                "wrong sign, or the setpoint is out of reach"
            )
        return f"controller {config.name}: {reason}"
