"""Computes the graph of a rig's derived channels once per cycle, from the tables of the cycle."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import accumulate, pairwise
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from rigd.derived.graph import Graph, Op
from rigd.derived.kernel import ALWAYS, NEVER, compute, warm
from rigd.model.channels import ECHO
from rigd.model.gather import Copy, copies

Number = TypeVar("Number", np.float64, np.int64)


class Evaluator:
    """Computes the graph of a rig; :meth:`bind` connects it to the tables of the cycle."""

    def __init__(self, graph: Graph) -> None:
        constants = {n: r.parameter for n, r in enumerate(graph.rows) if r.op is Op.CONSTANT}
        rows = [
            (n, r.op, r.a, r.b, r.c, r.parameter, r.state, r.size)
            for n, r in enumerate(graph.rows)
            if n not in constants
        ]
        self._graph = graph
        groups = graph.groups()
        sizes = [len(names) + 1 for names in groups.values()]  # of their rows, with the status
        layout: list[int] = []
        for names in groups.values():
            used = frozenset[str]().union(*(graph.uses[name] for name in names))
            places = [place for place, name in enumerate(graph.inputs) if name in used]
            layout += [len(names), *(graph.outputs[name] for name in names), len(places), *places]
        count, inputs, results = len(graph.rows), len(graph.inputs), sum(sizes)
        self._floats, at = _joined(
            [np.full(inputs, math.nan), np.array([*graph.parameters, 0.0]),
             np.full(graph.states + 1, math.nan), np.full(count, math.nan), np.zeros(results)]
        )  # fmt: skip
        steps = np.full(count, NEVER)
        times = np.zeros((2, count), dtype=np.int64)
        for place, parameter in constants.items():
            self._floats[at[3] + place] = graph.parameters[parameter]
            times[:, place] = ALWAYS, NEVER
        self._numbers, then = _joined(
            [np.zeros(3 * inputs, dtype=np.int64), np.array(rows, dtype=np.int64).ravel(),
             times.ravel(), steps, np.array(layout, dtype=np.int64),
             np.zeros(2 * len(graph.outputs), dtype=np.int64)]
        )  # fmt: skip
        del then[3]  # behind the other times
        self._places = np.array([*at, *then], dtype=np.int64)
        self._inputs = self._floats[:inputs]
        self._ages = self._numbers[: 3 * inputs].reshape(3, inputs)
        self._state = self._floats[at[2] : at[3]]
        self._stepped = self._numbers[then[2] :][2 * count : 3 * count]
        self._results, self._taken = self._floats[at[4] :], self._numbers[then[4] :]
        self._resets = self._reset_places()
        #: Where the row of each group begins in :attr:`results`.
        self.begins = list(accumulate(sizes, initial=0))
        words = [2 * size + 1 for size in sizes]
        self._packed = np.zeros(sum(words), dtype=np.uint32)
        packed, ends = self._packed.data.cast("B"), list(accumulate(words, initial=0))
        #: The same rows with their time, as a ring has them; the memory stays the same.
        self.packed: Sequence[memoryview] = [
            packed[4 * begin : 4 * end] for begin, end in pairwise(ends)
        ]
        #: The rows of all groups, one after the other, each with its status last.
        self.results: list[float] = self._results.tolist()
        #: Unix time of the oldest reading in each channel in ns, then of the newest.
        self.taken_ns: list[int] = []
        self._readings: list[Copy] = []
        self._stamps: list[Copy] = []
        self._echoes: list[tuple[int, int]] = []
        self._cycle: tuple[Sequence[float], Sequence[int], Sequence[float]] = ((), (), ())
        self._begun_ns = -1
        warm()

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
        """Connect to the cycle's tables: ``values``, ``stamps``, setpoints ``applied``.

        The tables stay the same objects. ``stamp_of`` has the place in ``stamps`` of each value,
        ``late_ns`` for each of these the age above which it counts as stale. An input that the rig
        lacks is NaN.
        """
        self._cycle = values, stamps, applied
        names = self._graph.inputs
        sources = {place: readings[name] for place, name in enumerate(names) if name in readings}
        devices = {place: stamp_of[index] for place, index in sources.items()}
        self._readings = copies("d", sources, self._inputs)
        self._stamps = copies("q", devices, self._ages[2])
        for place, device in devices.items():
            self._ages[1, place] = late_ns[device]
        for place, name in enumerate(names):
            if place not in sources and name.removesuffix(ECHO) in setpoints:
                self._echoes.append((place, setpoints[name.removesuffix(ECHO)]))

    def compute(self, t_ns: int) -> None:
        """Compute all channels for the cycle at ``t_ns``."""
        if self._begun_ns < 0:
            self._begun_ns = t_ns
        values, stamps, applied = self._cycle
        for copy in self._readings:
            copy(values)
        for copy in self._stamps:
            copy(stamps)
        for place, index in self._echoes:
            self._inputs[place] = applied[index]
            self._ages[2, place] = t_ns
        compute(t_ns, self._begun_ns, self._floats, self._numbers, self._places, self._packed)
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


def _joined(parts: Sequence[NDArray[Number]]) -> tuple[NDArray[Number], list[int]]:
    """Return ``parts`` one after the other, and where each begins and the last ends."""
    return np.concatenate(parts), [0, *accumulate(len(part) for part in parts)]
