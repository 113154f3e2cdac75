"""Runs a filter cycle by cycle on the tables of the cycle."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from rigd.model.channels import ECHO
from rigd.observers.memory import Memory

if TYPE_CHECKING:
    from rigd.observers.driver import ObserverConfig


class Runner:
    """A filter with its memory; :meth:`bind` connects it to the tables of the cycle."""

    def __init__(self, config: ObserverConfig) -> None:
        measured = len(config.measured)
        self._memory = Memory(
            len(config.inputs), measured, (len(config.channels) - measured - 1) // 2,
            config.period_ns, config.lost_ns,
        )  # fmt: skip
        self._names = (*config.inputs, *config.measured)
        self._sources: list[tuple[int, int, int]] = []
        self._echoes: list[tuple[int, int]] = []
        self._cycle: tuple[Sequence[float], Sequence[int], Sequence[float]] = ((), (), ())
        self._filter = config.plan.filter(self._memory)
        self.step(0)  # loads the compiled function, or compiles it: no cycle has time for that
        self._memory.ages[:] = 0
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
                self._memory.ages[1, place] = late_ns[device]
            elif name.removesuffix(ECHO) in setpoints:
                self._echoes.append((place, setpoints[name.removesuffix(ECHO)]))

    def begin(self) -> None:
        """Forget the state, and all readings: the filter begins at the next one."""
        self._memory.begin()

    def step(self, t_ns: int) -> list[float]:
        """Return the row of the cycle at ``t_ns``: states, innovations, NIS and status."""
        values, stamps, applied = self._cycle
        given, ages = self._memory.given, self._memory.ages
        for place, index, device in self._sources:
            given[place] = values[index]
            ages[0, place] = stamps[device]
        for place, index in self._echoes:
            given[place] = applied[index]
            ages[0, place] = t_ns
        self._filter.step(t_ns)
        row: list[float] = self._memory.row.tolist()
        return row
