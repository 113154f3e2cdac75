"""Computes in each cycle what no device gives: observers, derived channels, controllers.

Observers come first, then derived channels, which may use them; controllers act once the program
has set what it wants. Each of the three is compiled and works on one copy of the tables of the
cycle: what is done in Python for each cycle is to copy what was read there, and the rows back.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, MutableSequence, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from rigd.computed.controllers.driver import Controller
from rigd.computed.derived.driver import Derived
from rigd.computed.driver import Computed
from rigd.computed.observers.driver import Observer
from rigd.engine.cycle.mount import Mount, MountedRig
from rigd.model.tables import Tables

if TYPE_CHECKING:
    from rigd.computed.controllers.bank import Bank
    from rigd.computed.derived.evaluator import Evaluator


_NONE: Final[Mapping[str, str]] = MappingProxyType({})


def late_after(rig: MountedRig, period_ns: int) -> list[int]:
    """Return for each entry of the table of times the age at which it counts as late, in ns.

    A controller acts after all that uses its channels; a derived channel is as old as the oldest
    reading in it.
    """
    found: dict[str, int] = {}
    graph = None
    for mount in rig.mounts:
        declared = mount.driver.declaration
        found[mount.name] = 0 if declared.every_cycle else round(declared.silent_s * 1e9)
        if isinstance(mount.driver, Controller):
            found[mount.name] = period_ns
        if isinstance(mount.driver, Derived):
            graph = mount.driver.config.graph
    uses = [] if graph is None else [graph.uses[name] for name in rig.derived]
    derived = [max((found.get(n.partition(".")[0], 0) for n in used), default=0) for used in uses]
    return [*found.values(), *derived]


class Computing:
    """What a rig computes, bound to the lists of its cycle, which stay the same objects.

    ``late_ns`` has the age above which each of ``stamps`` counts as late.
    """

    def __init__(
        self,
        rig: MountedRig,
        values: list[float],
        stamps: list[int],
        late_ns: Sequence[int],
        applied: MutableSequence[float],
        wanted: MutableSequence[float],
        evaluator: Evaluator | None,
        bank: Bank | None,
        period_ns: int,
    ) -> None:
        self._bank, self._evaluator, self._period_ns = bank, evaluator, period_ns
        #: What each controller commands, by their setpoints.
        self.loops = _NONE if bank is None else bank.loops
        self.controllers = frozenset(() if bank is None else bank.places)  #: their names
        self.t_ns = -1  #: of the last cycle of which all was computed
        mounts = list(enumerate(rig.mounts))
        computed = [item for item in mounts if isinstance(item[1].driver, Computed)]
        read = [(m.values.stop, n + 1) for n, m in mounts if not isinstance(m.driver, Computed)]
        self._tables = tables = Tables(
            values,
            stamps,
            applied,
            wanted,
            rig.readings,
            rig.stamp_of,
            late_ns,
            rig.setpoints,
            {mount.name: (mount.values.start, n) for n, mount in computed},
            max(read, default=(0, 0)),
            len(mounts),
        )
        self._none = not computed
        self._observers: list[Observer] = []
        #: Observers, then all derived channels.
        self._steps: list[Callable[[int], None]] = []
        for mount in rig.mounts:
            if isinstance(mount.driver, Observer):
                mount.driver.runner.bind(tables, mount.name)
                self._observers.append(mount.driver)
                self._steps.append(mount.driver.runner.step)
        if evaluator is not None:
            evaluator.bind(tables, len(mounts))
            self._steps.append(evaluator.compute)
        if bank is not None:
            bank.bind(tables)
        acting = [item for item in computed if isinstance(item[1].driver, Controller)]
        before = [item for item in computed if item not in acting]
        self._acting = [n for n, _ in acting]
        self._show = _shows(tables, before, len(stamps))
        self._show_controllers = _shows(tables, acting, len(mounts))

    def begin_trial(self, trial: int) -> None:
        """Let observers and derived channels that begin anew with each trial do so."""
        for observer in self._observers:
            observer.begin_trial()
        if self._evaluator is not None:
            self._evaluator.begin_trial(trial)

    @property
    def follows_trials(self) -> bool:
        """Whether a derived channel has a parameter that differs by trial."""
        return self._evaluator is not None and self._evaluator.follows_trials

    def end_trial(self) -> None:
        """Take their values from the parameters that differ by trial."""
        if self._evaluator is not None:
            self._evaluator.set_parameters()

    def estimate(self, t_ns: int) -> None:
        """Compute observers and derived channels from the readings of the cycle at ``t_ns``."""
        if self._none:
            return
        self._tables.take(t_ns)
        if t_ns - self.t_ns > self._period_ns:  # slots were missed: nothing newer is missing
            for place in self._acting:
                self._tables.stamp(place, t_ns - self._period_ns)
        for step in self._steps:
            step(t_ns)
        self._show()

    def control(self, t_ns: int, acting: frozenset[str]) -> str:
        """Let controllers ``acting`` set what they command; return why one gives up.

        The others only follow what they measure.
        """
        self.t_ns = t_ns
        if self._bank is None:
            return ""
        reason = self._bank.step(t_ns, acting)
        self._show_controllers()
        return reason


def _shows(tables: Tables, computed: Sequence[tuple[int, Mount]], end: int) -> Callable[[], None]:
    """Return what shows the rows of ``computed`` in the lists, and all times up to ``end``."""
    if not computed:
        return lambda: None
    (first, begins), (_, ends) = computed[0], computed[-1]
    return tables.shows(slice(begins.values.start, ends.values.stop), slice(first, end))
