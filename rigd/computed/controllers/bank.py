"""Computes the controllers of a rig once per cycle, from the tables of the cycle."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Final

import numpy as np

from rigd.computed.controllers import kernel
from rigd.computed.controllers.chain import sequence
from rigd.computed.controllers.driver import ControllerConfig
from rigd.model.limits import SetpointLimit
from rigd.model.tables import NOWHERE, Tables
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
        parameters = [
            (c.kp, c.ki, c.kd, c.filter_s, c.weight, c.low, c.high,
             limit.low, limit.high, limit.rate * period_s,
             *(round(1e9 * s) for s in (c.stale_s, c.frozen_s, c.stuck_s)),
             index.get(c.output, -1), c.relay, c.hysteresis,
             -1.0 if c.frozen_always else _MOVED * (c.high - c.low))
            for c, limit in zip(self.configs, own, strict=True)
        ]  # fmt: skip
        _, inputs, memory, results = kernel.FLOATS
        _, taken, places = kernel.INTEGERS
        self._floats = np.zeros((count, results + kernel.RESULTS))
        self._floats[:, :inputs] = parameters
        self._floats[:, inputs + kernel.SCHEDULE] = 1.0
        self._floats[:, memory] = [limit.rest for limit in own]  # a setpoint begins at rest
        self._integers = np.zeros((count, places + kernel.PLACES), dtype=np.int64)
        self._integers[:, :taken] = _FUTURE
        self._places, self._results = self._integers[:, places:], self._floats[:, results:]
        rows, size = self._floats.reshape(-1).data.cast("B"), self._floats.strides[0]
        #: The newest row of each controller as a ring has it; the memory stays the same.
        self.packed: Sequence[memoryview] = [
            rows[c * size + 8 * results : c * size + 8 * (results + kernel.R_FAULT)]
            for c in range(count)
        ]
        self._active: Collection[str] = ()
        # Loads the compiled form, or compiles it: no cycle has time for that.
        kernel.control(0, np.zeros(0, dtype=np.int64), self._floats[:0], self._integers[:0])

    def bind(self, tables: Tables) -> None:
        """Connect to the tables of the cycle."""
        self._tables = tables
        for c, config in enumerate(self.configs):
            row = np.full(kernel.PLACES, NOWHERE)
            row[kernel.WANTED], row[kernel.P_TARGET] = tables.asked(config.setpoint)
            row[kernel.P_OUTPUT], row[kernel.APPLIED] = tables.asked(config.output)
            owner = tables.stamp_of[tables.readings[config.measured]]
            row[kernel.P_STAMPS + kernel.ARRIVAL] = tables.newest_at(owner)
            for source, name in enumerate((config.measured, config.forward, config.schedule)):
                if name is not None:
                    at = kernel.P_STAMPS + kernel.MEASURED_AGE + source
                    row[kernel.MEASURED + source], row[at], _ = tables.source(name)
            row[kernel.P_ROW : kernel.P_TIME + 1] = tables.row(config.name)
            self._places[c] = row
        self._activate(())

    def _activate(self, active: Collection[str]) -> None:
        """Note which controllers act."""
        self._active = active
        acts = [config.setpoint in active for config in self.configs]
        self._floats[:, kernel.FLOATS[1] + kernel.ACTIVE] = acts

    def step(self, t_ns: int, active: Collection[str]) -> str:
        """Compute all controllers for the cycle at ``t_ns``; return why one gives up, or "".

        ``active`` are the setpoints of those that act. The setpoints that are wanted get their
        outputs, and the measured values as setpoints of those that do not act; those that are
        applied the setpoints of all, within their limits. If one gives up, what it commands stays.
        """
        if active is not self._active:
            self._activate(active)
        self._tables.take_wanted()
        fault = kernel.control(t_ns, self._tables.words, self._floats, self._integers)
        self._tables.show_setpoints()
        return "" if fault < 0 else self._why(fault)

    def turn_gains(self, name: str) -> None:
        """Change the sign of the gains, or of the relay, of the controller ``name``.

        From now on it does not give up at a limit of its output: what it does there shall be seen.
        """
        place = self.places[name]
        self._floats[place, [kernel.KP, kernel.KI, kernel.KD, kernel.RELAY]] *= -1.0
        self._floats[place, kernel.STUCK] = math.inf

    def row(self, name: str) -> Sequence[float]:
        """Return what the controller ``name`` did in the last cycle: the values of its channels."""
        row: list[float] = self._results[self.places[name], kernel.R_MEASURED :].tolist()
        return row[: kernel.CHANNELS]

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
