"""Reads observers: matrices with the units that follow from states and channels, to a filter."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

from rigd.computed.observers.driver import OBSERVER, Observer, ObserverConfig
from rigd.config.binding import bind
from rigd.config.computed.observer_channels import Finder, published
from rigd.config.computed.observer_models import LINEAR, ModelReader
from rigd.config.document import Document, KeyPath
from rigd.config.problems import Problems
from rigd.config.rig import DeviceConfig, RigConfig
from rigd.config.source import DerivedSource, LinearSource, ObserverSource
from rigd.language.dimensions import alike, over, plain, times
from rigd.model.channels import Channel
from rigd.model.units import (
    NO_DIMENSION,
    Dimension,
    dimension_text,
    parse_quantity,
    parse_unit,
    si_symbol,
)

if TYPE_CHECKING:  # a rig file without observers is checked without numpy
    from rigd.computed.observers.linear import Floats, LinearPlan

_SECOND: Final = parse_unit("s").dimension
#: Name of the recorded stream that belongs to the cycle itself.
_CYCLE: Final = "cycle"


def add_observers(
    document: Document,
    sources: Mapping[str, ObserverSource],
    derived: Mapping[str, DerivedSource],
    rig: RigConfig,
    problems: Problems,
) -> RigConfig:
    """Return ``rig`` with the observers of ``sources``; problems are noted.

    They stand before the channels of ``derived``, which may be computed from them.
    """
    added: dict[str, DeviceConfig] = {}
    for name, source in sources.items():
        path: KeyPath = ("observers", name)
        if name in rig.devices or name in (_CYCLE, "rig"):
            problems.add(
                document.key_place(path),
                f"{name} is {'a device of this rig' if name in rig.devices else 'taken'}",
                f"choose another name, such as '{name}_filter'",
            )
            continue
        config = _read(document, path, source, derived, rig, problems)
        if config is not None:
            added[name] = DeviceConfig(
                name=name,
                driver=OBSERVER,
                driver_class=Observer,
                config=config,
                declaration=Observer.declare(config),
                limits={},
            )
    return replace(rig, devices={**rig.devices, **added})


def _read(
    document: Document,
    path: KeyPath,
    source: ObserverSource,
    derived: Mapping[str, DerivedSource],
    rig: RigConfig,
    problems: Problems,
) -> ObserverConfig | None:
    options: dict[str, Any] = dict(source.model_extra or {})
    if source.model != LINEAR:
        reader = ModelReader(document, path, source.model, options, derived, rig, problems)
        return reader.config()
    given = bind(document, LinearSource, problems, path, data=options)
    return (
        None if given is None else _Linear(document, path, given, derived, rig, problems).config()
    )


@dataclass
class _Linear:
    """Reads one linear filter; every problem is noted at its place."""

    document: Document
    path: KeyPath
    source: LinearSource
    derived: Mapping[str, DerivedSource]
    rig: RigConfig
    problems: Problems

    def config(self) -> ObserverConfig | None:
        """Return the filter; None with its problems noted."""
        source, before = self.source, len(self.problems.found)
        states = [self._state(name, unit) for name, unit in source.states.items()]
        inputs = [self._channel("inputs", index) for index in range(len(source.inputs))]
        measured = [self._channel("measured", index) for index in range(len(source.measured))]
        channels = self._channels(states, measured)
        if len(self.problems.found) > before:
            return None
        plan = self._plan(
            [state.dimension for state in states],
            [_dimension(channel) for channel in inputs],
            [_dimension(channel) for channel in measured],
        )
        if plan is None:
            return None
        return ObserverConfig(
            plan=plan,
            channels=channels,
            inputs=tuple(source.inputs),
            measured=tuple(source.measured),
            period_ns=self.rig.period_ns,
            lost_ns=round(source.lost_after * 1e9),
            each_trial=source.reset == "trial",
        )

    @property
    def _finder(self) -> Finder:
        return Finder(
            self.document,
            self.path,
            self.derived,
            self.rig,
            self.problems,
            self.source.lost_after,
            by_default="lost_after" not in self.source.model_fields_set,
        )

    def _note(self, path: KeyPath, message: str, hint: str | None = None) -> None:
        self.problems.add(self.document.place((*self.path, *path)), message, hint)

    def _state(self, name: str, text: str) -> _State:
        try:
            unit = parse_unit(text)
        except ValueError as error:
            self._note(("states", name), str(error))
            return _State(name, "1", NO_DIMENSION)
        if not unit.is_si:
            self._note(
                ("states", name),
                f"{text} is not an SI unit: channels are recorded in SI units",
                f"write '{name}: {si_symbol(unit.dimension)}'",
            )
            return _State(name, si_symbol(unit.dimension), unit.dimension)
        return _State(name, text, unit.dimension)

    def _channel(self, key: str, index: int) -> Channel:
        """Return a channel of the list ``key``, or a stand-in with its problem noted."""
        name = getattr(self.source, key)[index]
        channel = self._finder.find((key, index), name, measured=key == "measured")
        if getattr(self.source, key).index(name) != index:
            self._note((key, index), f"{name} stands twice in `{key}`")
        return channel

    def _channels(
        self, states: Sequence[_State], measured: Sequence[Channel]
    ) -> tuple[Channel, ...]:
        """Return the channels of the observer, in the order of its row."""
        known = [Channel(item.name, item.unit, "estimated state") for item in states]
        found = published(known, list(zip(self.source.measured, measured, strict=True)))
        names = [channel.name for channel in found]
        for name in self.source.states:
            if names.count(name) > 1:
                place = self.document.key_place((*self.path, "states", name))
                self.problems.add(
                    place, f"the observer has a channel {name} of its own", "rename the state"
                )
        return found

    def _plan(
        self, states: list[Dimension], inputs: list[Dimension], measured: list[Dimension]
    ) -> LinearPlan | None:
        """Return the filter of the matrices; their entries have the units that must follow."""
        before, source = len(self.problems.found), self.source
        per = NO_DIMENSION if source.time == "discrete" else over(NO_DIMENSION, _SECOND)
        a = self._matrix("a", source.a, [[times(over(i, j), per) for j in states] for i in states])
        b = self._matrix("b", source.b, [[times(over(i, j), per) for j in inputs] for i in states])
        c = self._matrix("c", source.c, [[over(i, j) for j in states] for i in measured])
        d = self._matrix("d", source.d, [[over(i, j) for j in inputs] for i in measured])
        squares = [[times(i, j) for j in states] for i in states]
        q = self._covariance("q", source.q, [[times(item, per) for item in row] for row in squares])
        r = self._covariance("r", source.r, [[times(i, j) for j in measured] for i in measured])
        p0 = self._covariance("p0", source.p0, squares)
        x0 = self._entries(("x0",), source.x0, states)
        if len(self.problems.found) > before:
            return None
        import numpy as np

        from rigd.computed.observers.linear import LinearPlan, discretised, unseen

        count, period_s = len(states), self.rig.period_ns * 1e-9
        f, g, noise = np.array(a), np.array(b).reshape(count, len(inputs)), np.array(q)
        if source.time == "continuous":
            with np.errstate(over="ignore", invalid="ignore"):
                f, g, noise = discretised(f, g, noise, period_s)
        if not all(np.isfinite(item).all() for item in (f, g, noise)):
            self._note(("a",), "its rates are too fast for the cycle: the states overflow in one")
            return None
        lost = unseen(f, np.array(c), period_s, list(source.states))
        if lost:
            self._note(
                ("c",),
                f"the measured channels do not show {' and '.join(lost)}, which does not die out "
                "by itself: its standard deviation would grow without end",
                "measure another channel, leave the state out, or let it decay in `a`",
            )
            return None
        return LinearPlan(
            f=_plain(f), g=_plain(g), h=_plain(np.array(c)), d=_plain(np.array(d)),
            q=_plain(noise), r=_plain(np.array(r)), x0=tuple(x0), p0=_plain(np.array(p0)),
        )  # fmt: skip

    def _matrix(
        self, key: str, given: Sequence[Sequence[str]] | None, units: list[list[Dimension]]
    ) -> list[list[float]]:
        """Return the matrix ``key`` in SI; zeros if it may be left out and is."""
        rows, columns = len(units), len(units[0])
        if given is None:
            if key == "b" and columns:
                self._note((), "key 'b' is missing", "how the inputs change the states")
            return [[0.0] * columns for _ in units]
        sizes = {len(row) for row in given}
        if len(given) != rows or sizes != {columns}:
            found = "x".join([str(len(given)), "/".join(str(size) for size in sorted(sizes))])
            self._note(
                (key,), f"`{key}` must have {rows} rows of {columns}, found {found}",
                _SHAPES[key],
            )  # fmt: skip
            return [[math.nan] * columns for _ in units]
        return [self._entries((key, i), row, units[i]) for i, row in enumerate(given)]

    def _covariance(
        self, key: str, given: Sequence[Sequence[str] | str], units: list[list[Dimension]]
    ) -> list[list[float]]:
        """Return a covariance in SI: a symmetric matrix, or its diagonal as a list."""
        before, size = len(self.problems.found), len(units)
        matrix = [[0.0] * size for _ in units]
        if all(isinstance(item, str) for item in given):
            diagonal = self._entries((key,), [str(item) for item in given],
                                     [units[i][i] for i in range(size)])  # fmt: skip
            for i, value in enumerate(diagonal):
                matrix[i][i] = value
        elif any(isinstance(item, str) for item in given):
            self._note((key,), f"`{key}` is either a list of its diagonal or a list of rows")
        else:
            matrix = self._matrix(key, [list(row) for row in given], units)
        if len(self.problems.found) > before:
            return matrix
        import numpy as np

        from rigd.computed.observers.linear import is_covariance, unequal_place

        found = np.array(matrix)
        place = unequal_place(found)
        if place is not None:
            i, j = place
            self._note(
                (key, i, j), f"`{key}` is not symmetric: row {i + 1}, column {j + 1} has "
                f"{matrix[i][j]:g}, row {j + 1}, column {i + 1} has {matrix[j][i]:g}",
            )  # fmt: skip
        elif not is_covariance(found, definite=key == "r"):
            wanted = "only positive" if key == "r" else "no negative"
            self._note(
                (key,), f"`{key}` is not a covariance: it must have {wanted} eigenvalues",
                "give variances: squares of standard deviations",
            )  # fmt: skip
        return matrix

    def _entries(
        self, path: KeyPath, given: Sequence[str], units: Sequence[Dimension]
    ) -> list[float]:
        """Return the numbers of a row in SI; a bare number has the unit that follows."""
        if len(given) != len(units):
            self._note(path, f"{len(units)} numbers needed, found {len(given)}")
            return [math.nan] * len(units)
        return [
            self._entry((*path, index), text, unit)
            for index, (text, unit) in enumerate(zip(given, units, strict=True))
        ]

    def _entry(self, path: KeyPath, text: str, wanted: Dimension) -> float:
        """Return the number at ``path`` in SI; NaN, with a note, if it is not of ``wanted``."""
        try:
            found = parse_quantity(text)
            if path[0] != "x0":  # a state; all others are factors and variances
                found = found.as_difference()
        except ValueError as error:
            self._note(path, str(error))
            return math.nan
        bare = found.unit.symbol == "1"
        if not bare and not alike(found.unit.dimension, wanted):
            self._note(
                path, f"{text} is not of the kind of {si_symbol(plain(wanted))}",
                f"the states and channels give it {dimension_text(plain(wanted))}",
            )  # fmt: skip
        return found.value


@dataclass(frozen=True)
class _State:
    name: str
    unit: str
    dimension: Dimension


#: What the rows and columns of a matrix are, for a hint.
_SHAPES: Final = {
    "a": "a row and a column for each state",
    "b": "a row for each state, a column for each input",
    "c": "a row for each measured channel, a column for each state",
    "d": "a row for each measured channel, a column for each input",
    "q": "a row and a column for each state, or a list of its diagonal",
    "r": "a row and a column for each measured channel, or a list of its diagonal",
    "p0": "a row and a column for each state, or a list of its diagonal",
}


def _dimension(channel: Channel) -> Dimension:
    return parse_unit(channel.unit).dimension


def _plain(matrix: Floats) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(row) for row in matrix.tolist())
