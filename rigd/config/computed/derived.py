"""Reads derived channels: formulas to a graph, each group of channels to a device of the rig."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final

from rigd.computed.derived.driver import DERIVED, Derived, DerivedConfig
from rigd.computed.derived.formula import Find, no_names, read_formula
from rigd.computed.derived.graph import Builder, Graph
from rigd.config.document import Document, KeyPath
from rigd.config.problems import Problems, suggest
from rigd.config.rig import DeviceConfig, RigConfig
from rigd.config.source import DerivedSource
from rigd.language.dimensions import alike, fits, plain
from rigd.language.functions import FUNCTIONS, Call
from rigd.language.number import ExpressionError, Number, number_in
from rigd.language.operations import Op
from rigd.language.rows import operate
from rigd.model.channels import ECHO, Channel
from rigd.model.units import Unit, dimension_text, parse_unit, si_symbol

#: Name of the recorded stream that belongs to the cycle itself.
_CYCLE: Final = "cycle"


def add_derived(
    document: Document,
    sources: Mapping[str, DerivedSource],
    rig: RigConfig,
    problems: Problems,
    named: Find = no_names,
) -> RigConfig:
    """Return ``rig`` with the derived channels of ``sources``; problems are noted.

    One graph computes them and those that the rig has. ``named`` knows what is written ``${name}``.
    """
    if not sources:
        return rig
    for name in sources:
        group = name.partition(".")[0]
        if group in rig.devices or group in (_CYCLE, "rig"):
            problems.add(
                document.key_place(("derived", name)),
                f"{group} is {_owner(rig, group)}: its channels cannot be computed",
                f"choose another name before the dot, such as '{group}_derived'",
            )
            return rig
    before = _graph_of(rig)
    reader = _Reader(document, sources, rig, problems, before, named)
    found = {name: reader.channel(name) for name in sources}
    if any(term is None for term in found.values()):
        return rig
    terms = {name: term for name, term in found.items() if term is not None}
    outputs = {name: reader.builder.place(term) for name, term in terms.items()}
    graph = Graph(
        rows=tuple(reader.builder.rows),
        parameters=tuple(reader.builder.parameters),
        states=reader.builder.states,
        inputs=tuple(reader.builder.inputs),
        outputs=before.outputs | outputs,
        uses=before.uses | {name: term.uses for name, term in terms.items()},
        differences=before.differences
        | {name for name, term in terms.items() if term.is_difference},
    )
    devices = dict(rig.devices)
    for group, names in graph.groups().items():
        known = devices.get(group)
        if known is None:
            devices[group] = _device(group, names, graph, reader)
        elif isinstance(known.config, DerivedConfig):
            config = known.config.model_copy(update={"graph": graph})
            devices[group] = replace(known, config=config)
    return replace(rig, devices=devices)


def _owner(rig: RigConfig, group: str) -> str:
    device = rig.devices.get(group)
    if device is None:
        return "taken"
    return "a group of this rig" if device.driver == DERIVED else "a device of this rig"


def _graph_of(rig: RigConfig) -> Graph:
    """Return the graph of the derived channels that ``rig`` has; an empty one without."""
    configs = (device.config for device in rig.devices.values())
    graphs = (config.graph for config in configs if isinstance(config, DerivedConfig))
    return next(graphs, Graph((), (), 0, (), {}, {}))


def _device(group: str, names: list[str], graph: Graph, reader: _Reader) -> DeviceConfig:
    config = DerivedConfig(
        graph=graph,
        group=group,
        channels=tuple(reader.described(name) for name in names),
    )
    return DeviceConfig(
        name=group,
        driver=DERIVED,
        driver_class=Derived,
        config=config,
        declaration=Derived.declare(config),
        limits={},
    )


@dataclass
class _Reader:
    document: Document
    sources: Mapping[str, DerivedSource]
    rig: RigConfig
    problems: Problems
    before: Graph  #: that of the derived channels which the rig has
    named: Find
    builder: Builder = field(init=False)
    _known: dict[str, Number | None] = field(default_factory=dict)
    _units: dict[str, str] = field(default_factory=dict)
    _display: dict[str, str] = field(default_factory=dict)
    _open: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.builder = Builder.after(self.before, self.rig.period_ns * 1e-9)

    def described(self, name: str) -> Channel:
        """Return the derived channel ``name`` with its unit."""
        source = self.sources[name]
        text = source.doc or source.formula
        display = self._display.get(name, "")
        return Channel(name.partition(".")[2], self._units[name], text, display=display)

    def channel(self, name: str) -> Number | None:
        """Return the term of the derived channel ``name``; None with its problem noted."""
        if name not in self._known:
            self._open.append(name)
            self._known[name] = self._read(name, self.sources[name])
            self._open.pop()
        return self._known[name]

    def _read(self, name: str, source: DerivedSource) -> Number | None:
        path: KeyPath = ("derived", name)
        term = self._formula((*path, "is"), source.formula, source)
        condition = None
        if source.where is not None:
            condition = self._formula((*path, "where"), source.where, source)
            if condition is None:
                return None
            if not condition.is_condition:
                self.problems.add(
                    self.document.place((*path, "where")), "expected a condition",
                    "compare with '<' or '>', such as 'load.force > 5 N'",
                )  # fmt: skip
                return None
        if term is None:
            return None
        unit = self._unit(path, name, term, source)
        if unit is None:
            return None
        if not alike(unit.dimension, term.dimension):  # an angle: lengths cancelled
            term = replace(term, dimension=unit.dimension)
        if condition is not None:
            unknown = Number(math.nan, term.dimension)
            term = operate(
                self.builder, Op.WHERE, condition, term, unknown, at=0, dimension=term.dimension
            )
        return term if source.lowpass is None else self._filtered(path, source, term)

    def _filtered(self, path: KeyPath, source: DerivedSource, term: Number) -> Number | None:
        """Return ``term`` behind the filter of the key `lowpass`."""
        place = (*path, "lowpass")
        given = self._formula(place, source.lowpass or "", source)
        if given is None:
            return None
        call = Call(self.builder, (0, 0), "such as 'lowpass: 50 Hz'")
        self.builder.reset = source.reset == "trial"
        try:
            return FUNCTIONS["lowpass"].make(call, (term, given))
        except ExpressionError as error:
            self.problems.add(self.document.place(place), str(error), error.hint)
            return None

    def _formula(self, path: KeyPath, text: str, source: DerivedSource) -> Number | None:
        def find(name: str, offset: int) -> Number:
            term = self._find(name, offset)
            self.builder.reset = source.reset == "trial"  # another channel was read meanwhile
            return term

        self.builder.reset = source.reset == "trial"
        try:
            return read_formula(text, self.builder, find, self.named)
        except ExpressionError as error:
            place = self.document.inside(path, error.offset)
            self.problems.add(place, str(error), error.hint, lacks=error.lacks)
        except _Noted:
            pass  # the problem of the other channel is noted at its own place
        return None

    def _find(self, name: str, offset: int) -> Number:
        if name in self._open:
            circle = " uses ".join((*self._open[self._open.index(name) :], name))
            raise ExpressionError(
                f"a channel cannot be computed from itself: {circle}", offset,
                "use delay(...) of a measured channel, or another quantity",
            )  # fmt: skip
        if name in self.sources:
            term = self.channel(name)
            if term is None:
                raise _Noted
            return replace(term, dimension=plain(term.dimension))  # that of its unit
        if name.startswith("rig."):
            constant = self.rig.constants.get(name.removeprefix("rig."))
            if constant is None:
                known = [f"rig.{item}" for item in self.rig.constants]
                raise ExpressionError(
                    f"unknown constant {name!r}", offset, suggest(name, known), lacks=name
                )
            return number_in(constant.value, constant.unit)
        channel = self.rig.recorded(name)
        if channel is None:
            known = [
                f"{device.name}.{item}"
                for device in self.rig.devices.values()
                for item in (
                    *(channel.name for channel in device.channels),
                    *(f"{setpoint.name}{ECHO}" for setpoint in device.setpoints),
                )
            ]
            raise ExpressionError(
                f"unknown channel {name!r}", offset, suggest(name, [*known, *self.sources]),
                lacks=name,
            )  # fmt: skip
        if name in self.before.outputs:
            return self.before.number(name, parse_unit(channel.unit).dimension)
        uses = frozenset({name}) if self.rig.channel(name) else frozenset[str]()
        return self.builder.input(name, parse_unit(channel.unit).dimension, uses)

    def _unit(self, path: KeyPath, name: str, term: Number, source: DerivedSource) -> Unit | None:
        """Keep the unit of the channel and return it; None if it does not fit the formula."""
        self._units[name] = si_symbol(plain(term.dimension))
        if source.unit is None:
            return parse_unit(self._units[name])
        place = self.document.place((*path, "unit"))
        try:
            unit = parse_unit(source.unit)
        except ValueError as error:
            self.problems.add(place, str(error))
            return None
        if not fits(term.dimension, unit.dimension, of_arc=term.of_arc):
            self.problems.add(
                place,
                f"the formula gives {dimension_text(plain(term.dimension))}, not {source.unit}",
                f"write 'unit: {self._units[name]}', or correct the formula",
            )  # fmt: skip
            return None
        if unit.is_si:
            self._units[name] = source.unit
        else:
            self._units[name] = si_symbol(unit.dimension)
            self._display[name] = source.unit
        return unit


class _Noted(Exception):
    """A channel that a formula uses is wrong; its own problem is noted."""
