"""Runs a filter cycle by cycle on the tables of the cycle."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from rigd.model.channels import ECHO
from rigd.model.gather import Copy, copies
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
        self._readings: list[Copy] = []
        self._stamps: list[Copy] = []
        self._echoes: list[Copy] = []
        self._sent: list[int] = []  #: places of the echoes
        self._cycle: tuple[Sequence[float], Sequence[int], Sequence[float]] = ((), (), ())
        self._filter = config.plan.filter(self._memory)
        self.step(0)  # loads the compiled function, or compiles it: no cycle has time for that
        self._memory.ages[:] = 0
        self.begin()
        self._taken = self._memory.ages[0].data  # a memoryview takes a number twice as fast
        #: The newest row as a ring has it; the memory stays the same.
        self.packed: memoryview = self._memory.packed.data.cast("B")

    def bind(
        self,
        readings: Mapping[str, int],
        stamp_of: Sequence[int],
        late_ns: Sequence[int],
        setpoints: Mapping[str, int],
        values: Sequence[float],
        stamps: Sequence[int],
        applied: Sequence[float],
    ) -> None:
        """Connect to the cycle's tables: ``values``, their ``stamps``, setpoints ``applied``.

        ``late_ns`` has the age above which each stamp counts as stale. A channel that
        the rig lacks is NaN.
        """
        self._cycle = values, stamps, applied
        sources = {n: readings[name] for n, name in enumerate(self._names) if name in readings}
        devices = {place: stamp_of[index] for place, index in sources.items()}
        self._readings = copies("d", sources, self._memory.given)
        self._stamps = copies("q", devices, self._memory.ages[0])
        for place, device in devices.items():
            self._memory.ages[1, place] = late_ns[device]
        echoes = {
            n: setpoints[name.removesuffix(ECHO)]
            for n, name in enumerate(self._names)
            if n not in sources and name.removesuffix(ECHO) in setpoints
        }
        self._echoes, self._sent = copies("d", echoes, self._memory.given), list(echoes)

    def begin(self) -> None:
        """Forget the state, and all readings: the filter begins at the next one."""
        self._memory.begin()

    def step(self, t_ns: int) -> list[float]:
        """Return the row of the cycle at ``t_ns``: states, innovations, NIS and status."""
        values, stamps, applied = self._cycle
        for copy in self._readings:
            copy(values)
        for copy in self._stamps:
            copy(stamps)
        for copy in self._echoes:
            copy(applied)
        for place in self._sent:
            self._taken[place] = t_ns
        self._filter.step(t_ns)
        row: list[float] = self._memory.row.tolist()
        return row
