"""Computes the controllers of a rig once per cycle, from the tables of the cycle."""

from __future__ import annotations

import math
from array import array
from collections.abc import Collection, Mapping, MutableSequence, Sequence
from typing import Final

import numpy as np

from rigd.controllers import kernel
from rigd.controllers.chain import sequence
from rigd.controllers.driver import ControllerConfig
from rigd.model.limits import SetpointLimit
from rigd.model.units import format_quantity

#: The time of an input that is not used: it never is too old.
_FUTURE: Final = 2**62
_SOURCES: Final = ("measured", "forward", "schedule")


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
        index = {name: place for place, name in enumerate(ordered)}
        self._parameters = np.array(
            [
                (c.kp, c.ki, c.kd, c.filter_s, c.weight, c.low, c.high,
                 limit.low, limit.high, limit.rate * period_s,
                 *(round(1e9 * s) for s in (c.stale_s, c.frozen_s, c.stuck_s)),
                 index.get(c.output, -1), c.relay, c.hysteresis)
                for c, limit in zip(self.configs, own, strict=True)
            ]
        ).reshape(count, kernel.PARAMETERS)  # fmt: skip
        # Arrays of Python take and give single numbers much faster than those of numpy.
        self._inputs = array("d", [0.0, 0.0, 1.0, 0.0, 0.0, 0.0] * count)
        self._stamps = array("q", [_FUTURE] * (3 * count))
        self._results = array("d", [0.0] * (kernel.RESULTS * count))
        self._tables = (
            self._parameters,
            np.frombuffer(self._inputs).reshape(count, kernel.INPUTS),
            np.frombuffer(self._stamps, dtype=np.int64).reshape(count, 3),
            np.zeros((count, kernel.MEMORY)),
            np.zeros((count, kernel.TIMES), dtype=np.int64),
            np.frombuffer(self._results).reshape(count, kernel.RESULTS),
        )
        self._readings: list[tuple[int, int, int, int]] = []
        self._setpoints: list[tuple[int, int, int, int, str]] = []
        self._begun_ns: int | None = None
        for place, limit in enumerate(own):  # a setpoint begins at rest
            self._tables[3][place, 0] = limit.rest
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
                    at = c * kernel.INPUTS + source
                    self._readings.append((at, 3 * c + source, place, device_of[place]))
            target, output = setpoints[config.setpoint], setpoints[config.output]
            begin = c * kernel.INPUTS + kernel.WANTED
            self._setpoints.append((begin, c * kernel.RESULTS, target, output, config.setpoint))

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
        for at, when, place, device in self._readings:
            inputs[at] = values[place]
            times[when] = stamps[device] - begun_ns
        for at, _, target, output, name in self._setpoints:
            inputs[at] = wanted[target]
            inputs[at + 1] = applied[output]
            inputs[at + 2] = name in active
        kernel.control(t_ns - begun_ns, *self._tables)
        results, fault = self._results.tolist(), False
        for c, (_, at, target, output, name) in enumerate(self._setpoints):
            self.rows[c] = results[at : at + kernel.R_TARGET]
            goal = applied[target] = results[at + kernel.R_TARGET]
            if name in active:
                wanted[output] = results[at + kernel.R_OUTPUT]
            else:
                wanted[target] = goal
            fault = fault or results[at + kernel.R_FAULT] != kernel.FINE
        return self._why() if fault else ""

    def _why(self) -> str:
        faults = self._tables[-1][:, kernel.R_FAULT :]
        c = int(np.flatnonzero(faults[:, 0])[0])
        config, row = self.configs[c], self.rows[c]
        fault, source = int(faults[c, 0]), int(faults[c, 1])
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
        elif fault == kernel.NO_SWING:
            output = format_quantity(row[kernel.R_OUTPUT], config.output_unit)
            away = format_quantity(abs(row[kernel.R_ERROR]), config.unit)
            reason = (
                f"the relay has had {config.output} at {output} for {config.stuck_s:g} s, and "
                f"{name} has not passed its setpoint, which is {away} away: begin at an output "
                "nearer to what the setpoint needs, or give a larger relay (negative if more "
                "output lowers the measured value)"
            )
        return f"controller {config.name}: {reason}"
