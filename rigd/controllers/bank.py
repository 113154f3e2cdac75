"""Computes the controllers of a rig once per cycle, from the tables of the cycle."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, MutableSequence, Sequence
from typing import Final

import numpy as np

from rigd.controllers import kernel
from rigd.controllers.chain import sequence
from rigd.controllers.driver import ControllerConfig
from rigd.model.gather import Copy, copies
from rigd.model.limits import SetpointLimit
from rigd.model.units import format_quantity

#: The time of an input that is not used: it never is too old.
_FUTURE: Final = 2**62
#: Of the range of the output: so far it must have moved before a value without change is frozen.
_MOVED: Final = 0.01
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
        #: The index of each controller in :attr:`spans` and :attr:`packed`, by its name.
        self.places = {config.name: index for index, config in enumerate(self.configs)}
        count = len(ordered)
        own = [limits[name] for name in ordered]
        index = {name: place for place, name in enumerate(ordered)}
        self._parameters = np.array(
            [
                (c.kp, c.ki, c.kd, c.filter_s, c.weight, c.low, c.high,
                 limit.low, limit.high, limit.rate * period_s,
                 *(round(1e9 * s) for s in (c.stale_s, c.frozen_s, c.stuck_s)),
                 index.get(c.output, -1), c.relay, c.hysteresis,
                 -1.0 if c.frozen_always else _MOVED * (c.high - c.low))
                for c, limit in zip(self.configs, own, strict=True)
            ]
        ).reshape(count, kernel.PARAMETERS)  # fmt: skip
        # A row for each column of the kernel, so that one column is copied at once.
        self._inputs = np.zeros((kernel.INPUTS, count))
        self._inputs[kernel.SCHEDULE] = 1.0
        self._stamps = np.full((kernel.STAMPS, count), _FUTURE)
        self._results = np.zeros((count, kernel.RESULTS))
        self._tables = (
            self._parameters, self._inputs.T, self._stamps.T, np.zeros((count, kernel.MEMORY)),
            np.zeros((count, kernel.TIMES), dtype=np.int64), self._results,
        )  # fmt: skip
        self._flat = self._results.reshape(-1)
        rows = self._flat.data.cast("B")
        size = 8 * kernel.RESULTS
        #: The newest row of each controller as a ring has it; the memory stays the same.
        self.packed: Sequence[memoryview] = [
            rows[c * size : c * size + 8 * kernel.R_FAULT] for c in range(count)
        ]
        #: What the controllers did in the last cycle, one after the other; see :attr:`spans`.
        self.results: list[float] = [math.nan] * (kernel.RESULTS * count)
        #: The place of the channels of each controller in :attr:`results`.
        self.spans = [
            slice(at + kernel.R_MEASURED, at + kernel.R_TARGET)
            for at in range(0, kernel.RESULTS * count, kernel.RESULTS)
        ]
        self._readings: list[Copy] = []
        self._times: list[Copy] = []
        self._wanted: list[Copy] = []
        self._applied: list[Copy] = []
        self._places: list[tuple[int, int, str]] = []
        self._active: Collection[str] = ()
        self._outcomes: list[tuple[int, int, int, int]] = []
        for place, limit in enumerate(own):  # a setpoint begins at rest
            self._tables[3][place, 0] = limit.rest
        # Loads the compiled form, or compiles it: no cycle has time for that. What numba compiles
        # depends on the layout of these tables, and that on their number.
        parameters, inputs, stamps, memory, times, results = self._tables
        kernel.control(
            0, parameters.copy(), inputs.copy(order="K"), stamps.copy(order="K"), memory.copy(),
            times.copy(), results.copy(),
        )  # fmt: skip

    def bind(
        self,
        readings: Mapping[str, int],
        stamp_of: Sequence[int],
        arrival_of: Sequence[int],
        setpoints: Mapping[str, int],
    ) -> None:
        """Note the places of channels and setpoints in the tables of the cycle.

        ``stamp_of`` has for each place in ``readings`` that of its age in the table of times,
        ``arrival_of`` that of the time at which a reading came last.
        """
        count, values, times = len(self.configs), {}, {}
        for c, config in enumerate(self.configs):
            for source, name in enumerate((config.measured, config.forward, config.schedule)):
                if name is not None:
                    values[source * count + c] = readings[name]
                    times[(kernel.MEASURED_AGE + source) * count + c] = stamp_of[readings[name]]
            times[kernel.ARRIVAL * count + c] = arrival_of[readings[config.measured]]
        self._readings = copies("d", values, self._inputs)
        self._times = copies("q", times, self._stamps)
        self._places = [
            (setpoints[config.setpoint], setpoints[config.output], config.setpoint)
            for config in self.configs
        ]
        targets = {kernel.WANTED * count + c: at for c, (at, _, _) in enumerate(self._places)}
        outputs = {kernel.APPLIED * count + c: at for c, (_, at, _) in enumerate(self._places)}
        self._wanted = copies("d", targets, self._inputs)
        self._applied = copies("d", outputs, self._inputs)
        self._activate(())

    def _activate(self, active: Collection[str]) -> None:
        """Note which controllers act, and for each where its setpoint and what it wants go."""
        self._active = active
        self._outcomes = []
        for c, (target, output, name) in enumerate(self._places):
            acts, at = name in active, c * kernel.RESULTS
            self._inputs[kernel.ACTIVE, c] = acts
            wants = (output, at + kernel.R_OUTPUT) if acts else (target, at + kernel.R_TARGET)
            self._outcomes.append((target, at + kernel.R_TARGET, *wants))

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
        if active is not self._active:
            self._activate(active)
        for copy in self._readings:
            copy(values)
        for copy in self._times:
            copy(stamps)
        for copy in self._wanted:
            copy(wanted)
        for copy in self._applied:
            copy(applied)
        fault = kernel.control(t_ns, *self._tables)
        results: list[float] = self._flat.tolist()
        self.results = results
        for target, goal, place, wants in self._outcomes:
            applied[target] = results[goal]
            wanted[place] = results[wants]
        return "" if fault < 0 else self._why(fault)

    def row(self, name: str) -> Sequence[float]:
        """Return what the controller ``name`` did in the last cycle: the values of its channels."""
        return self.results[self.spans[self.places[name]]]

    def _why(self, c: int) -> str:
        config, row = self.configs[c], self._results[c]
        fault, source = int(row[kernel.R_FAULT]), int(row[kernel.R_SOURCE])
        name = getattr(config, _SOURCES[source])
        reason = "its output is too large a number"
        if fault == kernel.NAN:
            reason = f"{name} is not a number" + (" of at least 0" if source == 2 else "")
        elif fault == kernel.OLD:
            reason = f"{name} is stale: its last reading is over {1e3 * config.stale_s:g} ms old"
        elif fault == kernel.STILL:
            reason = f"{name} is frozen: it has not changed at all for {config.frozen_s:g} s" + (
                "" if config.frozen_always else f", while {config.output} did"
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
