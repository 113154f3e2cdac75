"""Computes a graph of derived channels from recorded samples, by the kernel of the cycle."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from rigd.computed.derived.evaluator import Evaluator
from rigd.computed.derived.graph import Graph
from rigd.computed.derived.kernel import replay
from rigd.model.tables import Tables

Floats = NDArray[np.float64]
Times = NDArray[np.int64]


class Replay:
    """Computes a graph row by row; it remembers what came before, as in the cycle.

    ``late_ns`` is for each input of the graph the age above which it is late.
    """

    def __init__(self, graph: Graph, late_ns: Sequence[int], begun_ns: int) -> None:
        count, outputs = len(graph.inputs), len(graph.outputs)
        self._begun_ns = begun_ns
        self._evaluator = Evaluator(graph)
        self._tables = Tables(
            [math.nan] * count, [0] * (count + outputs), [], [],
            {name: place for place, name in enumerate(graph.inputs)},
            tuple(range(count)), tuple(late_ns), {}, rows_end=count,
        )  # fmt: skip
        self._evaluator.bind(self._tables, count)
        ends = np.cumsum([0, *(len(row) // 4 for row in self._evaluator.packed)])
        self._columns = {
            group: slice(int(begin), int(end))
            for group, begin, end in zip(graph.groups(), ends[:-1], ends[1:], strict=True)
        }
        self._width = int(ends[-1])

    def begin(self) -> None:
        """Forget all, as where a run begins anew."""
        self._evaluator.forget()

    def begin_trial(self, trial: int) -> None:
        """Give parameters their values in ``trial``, and begin what begins anew with a trial."""
        self._evaluator.begin_trial(trial)

    def end_trial(self) -> None:
        """Take their values from the parameters that differ by trial."""
        self._evaluator.set_parameters()

    def rows(self, t_ns: Times, inputs: Floats, stamps: Times) -> Mapping[str, NDArray[np.uint32]]:
        """Return the rows (n, w) of each group, with the bytes of the stream's row dtype.

        ``t_ns`` (n,) are the times of the rows, ``inputs`` and ``stamps`` (n, k) the values of the
        inputs in SI and the times of these readings, in ns.
        """
        packed = np.empty((len(t_ns), self._width), np.uint32)
        replay(
            t_ns, self._begun_ns, inputs, stamps, self._tables.words, self._evaluator.own, packed
        )
        return {group: packed[:, columns] for group, columns in self._columns.items()}
