"""Defines the graph of derived channels as plain data: one row of numbers for each operation.

A row is evaluated after the rows that it uses, so one pass from first to last computes all. A row
with memory (an integral, a filter) has its own part of one flat array of states.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Self

from rigd.language.number import Number
from rigd.language.operations import Op
from rigd.model.units import Dimension

#: Numbers of memory of an operation; those over a window add two for each sample of it.
MEMORY = {
    Op.HOLD: 1,
    Op.DERIVATIVE: 2,
    Op.LOWPASS: 6,
    Op.INTEGRAL: 3,
    Op.RATE_LIMIT: 1,
    Op.EDGES: 3,
    Op.MEAN: 5,
    Op.RMS: 5,
    Op.HIGHEST: 2,
    Op.LOWEST: 2,
    Op.DELAY: 2,
}


@dataclass(frozen=True)
class GraphRow:
    """One operation: rows ``a``, ``b``, ``c`` go in; it begins at ``state`` and ``parameter``.

    ``size`` counts the samples of a window or the points of a table. ``reset`` is whether the
    memory is emptied at the start of a trial.
    """

    op: Op
    a: int = 0
    b: int = 0
    c: int = 0
    parameter: int = 0
    state: int = 0
    size: int = 0
    reset: bool = False

    def is_input(self, place: int) -> bool:
        """Return whether the row has the value of the input at ``place``."""
        return self.op is Op.INPUT and self.a == place


@dataclass(frozen=True)
class Graph:
    """All derived channels of a rig.

    ``inputs`` are the channels that they use, in the order of the table of inputs: readings
    (``device.channel``) and setpoints as written (``device.setpoint_setpoint``). ``outputs`` maps
    each derived channel to its row, ``uses`` to the channels that devices measure for it;
    ``differences`` are the derived channels that are the difference of two values. ``swept`` are
    the parameters that differ by trial, ``trials`` their values in SI by number of trial.
    """

    rows: tuple[GraphRow, ...]
    parameters: tuple[float, ...]
    states: int
    inputs: tuple[str, ...]
    outputs: dict[str, int]
    uses: dict[str, frozenset[str]]
    differences: frozenset[str] = frozenset()
    swept: tuple[str, ...] = ()
    trials: Mapping[int, tuple[float, ...]] = field(default_factory=dict)

    def number(self, name: str, dimension: Dimension) -> Number:
        """Return the derived channel ``name``, of this ``dimension``, as a part of a formula."""
        place = self.outputs[name]
        row = self.rows[place]
        if row.op is Op.CONSTANT:
            return Number(self.parameters[row.parameter], dimension)
        return Number(
            math.nan, dimension, is_difference=name in self.differences,
            is_condition=Op.LESS <= row.op <= Op.NOT, row=place, uses=self.uses[name],
        )  # fmt: skip

    def is_conditional(self, name: str) -> bool:
        """Return whether ``name``, or a derived channel in it, has a value under a condition only.

        That is so after the key `where`, and behind `hold` until its condition holds.
        """
        behind = (self.rows[place] for place in self.behind(name))
        return any(
            row.op is Op.HOLD or (row.op is Op.WHERE and self._is_unknown(row.c)) for row in behind
        )

    def behind(self, name: str) -> set[int]:
        """Return the rows from which the derived channel ``name`` is computed, its own included."""
        waiting, found = [self.outputs[name]], set[int]()
        while waiting:
            place = waiting.pop()
            if place not in found:
                found.add(place)
                row = self.rows[place]
                if row.op not in (Op.CONSTANT, Op.INPUT, Op.PARAMETER):
                    waiting += (row.a, row.b, row.c)  # one that it lacks is row 0
        return found

    def _is_unknown(self, place: int) -> bool:
        row = self.rows[place]
        return row.op is Op.CONSTANT and math.isnan(self.parameters[row.parameter])

    def groups(self) -> dict[str, list[str]]:
        """Return the names of the channels of each group, in order."""
        found: dict[str, list[str]] = {}
        for name in self.outputs:
            found.setdefault(name.partition(".")[0], []).append(name)
        return found


@dataclass
class Builder:
    """Collects the rows of a graph; what is computed already is not computed again.

    ``period_s`` is that of the cycle.
    """

    period_s: float
    rows: list[GraphRow] = field(default_factory=list)
    parameters: list[float] = field(default_factory=list)
    states: int = 0
    inputs: list[str] = field(default_factory=list)
    swept: list[str] = field(default_factory=list)
    #: Whether what is added now begins anew with each trial.
    reset: bool = False
    _known: dict[tuple[object, ...], int] = field(default_factory=dict)

    @classmethod
    def after(cls, graph: Graph, period_s: float) -> Self:
        """Return a builder that adds to ``graph``: its rows stay what they are."""
        rows, parameters = list(graph.rows), list(graph.parameters)
        inputs, swept = list(graph.inputs), list(graph.swept)
        return cls(period_s, rows, parameters, graph.states, inputs, swept)

    def input(self, name: str, dimension: Dimension, uses: frozenset[str]) -> Number:
        """Return a channel or a setpoint of a device as a part of a formula."""
        if name not in self.inputs:
            self.inputs.append(name)
        row = self._row(Op.INPUT, (self.inputs.index(name),))
        return Number(math.nan, dimension, row=row, uses=uses)

    def parameter(self, name: str, kind: Number) -> Number:
        """Return a parameter of the dimension of ``kind``, of which each trial has its value."""
        if not self.rows:  # the row of operands that an operation lacks
            self.place(Number(0.0))
        if name not in self.swept:
            self.swept.append(name)
        row = self._row(Op.PARAMETER, (self.swept.index(name),))
        return Number(math.nan, kind.dimension, is_difference=kind.is_difference, row=row)

    def place(self, number: Number) -> int:
        """Return the row that has ``number``."""
        if number.row is not None:
            return number.row
        return self._row(Op.CONSTANT, parameters=(number.value,))

    def add(
        self, op: Op, numbers: tuple[Number, ...], parameters: tuple[float, ...], size: int
    ) -> int:
        """Return the row of an operation on ``numbers``."""
        return self._row(op, tuple(map(self.place, numbers)), parameters, size)

    def _row(
        self,
        op: Op,
        operands: tuple[int, ...] = (),
        parameters: tuple[float, ...] = (),
        size: int = 0,
    ) -> int:
        """Return the row of an operation: a new one, or that with the same result."""
        memory = MEMORY.get(op, 0)
        reset = self.reset and bool(memory)
        key = (op, operands, parameters, size, reset)
        if key in self._known:
            return self._known[key]
        a, b, c = (*operands, 0, 0, 0)[:3]
        self.rows.append(GraphRow(op, a, b, c, len(self.parameters), self.states, size, reset))
        self.parameters += parameters
        if memory:
            self.states += memory + (2 * size if op in WINDOWED else 0)
        self._known[key] = len(self.rows) - 1
        return self._known[key]


#: Operations that keep the samples of a window, with their times.
WINDOWED = frozenset({Op.MEAN, Op.RMS, Op.HIGHEST, Op.LOWEST, Op.DELAY})
