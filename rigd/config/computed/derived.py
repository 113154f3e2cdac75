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
from rigd.model.constants import Constant
from rigd.model.units import Unit, dimension_text, parse_unit, si_symbol

#: Name of the recorded stream that belongs to the cycle itself.
_CYCLE: Final = "cycle"


@dataclass(frozen=True)
class FormulaNames:
    """What formulas may name: channels by name with those that are ``measured``, and constants.

    ``period_s`` is the shortest time between two values.
    """

    channels: Mapping[str, Channel]
    measured: frozenset[str]
    constants: Mapping[str, Constant]
    period_s: float


@dataclass(frozen=True)
class ByTrial:
    """Parameters that differ by trial: the dimension of each, and ``values`` in SI by trial."""

    kinds: Mapping[str, Number]
    values: Mapping[int, Mapping[str, float]]


@dataclass(frozen=True)
class ReadGraph:
    """A graph, and the channels that were read into it, with their units."""

    graph: Graph
    channels: Mapping[str, Channel]


ALL_ALIKE: Final = ByTrial({}, {})
_NO_GRAPH: Final = Graph((), (), 0, (), {}, {})


def add_derived(
    document: Document,
    sources: Mapping[str, DerivedSource],
    rig: RigConfig,
    problems: Problems,
    named: Find = no_names,
    by_trial: ByTrial = ALL_ALIKE,
) -> RigConfig:
    """Return ``rig`` with the derived channels of ``sources``; problems are noted.

    One graph computes them and those that the rig has. ``named`` knows what is written ``${name}``,
    but for what differs ``by_trial``.
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
    found = read_graph(document, sources, _names(rig), problems, named, by_trial, before)
    if found is None:
        return rig
    devices = dict(rig.devices)
    for group, names in found.graph.groups().items():
        known = devices.get(group)
        if known is None:
            channels = tuple(found.channels[name] for name in names)
            devices[group] = _device(group, channels, found.graph)
        elif isinstance(known.config, DerivedConfig):
            config = known.config.model_copy(update={"graph": found.graph})
            devices[group] = replace(known, config=config)
    return replace(rig, devices=devices)


def read_graph(
    document: Document,
    sources: Mapping[str, DerivedSource],
    names: FormulaNames,
    problems: Problems,
    named: Find = no_names,
    by_trial: ByTrial = ALL_ALIKE,
    before: Graph = _NO_GRAPH,
) -> ReadGraph | None:
    """Return the graph of ``before`` and of ``sources``; None if one has a problem, which is noted.

    ``sources`` stand in ``document`` below `derived`.
    """
    reader = _Reader(document, sources, names, problems, before, named, by_trial)
    found = {name: reader.channel(name) for name in sources}
    if any(term is None for term in found.values()):
        return None
    terms = {name: term for name, term in found.items() if term is not None}
    outputs = {name: reader.builder.place(term) for name, term in terms.items()}
    builder = reader.builder
    graph = Graph(
        rows=tuple(builder.rows),
        parameters=tuple(builder.parameters),
        states=builder.states,
        inputs=tuple(builder.inputs),
        outputs=before.outputs | outputs,
        uses=before.uses | {name: term.uses for name, term in terms.items()},
        differences=before.differences
        | {name for name, term in terms.items() if term.is_difference},
        swept=tuple(builder.swept),
        trials={
            number: tuple(values[name] for name in builder.swept)
            for number, values in by_trial.values.items()
            if builder.swept
        },
    )
    return ReadGraph(graph, {name: reader.described(name) for name in sources})


def _names(rig: RigConfig) -> FormulaNames:
    """Return what formulas of ``rig`` may name."""
    measured = {
        f"{device.name}.{item.name}": item
        for device in rig.devices.values()
        for item in device.channels
    }
    written = {
        f"{device.name}.{item.name}{ECHO}": item
        for device in rig.devices.values()
        for item in device.setpoints
    }
    return FormulaNames(
        {**written, **measured}, frozenset(measured), rig.constants, rig.period_ns * 1e-9
    )


def _owner(rig: RigConfig, group: str) -> str:
    device = rig.devices.get(group)
    if device is None:
        return "taken"
    return "a group of this rig" if device.driver == DERIVED else "a device of this rig"


def _graph_of(rig: RigConfig) -> Graph:
    """Return the graph of the derived channels that ``rig`` has; an empty one without."""
    configs = (device.config for device in rig.devices.values())
    graphs = (config.graph for config in configs if isinstance(config, DerivedConfig))
    return next(graphs, _NO_GRAPH)


def _device(group: str, channels: tuple[Channel, ...], graph: Graph) -> DeviceConfig:
    config = DerivedConfig(graph=graph, group=group, channels=channels)
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
    names: FormulaNames
    problems: Problems
    before: Graph  #: that of the derived channels which the rig has
    named: Find
    by_trial: ByTrial
    builder: Builder = field(init=False)
    _known: dict[str, Number | None] = field(default_factory=dict)
    _units: dict[str, str] = field(default_factory=dict)
    _display: dict[str, str] = field(default_factory=dict)
    _open: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.builder = Builder.after(self.before, self.names.period_s)

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
            return read_formula(text, self.builder, find, self._named)
        except ExpressionError as error:
            place = self.document.inside(path, error.offset)
            self.problems.add(place, str(error), error.hint, lacks=error.lacks)
        except _Noted:
            pass  # the problem of the other channel is noted at its own place
        return None

    def _named(self, name: str, offset: int) -> Number:
        kind = self.by_trial.kinds.get(name)
        return self.named(name, offset) if kind is None else self.builder.parameter(name, kind)

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
            constant = self.names.constants.get(name.removeprefix("rig."))
            if constant is None:
                known = [f"rig.{item}" for item in self.names.constants]
                raise ExpressionError(
                    f"unknown constant {name!r}", offset, suggest(name, known), lacks=name
                )
            return number_in(constant.value, constant.unit)
        channel = self.names.channels.get(name)
        if channel is None:
            raise ExpressionError(
                f"unknown channel {name!r}", offset,
                suggest(name, [*self.names.channels, *self.sources]), lacks=name,
            )  # fmt: skip
        dimension = parse_unit(channel.unit).dimension
        if name in self.before.outputs:
            return self.before.number(name, dimension)
        return self.builder.input(name, dimension, frozenset({name}) & self.names.measured)

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
