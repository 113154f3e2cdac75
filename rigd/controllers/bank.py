"""Computes the controllers of a rig once per cycle, from the tables of the cycle."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, MutableSequence, Sequence
from functools import partial
from struct import Struct
from typing import Final

import numpy as np

from rigd.controllers import kernel
from rigd.controllers.chain import sequence
from rigd.controllers.driver import ControllerConfig
from rigd.model.gather import Copy, copies, getter
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
        #: The index of each controller in :attr:`packed`, by its name.
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
        given = {config.name: place for place, config in enumerate(configs)}
        self._shown = np.full((count, kernel.CHANNELS), math.nan)
        self._goals = np.zeros((2, count))
        self._tables = (
            self._parameters, self._inputs.T, self._stamps.T, np.zeros((count, kernel.MEMORY)),
            np.zeros((count, kernel.TIMES), dtype=np.int64), self._results,
            np.array([given[config.name] for config in self.configs], dtype=np.int64), self._shown,
            self._goals,
        )  # fmt: skip
        rows, size = self._results.reshape(-1).data.cast("B"), 8 * kernel.RESULTS
        #: The newest row of each controller as a ring has it; the memory stays the same.
        self.packed: Sequence[memoryview] = [
            rows[c * size : c * size + 8 * kernel.R_FAULT] for c in range(count)
        ]
        #: Where the channels of each controller begin in :attr:`results`, by its name.
        self.begins = {name: place * kernel.CHANNELS for name, place in given.items()}
        #: The channels of all controllers in the last cycle, in the order in which they were given.
        self.results: list[float] = self._shown.ravel().tolist()
        self._others: list[Copy] = []
        self._times: list[Copy] = []
        self._pack = partial(Struct(f"={3 * count}d").pack_into, self._inputs.data)
        self._active: Collection[str] = ()
        self._sets: list[int] = []
        for place, limit in enumerate(own):  # a setpoint begins at rest
            self._tables[3][place, 0] = limit.rest
        # Loads the compiled form, or compiles it: no cycle has time for that. What numba compiles
        # depends on the layout of these tables, and that on their number.
        parameters, inputs, stamps, memory, times, results, places, shown, goals = self._tables
        kernel.control(
            0, parameters, inputs.copy(order="K"), stamps.copy(order="K"), memory.copy(),
            times.copy(), results.copy(), places, shown.copy(), goals.copy(),
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
                    values[(kernel.MEASURED + source) * count + c] = readings[name]
                    times[(kernel.MEASURED_AGE + source) * count + c] = stamp_of[readings[name]]
            times[kernel.ARRIVAL * count + c] = arrival_of[readings[config.measured]]
        # The first columns of the kernel at once: what is wanted, what is applied, the readings.
        first = [values.pop(kernel.MEASURED * count + c) for c in range(count)]
        self._measured = getter(first)
        self._others = copies("d", values, self._inputs)
        self._times = copies("q", times, self._stamps)
        self._targets = [setpoints[config.setpoint] for config in self.configs]
        self._outputs = [setpoints[config.output] for config in self.configs]
        self._wanted, self._applied = getter(self._targets), getter(self._outputs)
        self._activate(())

    def _activate(self, active: Collection[str]) -> None:
        """Note which controllers act, and where what each sets goes."""
        self._active = active
        acts = [config.setpoint in active for config in self.configs]
        self._inputs[kernel.ACTIVE] = acts
        places = zip(acts, self._outputs, self._targets, strict=True)
        self._sets = [output if on else target for on, output, target in places]

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
        self._pack(0, *self._wanted(wanted), *self._applied(applied), *self._measured(values))
        for copy in self._others:
            copy(values)
        for copy in self._times:
            copy(stamps)
        fault = kernel.control(t_ns, *self._tables)
        self.results = self._shown.ravel().tolist()
        targets, sets = self._goals.tolist()
        for target, goal, place, value in zip(
            self._targets, targets, self._sets, sets, strict=True
        ):
            applied[target], wanted[place] = goal, value
        return "" if fault < 0 else self._why(fault)

    def turn_gains(self, name: str) -> None:
        """Change the sign of the gains, or of the relay, of the controller ``name``.

        From now on it does not give up at a limit of its output: what it does there shall be seen.
        """
        place = self.places[name]
        self._parameters[place, [kernel.KP, kernel.KI, kernel.KD, kernel.RELAY]] *= -1.0
        self._parameters[place, kernel.STUCK] = math.inf

    def row(self, name: str) -> Sequence[float]:
        """Return what the controller ``name`` did in the last cycle: the values of its channels."""
        begin = self.begins[name]
        return self.results[begin : begin + kernel.CHANNELS]

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
