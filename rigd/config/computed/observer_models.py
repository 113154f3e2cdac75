"""Reads observers whose model is a plug-in: options, constants and channels, each at its place."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from rigd.computed.observers.driver import ObserverConfig
from rigd.computed.observers.model import Known, ObserverModel, ObserverOptions, Wanted
from rigd.config.binding import bind
from rigd.config.computed.observer_channels import Finder, published
from rigd.config.document import Document, KeyPath
from rigd.config.problems import Problems, suggest
from rigd.config.quantities import read_quantity, read_uncertainty
from rigd.config.registry import OBSERVERS, find, installed
from rigd.config.rig import RigConfig
from rigd.config.source import DerivedSource, ObserverConstants
from rigd.model.channels import Channel
from rigd.model.constants import Constant
from rigd.model.errors import ConfigError
from rigd.model.units import parse_unit
from rigd.sdk import WrongEntries

#: The model that is part of rigd.
LINEAR: Final = "linear"
_OF_RIG: Final = re.compile(r"\$\{rig\.([a-z][a-z0-9_]*)\}")


@dataclass(frozen=True)
class ModelReader:
    """Reads one observer of a model that is found by its entry point; problems are noted."""

    document: Document
    path: KeyPath
    model: str
    given: Mapping[str, Any]
    derived: Mapping[str, DerivedSource]
    rig: RigConfig
    problems: Problems

    def config(self) -> ObserverConfig | None:
        """Return the observer; None with its problems noted."""
        before = len(self.problems.found)
        model = self._model()
        if model is None:
            return None
        own = {key: value for key, value in self.given.items() if key != "constants"}
        options = bind(self.document, model.Config, self.problems, self.path, data=own)
        constants = self._constants(model)
        if options is None:
            return None
        finder = Finder(
            self.document,
            self.path,
            self.derived,
            self.rig,
            self.problems,
            options.lost_after,
            by_default="lost_after" not in options.model_fields_set,
        )
        inputs, measured = model.inputs(options), model.measured(options)
        self._channels(finder, inputs, measured=False)
        found = self._channels(finder, measured, measured=True)
        if len(self.problems.found) > before:
            return None
        return self._planned(model, options, constants, inputs, measured, found)

    def _model(self) -> type[ObserverModel] | None:
        place = self.document.place((*self.path, "model"))
        try:
            return find(OBSERVERS, ObserverModel, "observer", self.model)
        except ConfigError as error:
            known = self.model in installed(OBSERVERS)
            hint = error.hint if known else suggest(self.model, [LINEAR, *installed(OBSERVERS)])
            self.problems.add(place, error.message, hint)
            return None

    def _planned(
        self, model: type[ObserverModel], options: ObserverOptions,
        constants: Mapping[str, Known], inputs: Sequence[Wanted], measured: Sequence[Wanted],
        found: Sequence[Channel],
    ) -> ObserverConfig | None:  # fmt: skip
        try:
            plan = model.plan(options, constants, self.rig.period_ns * 1e-9)
            texts = tuple(model.files(options).items())
        except WrongEntries as error:
            for keys, text in error.problems:
                self._note(keys, text)
            return None
        except ConfigError as error:
            place = error.place or self.document.place(self.path)
            self.problems.add(place, error.message, error.hint)
            return None
        names = [item.channel for item in measured]
        return ObserverConfig(
            plan=plan,
            channels=published(model.states, list(zip(names, found, strict=True))),
            inputs=tuple(item.channel for item in inputs),
            measured=tuple(names),
            period_ns=self.rig.period_ns,
            lost_ns=round(options.lost_after * 1e9),
            each_trial=options.reset == "trial",
            texts=texts,
        )

    def _channels(
        self, finder: Finder, wanted: Sequence[Wanted], *, measured: bool
    ) -> list[Channel]:
        found = []
        for item in wanted:
            before = len(self.problems.found)
            channel = finder.find((item.key,), item.channel, measured=measured)
            if len(self.problems.found) == before and not parse_unit(channel.unit).same_kind(
                parse_unit(item.unit)
            ):
                self._note(
                    (item.key,), f"{item.channel} is in {channel.unit}, expected {item.unit}"
                )
            found.append(channel)
        return found

    def _constants(self, model: type[ObserverModel]) -> dict[str, Known]:
        """Return the constants of ``model``: of the observer, else those of the rig by name."""
        document, problems, rig = self.document, self.problems, self.rig
        given: Mapping[str, Any] = {}
        if "constants" in self.given:
            data = {"constants": self.given["constants"]}
            source = bind(document, ObserverConstants, problems, self.path, data=data)
            given = {} if source is None else source.constants
        for name in given:
            if name not in model.constants:
                place = document.key_place((*self.path, "constants", name))
                text = f"model {self.model} has no constant {name!r}"
                problems.add(place, text, suggest(name, model.constants))
        known = {}
        for name, unit in model.constants.items():
            path: KeyPath = (*self.path, "constants", name)
            if name in given:
                known[name] = self._constant(path, given[name], unit)
            elif name in rig.constants:
                known[name] = self._of_rig(("constants", name), rig.constants[name], unit)
            elif name not in model.optional_constants:
                where = self.path if not given else (*self.path, "constants")
                problems.add(
                    document.place(where), f"constant {name!r} is missing",
                    f"add it to the rig's `constants`, or write `constants: {{{name}: QUANTITY}}` "
                    f"({unit}) or `{name}: ${{rig.NAME}}` in the observer",
                )  # fmt: skip
        return known

    def _constant(self, path: KeyPath, given: Any, unit: str) -> Known:
        text = given if isinstance(given, str) else given.value
        at = path if isinstance(given, str) else (*path, "value")
        u = None if isinstance(given, str) else given.u
        reference = _OF_RIG.fullmatch(text.strip())
        if reference:
            constant = self.rig.constants.get(reference[1])
            if constant is None:
                hint = suggest(reference[1], self.rig.constants)
                self._note_place(at, f"the rig has no constant {reference[1]!r}", hint)
                return Known(math.nan)
            known = self._of_rig(at, constant, unit)
            value = known.value
        else:
            value = read_quantity(self.document, at, text, unit, self.problems)
            known = Known(value)
        if u is None:
            return known
        found = read_uncertainty(self.document, (*path, "u"), u, parse_unit(unit), self.problems)
        return known if found is None else Known(value, found.of(value))

    def _of_rig(self, path: KeyPath, constant: Constant, unit: str) -> Known:
        if not constant.unit.same_kind(parse_unit(unit)):
            self._note_place(path, f"{path[-1]} is in {constant.unit}, expected {unit}")
        return Known(constant.value, 0.0 if constant.u is None else constant.u.of(constant.value))

    def _note(self, keys: KeyPath, message: str, hint: str | None = None) -> None:
        self._note_place((*self.path, *keys), message, hint)

    def _note_place(self, path: KeyPath, message: str, hint: str | None = None) -> None:
        self.problems.add(self.document.place(path), message, hint)
