"""Compiles the steps of a procedure file for a rig."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

from rigd.computed.controllers.chain import commands
from rigd.config.document import KeyPath
from rigd.config.loader import channel_names
from rigd.config.problems import suggest
from rigd.config.quantities import check_inside
from rigd.config.rig import RigConfig
from rigd.language.tokens import NAME
from rigd.model.channels import Channel
from rigd.procedure.conditions.conditions import read_until
from rigd.procedure.expression import Scope, Value
from rigd.procedure.profiles.profiles import ConstantProfile
from rigd.procedure.program import (
    CycleProgram,
    Fault,
    Hold,
    OnTimeout,
    Segment,
    Step,
    TrialLimit,
)
from rigd.procedure.reader import Reader
from rigd.procedure.source import (
    FaultSource,
    HoldSource,
    MoveSource,
    ParameterSource,
    PromptSource,
    TrialLimitSource,
)
from rigd.procedure.steps.prompts import ChangeablePlant, changeable_plants, read_prompt
from rigd.procedure.steps.setpoints import read_setpoint

#: Values of ``once_per`` parameters when a prompt was last shown, by the place of the prompt.
Shown = dict[KeyPath, tuple[Value | None, ...]]


@dataclass
class StepCompiler:
    """Compiles lists of steps; a step whose names have the same values is compiled once.

    While ``remembers`` is false, prompts shown once per value do not count as shown.
    """

    reader: Reader
    rig: RigConfig
    parameters: Mapping[str, ParameterSource]
    remembers: bool = True
    _names: dict[KeyPath, tuple[str, ...]] = field(default_factory=dict)
    _segments: dict[tuple[object, ...], Segment] = field(default_factory=dict)
    _shown: Shown = field(default_factory=dict)

    def compile(
        self,
        path: KeyPath,
        sources: Sequence[MoveSource | PromptSource | FaultSource],
        scope: Scope,
        limits: tuple[TrialLimit, ...] = (),
    ) -> tuple[Step, ...]:
        """Return the steps of ``sources``, which are at ``path``; problems are noted.

        Consecutive moves become a single program.
        """
        steps: list[Step] = []
        segments: list[Segment] = []
        for index, source in enumerate(sources):
            where = (*path, index)
            if not self._plays(where, source.when, scope):
                if self.remembers:  # other prompts have changed meanwhile what this one set up
                    self._shown.pop(where, None)
                continue
            if isinstance(source, MoveSource):
                segments.append(self._segment(where, source, scope, limits))
                continue
            if isinstance(source, PromptSource) and not self._is_due(where, source, scope):
                continue
            if segments:
                steps.append(CycleProgram(tuple(segments), limits))
                segments = []
            if isinstance(source, PromptSource):
                plants = () if source.changes is None else self._plants
                steps.append(read_prompt(self.reader, where, source, scope, self.rig, plants))
            else:
                steps.append(_read_fault(self.reader, where, source, scope, self.rig))
        if segments:
            steps.append(CycleProgram(tuple(segments), limits))
        return tuple(steps)

    @cached_property
    def _plants(self) -> tuple[ChangeablePlant, ...]:
        return tuple(changeable_plants(self.rig))

    def limits(
        self, path: KeyPath, sources: Mapping[str, TrialLimitSource], scope: Scope
    ) -> tuple[TrialLimit, ...]:
        """Return the per-trial limits at ``path``; problems are noted."""
        limits = []
        for name, source in sources.items():
            where = (*path, name)
            channel = self.rig.channel(name)
            if channel is None:
                place, known = self.reader.document.key_place(where), channel_names(self.rig)
                self.reader.problems.add_lacking(place, self.rig.name, "channel", name, known)
                continue
            low, high = (
                default if text is None else self._bound((*where, key), text, channel, scope)
                for key, text, default in (
                    ("low", source.low, -math.inf),
                    ("high", source.high, math.inf),
                )
            )
            if source.low is None and source.high is None:
                self.reader.note_key(where, f"the limit of {name} has no bound",
                                     "give 'low', 'high' or both")  # fmt: skip
            if low >= high:
                message = f"low {source.low} is not below high {source.high}"
                self.reader.note((*where, "low"), message, "swap the two")
            limits.append(TrialLimit(name, low, high, channel.shown_in))
        return tuple(limits)

    def _bound(self, path: KeyPath, text: str, channel: Channel, scope: Scope) -> float:
        """Return a bound of a trial limit in SI; one that is never reached is noted."""
        value = self.reader.number(path, text, channel.shown_in, scope)
        ends, unit = (channel.low, channel.high), channel.shown_in
        return check_inside(self.reader.document, path, value, ends, unit,
                            "what the channel can measure", self.reader.problems)  # fmt: skip

    def _plays(self, path: KeyPath, when: Mapping[str, Sequence[str]], scope: Scope) -> bool:
        plays = True
        for name, words in when.items():
            where = (*path, "when", name)
            parameter = self.parameters.get(name)
            if parameter is None or parameter.choices is None:
                known = [key for key, item in self.parameters.items() if item.choices]
                self.reader.note_key(
                    where, f"{name!r} is not a parameter with choices", suggest(name, known)
                )
                continue
            for word in words:
                if word not in parameter.choices:
                    self.reader.note(where, f"{word!r} is not a choice of {name}",
                                     suggest(word, parameter.choices))  # fmt: skip
            if name not in scope:
                hint = f"the sweep varies {name}: it has a value only inside 'trial'"
                self.reader.note_key(where, f"{name} has no value here", hint)
            plays = plays and scope.get(name) in words
        return plays

    def _is_due(self, path: KeyPath, source: PromptSource, scope: Scope) -> bool:
        if not source.once_per:
            return True
        for name in source.once_per:
            if name not in scope:
                self.reader.note((*path, "once_per"), f"unknown name {name!r}",
                                 suggest(name, scope))  # fmt: skip
        values = tuple(scope.get(name) for name in source.once_per)
        due = self._shown.get(path) != values
        if self.remembers:
            self._shown[path] = values
        return due

    def _segment(
        self, path: KeyPath, source: MoveSource, scope: Scope, limits: tuple[TrialLimit, ...]
    ) -> Segment:
        names = self._names.get(path)
        if names is None:
            names = tuple(sorted(set(NAME.findall(repr(source)))))
            self._names[path] = names
        key = (path, limits, *(scope.get(name) for name in names))
        segment = self._segments.get(key)
        if segment is None:
            segment = self._segments[key] = self._new_segment(path, source, scope, limits)
        return segment

    def _new_segment(
        self, path: KeyPath, source: MoveSource, scope: Scope, limits: tuple[TrialLimit, ...]
    ) -> Segment:
        setpoints = {}
        for name, item in source.set.items():
            where = (*path, "set", name)
            profile = read_setpoint(self.reader, where, name, item, scope, self.rig)
            if profile is not None:
                setpoints[self.rig.setpoint_name(name)] = profile
        self._check_controllers((*path, "set"), source.set)
        until = (
            read_until(self.reader, (*path, "until"), source.until, scope, self.rig, limits)
            if source.until is not None
            else ()
        )
        self._check_end(path, source)
        segment = Segment(
            name=source.step,
            setpoints=setpoints,
            until=until,
            duration_s=self.reader.time((*path, "for"), source.wait, scope),
            timeout_s=self.reader.time((*path, "timeout"), source.timeout, scope),
            on_timeout=OnTimeout(source.on_timeout),
            hold=None if source.hold is None else self._hold(path, source.hold, scope),
        )
        self._check_held(path, segment)
        return segment

    def _hold(self, path: KeyPath, source: HoldSource, scope: Scope) -> Hold:
        """Return what the step at ``path`` does while it is held; problems are noted."""
        path = (*path, "hold")
        if path[0] == "finish":
            self.reader.note_key(path, "a step of 'finish' cannot be held: the run is about to end",
                                 "remove it")  # fmt: skip
        setpoints = {}
        for name, text in source.set.items():
            full, where = self.rig.setpoint_name(name), (*path, "set", name)
            if text.strip() == "rest" and self.rig.setpoint(full) is not None:
                device, _, short = full.partition(".")
                setpoints[full] = self.rig.devices[device].limits[short].rest
                continue
            profile = read_setpoint(self.reader, where, name, text, scope, self.rig)
            if isinstance(profile, ConstantProfile):
                setpoints[full] = profile.value
        self._check_controllers((*path, "set"), source.set)
        longest_s = self.reader.time((*path, "timeout"), source.timeout, scope)
        return Hold(setpoints, math.nan if longest_s is None else longest_s)

    def _check_controllers(self, path: KeyPath, given: Collection[str]) -> None:
        """Note a setpoint that this step sets beside a controller that commands it."""
        loops = self.rig.loops
        names = {self.rig.setpoint_name(name): name for name in given}
        for full, name in names.items():
            for commanded in commands(loops, full):
                if commanded in names:
                    self.reader.note_key(
                        (*path, names[commanded]),
                        f"the step sets {names[commanded]} and {name}, which commands it",
                        "leave one of them out: a controller ends where its output is set",
                    )

    def _check_end(self, path: KeyPath, source: MoveSource) -> None:
        place = (*path, "step")
        if source.until is None and source.wait is None:
            self.reader.note(place, f"the step {source.step!r} has no end",
                             "add 'for: 1 s', or 'until: ...' with a 'timeout'")  # fmt: skip
        if source.until is not None and source.timeout is None and source.wait is None:
            self.reader.note((*path, "until"), f"the step {source.step!r} could wait forever",
                             "add 'timeout: 10 s'")  # fmt: skip
        if source.timeout is not None and source.until is None:
            self.reader.note_key((*path, "timeout"), "a timeout without 'until' has no effect",
                                 "remove it, or use 'for'")  # fmt: skip
        if "on_timeout" in source.model_fields_set and source.timeout is None:
            message = "on_timeout without 'timeout' has no effect"
            self.reader.note_key((*path, "on_timeout"), message, "add a timeout, or remove it")

    def _check_held(self, path: KeyPath, segment: Segment) -> None:
        """Note a condition that must hold for longer than the step at ``path`` lasts."""
        ends = [end for end in (segment.duration_s, segment.timeout_s) if end is not None]
        for condition in (item for row in segment.until for item in row):
            if ends and condition.for_s > min(ends):
                self.reader.note(
                    (*path, "until"),
                    f"the step {segment.name!r} ends after {min(ends):.6g} s, before a condition "
                    f"of its 'until' can have held for {condition.for_s:.6g} s",
                    "give the step more time, or the condition less",
                )


def _read_fault(
    reader: Reader, path: KeyPath, source: FaultSource, scope: Scope, rig: RigConfig
) -> Fault:
    """Return the fault at ``path``; problems are noted.

    Only the simulation knows its devices and faults: preflight checks them.
    """
    if rig.simulation is None:
        reader.note_key(
            (*path, "fault"),
            f"the devices of the rig {rig.name} are not simulated at the wire: they cannot "
            "show faults",
            "remove the step, or use a rig with `simulation:`, such as wire-1",
        )
    shown = source.fault
    after_s = reader.time((*path, "fault", "after"), shown.after, scope)
    for_s = reader.time((*path, "fault", "for"), shown.lasting, scope)
    options = {name: _scalar(text) for name, text in shown.options.items()}
    return Fault(shown.part, shown.fault, after_s or 0.0, for_s, options)


def _scalar(text: str) -> int | float | bool | str:
    """Return a scalar of a file as in YAML 1.2: whole number, number, truth value, or text."""
    if text in ("true", "false"):
        return text == "true"
    for kind in (lambda: int(text, 0), lambda: float(text)):
        try:
            return kind()
        except ValueError:
            continue
    return text
