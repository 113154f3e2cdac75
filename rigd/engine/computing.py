"""Computes in each cycle what no device gives: observers, derived channels, controllers.

Observers come first, then derived channels, which may use them; controllers act once the program
has set what it wants. Each of the three is compiled: what is done in Python for each cycle is to
copy what they use, and to take their rows.
"""

from __future__ import annotations

from collections.abc import Mapping, MutableSequence, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from rigd.controllers.driver import Controller
from rigd.derived.driver import Derived
from rigd.engine.cycle_places import runs
from rigd.engine.mount import MountedRig
from rigd.observers.driver import Observer

if TYPE_CHECKING:
    from rigd.controllers.bank import Bank
    from rigd.derived.evaluator import Evaluator


#: The drivers of what is computed: the cycle does not read them.
COMPUTED: Final = Derived | Observer | Controller

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
    return [*found.values(), *derived, *derived]


class Computing:
    """What a rig computes, bound to the tables of its cycle: ``values``, and their ``stamps``.

    ``late_ns`` has the age above which each stamp counts as late, ``applied`` the setpoints as they
    were written; all stay the same objects.
    """

    def __init__(
        self,
        rig: MountedRig,
        values: list[float],
        stamps: list[int],
        late_ns: Sequence[int],
        applied: MutableSequence[float],
        evaluator: Evaluator | None,
        bank: Bank | None,
        period_ns: int,
    ) -> None:
        self._bank, self._period_ns = bank, period_ns
        #: What each controller commands, by their setpoints.
        self.loops = _NONE if bank is None else bank.loops
        self.controllers = frozenset(() if bank is None else bank.places)  #: their names
        self.t_ns = -1  #: of the last cycle of which all was computed
        self._values, self._stamps, self._applied = values, stamps, applied
        self._evaluator = evaluator
        drivers = [(n, mount, mount.driver) for n, mount in enumerate(rig.mounts)]
        self._observers = [(n, m.values, d) for n, m, d in drivers if isinstance(d, Observer)]
        derived = [(n, m.values, d.begins) for n, m, d in drivers if isinstance(d, Derived)]
        self._derived = list(runs(derived))
        self._own_stamps = slice(len(rig.mounts), len(rig.mounts) + 2 * len(rig.derived))
        binds = [driver.bind for _, _, driver in self._observers]
        binds += [] if evaluator is None else [evaluator.bind]
        for bind in binds:
            bind(rig.readings, rig.stamp_of, late_ns, rig.setpoints, values, stamps, applied)
        controllers = [
            (n, mount.values, bank.begins[mount.name])
            for n, mount, driver in drivers
            if bank is not None and isinstance(driver, Controller)
        ]
        self._controllers = list(runs(controllers))
        if bank is not None:
            bank.bind(rig.readings, rig.stamp_of, rig.arrival_of, rig.setpoints)

    def begin_trial(self) -> None:
        """Let observers and derived channels that begin anew with each trial do so."""
        for _, _, observer in self._observers:
            observer.begin_trial()
        if self._evaluator is not None:
            self._evaluator.begin_trial()

    def estimate(self, t_ns: int) -> None:
        """Compute observers and derived channels from the readings of the cycle at ``t_ns``."""
        values, stamps, evaluator = self._values, self._stamps, self._evaluator
        if t_ns - self.t_ns > self._period_ns:  # slots were missed: nothing newer is missing
            for mounts, _, _ in self._controllers:
                stamps[mounts] = [t_ns - self._period_ns] * (mounts.stop - mounts.start)
        for index, places, observer in self._observers:
            values[places] = observer.read(t_ns)
            stamps[index] = t_ns
        if evaluator is None:
            return
        evaluator.compute(t_ns)
        results = evaluator.results
        for mounts, places, rows in self._derived:
            values[places] = results[rows]
            stamps[mounts] = [t_ns] * (mounts.stop - mounts.start)
        stamps[self._own_stamps] = evaluator.taken_ns

    def control(self, t_ns: int, acting: frozenset[str], wanted: list[float]) -> str:
        """Let controllers ``acting`` set what they command in ``wanted``; return why one gives up.

        The others only follow what they measure.
        """
        bank, values, stamps = self._bank, self._values, self._stamps
        self.t_ns = t_ns
        if bank is None:
            return ""
        reason = bank.step(t_ns, acting, values, stamps, wanted, self._applied)
        results = bank.results
        for mounts, places, rows in self._controllers:
            values[places] = results[rows]
            stamps[mounts] = [t_ns] * (mounts.stop - mounts.start)
        return reason
