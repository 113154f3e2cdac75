"""Computes the graph of a rig's derived channels once per cycle, from the tables of the cycle."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import accumulate, pairwise

import numpy as np

from rigd.derived.graph import Graph, Op
from rigd.derived.kernel import ALWAYS, NEVER, compute, warm
from rigd.model.channels import ECHO


class Evaluator:
    """Computes the graph of a rig; :meth:`bind` connects it to the tables of the cycle."""

    def __init__(self, graph: Graph) -> None:
        constants = {n: r.parameter for n, r in enumerate(graph.rows) if r.op is Op.CONSTANT}
        rows = [
            (n, r.op, r.a, r.b, r.c, r.parameter, r.state, r.size)
            for n, r in enumerate(graph.rows)
            if n not in constants
        ]
        count = len(graph.rows)
        self._graph = graph
        self._rows = np.array(rows, dtype=np.int64).reshape(-1, 8)
        self._parameters = np.array([*graph.parameters, 0.0])
        self._state = np.full(graph.states + 1, math.nan)
        self._inputs = np.full(len(graph.inputs) + 1, math.nan)
        self._ages = np.zeros((2, len(graph.inputs) + 1), dtype=np.int64)
        # A memoryview takes a number in half the time of an array.
        self._given = self._inputs.data.cast("B").cast("d")
        self._stamps = self._ages[0].data.cast("B").cast("q")
        self._values = np.full(count, math.nan)
        self._times = np.zeros((3, count), dtype=np.int64)
        self._stepped = self._times[2]
        self._stepped[:] = NEVER
        for place, parameter in constants.items():
            self._values[place] = graph.parameters[parameter]
            self._times[:2, place] = ALWAYS, NEVER
        self._resets = self._reset_places()
        groups = graph.groups()
        layout: list[int] = []
        for names in groups.values():
            used = frozenset[str]().union(*(graph.uses[name] for name in names))
            places = [place for place, name in enumerate(graph.inputs) if name in used]
            layout += [len(names), *(graph.outputs[name] for name in names), len(places), *places]
        self._layout = np.array(layout, dtype=np.int64)
        self._results = np.zeros(len(graph.outputs) + len(groups))
        self._taken = np.zeros(len(groups), dtype=np.int64)
        sizes = [2 + 2 * len(names) + 1 for names in groups.values()]
        self._packed = np.zeros(sum(sizes), dtype=np.uint32)
        packed, ends = self._packed.data.cast("B"), list(accumulate(sizes, initial=0))
        #: The same rows with their time, as a ring has them; the memory stays the same.
        self.packed: Sequence[memoryview] = [
            packed[4 * begin : 4 * end] for begin, end in pairwise(ends)
        ]
        #: The rows of all groups, one after the other, each with its status last.
        self.results: list[float] = self._results.tolist()
        #: Unix time of the oldest reading of each group, in ns.
        self.taken_ns: list[int] = []
        self._sources: list[tuple[int, int, int]] = []
        self._echoes: list[tuple[int, int]] = []
        self._cycle: tuple[Sequence[float], Sequence[int], Sequence[float]] = ((), (), ())
        self._begun_ns = -1
        warm()

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

        The tables stay the same objects. ``late_ns`` has the age above which the row of each device
        counts as stale. An input that the rig lacks is NaN.
        """
        self._cycle = values, stamps, applied
        for place, name in enumerate(self._graph.inputs):
            if name in readings:
                index = readings[name]
                device = device_of[index]
                self._sources.append((place, index, device))
                self._ages[1, place] = late_ns[device]
            elif name.removesuffix(ECHO) in setpoints:
                self._echoes.append((place, setpoints[name.removesuffix(ECHO)]))

    def compute(self, t_ns: int) -> None:
        """Compute all channels for the cycle at ``t_ns``."""
        if self._begun_ns < 0:
            self._begun_ns = t_ns
        begun_ns, inputs, times = self._begun_ns, self._given, self._stamps
        values, stamps, applied = self._cycle
        for place, index, device in self._sources:
            inputs[place] = values[index]
            times[place] = stamps[device] - begun_ns
        for place, index in self._echoes:
            inputs[place] = applied[index]
            times[place] = t_ns - begun_ns
        compute(
            t_ns, begun_ns, self._inputs, self._ages, self._rows, self._parameters, self._state,
            self._values, self._times, self._layout, self._results, self._taken, self._packed,
        )  # fmt: skip
        self.results = self._results.tolist()
        self.taken_ns = self._taken.tolist()

    def begin_trial(self) -> None:
        """Empty the memory of the channels that begin anew with each trial."""
        for row, places in self._resets:
            self._state[places] = math.nan
            self._stepped[row] = NEVER

    def _reset_places(self) -> list[tuple[int, slice]]:
        rows = self._graph.rows
        starts = sorted({row.state for row in rows} | {self._graph.states})
        following = dict(pairwise(starts))
        return [
            (index, slice(row.state, following[row.state]))
            for index, row in enumerate(rows)
            if row.reset
        ]
