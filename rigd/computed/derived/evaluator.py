"""Computes the graph of a rig's derived channels once per cycle, from the tables of the cycle."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import accumulate, pairwise

import numpy as np
from numpy.typing import NDArray

from rigd.computed.derived.graph import Graph
from rigd.computed.derived.kernel import ALWAYS, NEVER, compute, warm
from rigd.language.operations import Op
from rigd.model.tables import NOWHERE, Tables


class Evaluator:
    """Computes the graph of a rig; :meth:`bind` connects it to the tables of the cycle."""

    def __init__(self, graph: Graph) -> None:
        constants = {n: r.parameter for n, r in enumerate(graph.rows) if r.op is Op.CONSTANT}
        parameters = {n: r.a for n, r in enumerate(graph.rows) if r.op is Op.PARAMETER}
        rows = [
            (n, r.op, r.a, r.b, r.c, r.parameter, r.state, r.size)
            for n, r in enumerate(graph.rows)
            if n not in constants and n not in parameters
        ]
        self._graph, self._groups = graph, graph.groups()
        count, inputs = len(graph.rows), len(graph.inputs)
        values, steps = np.full(count, math.nan), np.full(count, NEVER)
        times = np.zeros((2, count), dtype=np.int64)
        for place, parameter in constants.items():
            values[place] = graph.parameters[parameter]
        for place in (*constants, *parameters):
            times[:, place] = ALWAYS, NEVER
        # Of the row of each group as a ring has it, in words of four bytes.
        sizes = [2 * len(names) + 3 for names in self._groups.values()]
        self._parameters = parameters
        floats = (
            np.full(inputs, math.nan), np.array([*graph.parameters, 0.0]),
            np.full(graph.states + 1, math.nan), values,
        )  # fmt: skip
        layout = self._layout(None)
        parts = [
            *(part.view(np.int64) for part in floats), np.zeros(4 * inputs, dtype=np.int64),
            np.array(rows, dtype=np.int64).ravel(), np.concatenate([times.ravel(), steps]), layout,
            np.zeros(2, dtype=np.int64), np.zeros((sum(sizes) + 1) // 2, dtype=np.int64),
        ]  # fmt: skip
        ends = list(accumulate((len(part) for part in parts), initial=len(parts) + 1))
        #: All of the graph in one memory; see :func:`rigd.computed.derived.kernel.compute`.
        self.own = np.concatenate([np.array(ends), *parts])
        cut = [self.own[begin:end] for begin, end in pairwise(ends)]
        self._state, self._ages, self._layouts = cut[2].view(np.float64), cut[4], cut[7]
        self._stepped, self._taken = cut[6][2 * count :], cut[8]
        self._values = cut[3].view(np.float64)
        self._resets = self._reset_places()
        packed, begins = cut[9].data.cast("B"), list(accumulate(sizes, initial=0))
        #: The row of each group with its time, as a ring has it; the memory stays the same.
        self.packed: Sequence[memoryview] = [
            packed[4 * begin : 4 * end] for begin, end in pairwise(begins)
        ]
        self._words = np.zeros(0, dtype=np.int64)
        self._begun_ns = -1
        warm()

    def _layout(self, tables: Tables | None) -> NDArray[np.int64]:
        """Return the layout of the kernel; without ``tables`` of a cycle nothing stands there."""
        graph, layout = self._graph, list[int]()
        for group, names in self._groups.items():
            used = frozenset[str]().union(*(graph.uses[name] for name in names))
            places = [place for place, name in enumerate(graph.inputs) if name in used]
            layout += (NOWHERE, NOWHERE) if tables is None else tables.row(group)
            layout += [len(names), *(graph.outputs[name] for name in names), len(places), *places]
            behind = {row for name in names for row in graph.behind(name)}
            parameters = sorted(behind & self._parameters.keys())
            layout += [len(parameters), *parameters]
        return np.array(layout, dtype=np.int64)

    def bind(self, tables: Tables, taken: int) -> None:
        """Connect to the tables of the cycle. An input that the rig lacks is NaN.

        From ``taken`` on the times have those of the oldest reading in each channel.
        """
        self._words = tables.words
        sources = [tables.source(name) for name in self._graph.inputs]
        ages = self._ages.reshape(4, len(sources))
        ages[1] = [source.late_ns for source in sources]
        ages[2] = [source.value for source in sources]
        ages[3] = [source.stamp for source in sources]
        self._layouts[:] = self._layout(tables)
        self._taken[:] = tables.stamp_at(taken), tables.newest_at(taken)

    def compute(self, t_ns: int) -> None:
        """Compute all channels for the cycle at ``t_ns`` in the memory of the tables."""
        if self._begun_ns < 0:
            self._begun_ns = t_ns
        compute(t_ns, self._begun_ns, self._words, self.own)

    @property
    def follows_trials(self) -> bool:
        """Whether a parameter that differs by trial is in a channel."""
        return bool(self._parameters)

    def begin_trial(self, trial: int) -> None:
        """Give parameters their values in ``trial``; empty the memory that begins with a trial."""
        self.set_parameters(self._graph.trials.get(trial, ()))
        for row, places in self._resets:
            self._state[places] = math.nan
            self._stepped[row] = NEVER

    def forget(self) -> None:
        """Empty all memory, as where a run begins."""
        self._state[:] = math.nan
        self._stepped[:] = NEVER

    def set_parameters(self, values: Sequence[float] = ()) -> None:
        """Give the parameters that differ by trial these values in SI; NaN without."""
        for row, place in self._parameters.items():
            self._values[row] = values[place] if values else math.nan

    def _reset_places(self) -> list[tuple[int, slice]]:
        rows = self._graph.rows
        starts = sorted({row.state for row in rows} | {self._graph.states})
        following = dict(pairwise(starts))
        return [
            (index, slice(row.state, following[row.state]))
            for index, row in enumerate(rows)
            if row.reset
        ]
