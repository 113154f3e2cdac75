"""Reads what a procedure measures in each trial (``measure``) and what that must be (``accept``).

The same reading serves the check before a run and the evaluation of a recording: it needs names and
units of channels, and no device.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from rigd.config.document import KeyPath
from rigd.config.problems import suggest
from rigd.config.quantities import rate_unit, read_uncertainty
from rigd.config.rig import RigConfig
from rigd.model.channels import ECHO
from rigd.model.units import dimension_text, parse_unit
from rigd.procedure.conditions.condition_text import describe_window
from rigd.procedure.conditions.conditions import ChannelFinder, check_reachable, read_comparisons
from rigd.procedure.expression import Scope
from rigd.procedure.program import (
    Condition,
    CycleProgram,
    Events,
    Measure,
    Recorded,
    Step,
    TrialLimit,
    TrialPlan,
    Window,
)
from rigd.procedure.reader import Reader
from rigd.procedure.source import BoundsSource, MeasureSource, PartSource, ProcedureSource

#: What is read off the samples of a channel, in the order of the file's keys.
KINDS: Final = (
    "channel", "mean", "max", "min", "peak_to_peak", "rms", "std", "slope", "final", "duration",
)  # fmt: skip
#: Those that are differences of values, and never offset.
_DIFFERENCES: Final = frozenset({"peak_to_peak", "std"})
_WINDOW: Final = re.compile(
    r"\s*(?:(?P<side>first|last)\s+(?P<span>[^A-Za-z\s].*?)"
    r"|(?P<begin>[^A-Za-z\s].*?)\s+to\s+(?P<end>.+?))(?:\s+of\s+(?P<step>\S.*?))?\s*$"
)
_STEP: Final = re.compile(r"\s*[A-Za-z][\w /.-]*$")


def measured_channels(measures: Collection[Measure]) -> frozenset[str]:
    """Return the channels that ``measures`` need."""
    rows = [row for item in measures for event in events_of(item) for row in event]
    own = {item.channel for item in measures if item.channel}
    return frozenset(own | {condition.channel for row in rows for condition in row})


def events_of(measure: Measure) -> tuple[Events, ...]:
    """Return the conditions that a measure needs, those of its window too."""
    window = measure.window
    events = (measure.since, measure.when, window.since, window.until, window.holds)
    return tuple(event for event in events if event)


def read_measures(
    reader: Reader,
    source: ProcedureSource,
    steps: Sequence[str],
    scope: Scope,
    finder: ChannelFinder,
    reachable: Callable[[KeyPath, Condition], None] = lambda path, condition: None,
    names: Collection[str] | None = None,
) -> tuple[Measure, ...]:
    """Return the measures of a trial with ``scope``; problems are noted.

    ``steps`` are the names of the steps of a trial. With ``names``, only these measures.
    """
    found = []
    for name, item in source.measure.items():
        if names is not None and name not in names:
            continue
        measure = _Reading(reader, name, item, steps, scope, finder, reachable).measure(
            source.accept.get(name)
        )
        found += [] if measure is None else [measure]
    for name in source.accept:
        if name not in source.measure:
            reader.note_key(("accept", name), f"the procedure measures no {name!r}",
                            suggest(name, source.measure))  # fmt: skip
    return tuple(found)


def check_measures(
    reader: Reader,
    source: ProcedureSource,
    rig: RigConfig,
    record: Mapping[str, Recorded],
    scopes: Sequence[Scope],
    trials: Sequence[TrialPlan],
) -> tuple[Measure, ...]:
    """Return the measures of the first trial after a check of those of every trial of a sweep.

    Problems are noted, each once: a channel that the rig lacks or does not record among them, and a
    window longer than its step. ``scopes`` are the points of the sweep, ``trials`` all of its
    trials.
    """
    steps = [step.step for step in source.trial.steps if hasattr(step, "step")]
    names = [
        f"{device.name}.{item}"
        for device in rig.devices.values()
        for item in (
            *(channel.name for channel in device.channels),
            *(f"{setpoint.name}{ECHO}" for setpoint in device.setpoints),
        )
    ]
    finder = ChannelFinder(rig.name, rig.recorded, lambda: names)
    no_limits: tuple[TrialLimit, ...] = ()

    def reachable(path: KeyPath, condition: Condition) -> None:
        check_reachable(reader, path, 0, condition, rig, no_limits)

    before = len(reader.problems.found)
    first: tuple[Measure, ...] = ()
    for scope in scopes[:1]:
        first = read_measures(reader, source, steps, scope, finder, reachable)
    following = [
        name for name, item in source.measure.items()
        if "${" in f"{item} {source.accept.get(name)}"
    ]  # fmt: skip
    repeats = max(1, len(trials) // max(1, len(scopes)))
    lasting = {(trial.number - 1) // repeats: longest(trial.steps) for trial in trials}
    for point, scope in enumerate(scopes):
        if len(reader.problems.found) > before:
            break  # the other trials have the same problems
        if point and following:
            own = read_measures(reader, source, steps, scope, finder, reachable, following)
            changed = {item.name: item for item in own}
            measures = tuple(changed.get(item.name, item) for item in first)
        else:
            measures = first
        for measure in measures:
            _check_length(reader, measure, lasting.get(point, {}))
    for measure in first:
        path = ("measure", measure.name)
        for channel in sorted(measured_channels([measure])):
            device = channel.partition(".")[0]
            recorded = record.get(device)
            if recorded is None:
                reader.note_key(path, f"{channel} is not recorded",
                                f"add '{device}: 1' to 'record'")  # fmt: skip
            elif recorded.capture is not None or not _covers(recorded, measure.window, steps):
                message = f"{channel} is not recorded in all of {describe_window(measure.window)}"
                hint = "record it always, or during the steps that are measured"
                reader.note_key(path, message, hint)
    return first


def longest(steps: Sequence[Step]) -> dict[str, float]:
    """Return how long each step of a trial takes at most, in s, if nobody holds it."""
    return {
        segment.name: min(
            math.inf if given is None else given
            for given in (segment.duration_s, segment.timeout_s)
        )
        for step in steps
        if isinstance(step, CycleProgram)
        for segment in step.segments
    }


def _check_length(reader: Reader, measure: Measure, lasting: Mapping[str, float]) -> None:
    """Note a window that ends after its step does, or begins before it."""
    window = measure.window
    most_s = math.inf if window.step is None else lasting.get(window.step, math.inf)
    needed_s = window.last_s if window.last_s is not None else window.end_s
    if math.isinf(needed_s):
        needed_s = window.begin_s
    if needed_s > most_s + 1e-9:
        reader.note(
            ("measure", measure.name, "during"),
            f"step {window.step!r} takes {most_s:g} s at most, less than the {needed_s:g} s that "
            "are measured",
            f"measure {most_s:g} s of it at most, or make the step longer",
        )


def _covers(recorded: Recorded, window: Window, steps: Sequence[str]) -> bool:
    during = recorded.during
    needed = steps if window.step is None else [window.step]
    return not during or all(step in during for step in needed)


@dataclass(frozen=True)
class _Reading:
    reader: Reader
    name: str
    source: MeasureSource
    steps: Sequence[str]
    scope: Scope
    finder: ChannelFinder
    reachable: Callable[[KeyPath, Condition], None]

    @property
    def path(self) -> KeyPath:
        return ("measure", self.name)

    def measure(self, accept: Sequence[str] | BoundsSource | None) -> Measure | None:
        kind = self._kind()
        if kind is None:
            return None
        channel = "" if kind == "duration" else str(getattr(self.source, kind))
        unit, default = self._units(kind, channel)
        when, since = self._events(kind)
        window = self._window()
        if unit is None:
            return None
        shown = self._shown_unit(kind, unit, default)
        is_difference = kind in _DIFFERENCES
        systematic = read_uncertainty(
            self.reader.document, (*self.path, "u"), self.source.u, parse_unit(shown),
            self.reader.problems,
        )  # fmt: skip
        low, high = self._bounds(accept, shown, is_difference=is_difference)
        return Measure(
            self.name, kind, channel, window, shown, when, since, systematic, low, high,
            accept is not None, self.source.doc,
        )  # fmt: skip

    def _kind(self) -> str | None:
        given = [kind for kind in KINDS if getattr(self.source, kind) is not None]
        if len(given) != 1:
            found = ", ".join(given) or "none"
            self.reader.note_key(self.path, f"expected exactly one kind of measure, found {found}",
                                 f"give one of {', '.join(KINDS)}")  # fmt: skip
            return None
        if given[0] == "channel" and self.source.when is None:
            self.reader.note_key(self.path, "key 'when' is missing: a value is read at an event",
                                 "add 'when: ...', or write 'mean', 'max', 'final' in place of "
                                 "'channel'")  # fmt: skip
            return None
        if given[0] != "channel" and self.source.when is not None:
            self.reader.note_key((*self.path, "when"), f"'when' has no effect beside {given[0]!r}",
                                 "select a part of the trial by 'during'")  # fmt: skip
        return given[0]

    def _units(self, kind: str, name: str) -> tuple[str | None, str]:
        """Return the SI unit of the measure, None if the channel is unknown, and the default."""
        if kind == "duration":
            return "s", "s"
        channel = self.finder.channel(self.reader, (*self.path, kind), name)
        if channel is None:
            return None, ""
        if kind == "slope":
            return rate_unit(channel.unit), rate_unit(channel.unit)
        shown = parse_unit(channel.shown_in)
        from_zero = kind in _DIFFERENCES or kind == "rms"
        return channel.unit, shown.difference().symbol if from_zero else shown.symbol

    def _shown_unit(self, kind: str, unit: str, default: str) -> str:
        text = self.source.unit
        if text is None:
            return default
        path = (*self.path, "unit")
        try:
            shown = parse_unit(text)
        except ValueError as error:
            self.reader.note(path, str(error), f"such as {unit}")
            return unit
        if not shown.same_kind(parse_unit(unit)):
            kinds = dimension_text(parse_unit(unit).dimension)
            message = f"the measure is in {kinds}, not in {text}"
            self.reader.note(path, message, f"write 'unit: {unit}'")
            return unit
        if shown.offset and (kind in _DIFFERENCES or kind == "rms"):
            name = kind.replace("_", " ")
            message = f"a {name} cannot be in {text}, which has a zero of its own"
            self.reader.note(path, message, f"write 'unit: {shown.difference()}'")
            return unit
        return text

    def _events(self, kind: str) -> tuple[Events, Events]:
        if kind == "channel":
            return self._rows(("when",), self.source.when or []), ()
        if self.source.duration is None:
            return (), ()
        given = self.source.duration
        since = self._rows(("duration", "from"), given.since) if given.since else ()
        return self._rows(("duration", "to"), given.to), since

    def _rows(self, keys: KeyPath, texts: Sequence[str]) -> Events:
        path = (*self.path, *keys)
        rows = read_comparisons(self.reader, path, texts, self.scope, self.finder)
        for row in rows:
            for condition in row:
                self.reachable(path, condition)
        return rows

    def _window(self) -> Window:
        during, path = self.source.during, (*self.path, "during")
        if not isinstance(during, PartSource):
            return self._part(path, during)
        if not (during.since or during.to or during.holds):
            self.reader.note_key(path, "it has no condition",
                                 "give 'from', 'to' or 'while'; a step or times alone are a text, "
                                 "such as 'last 2 s of STEP'")  # fmt: skip
        if during.nth > 1 and not during.since:
            self.reader.note_key((*path, "nth"), "'nth' has no effect without 'from'",
                                 "add 'from: CONDITION'")  # fmt: skip
        if during.holds and self.source.duration is not None:
            self.reader.note_key((*path, "while"), "'while' has no effect beside 'duration'",
                                 "select a part of the trial by 'from' and 'to'")  # fmt: skip
        since, until, holds = (
            self._rows(("during", key), texts or [])
            for key, texts in (("from", during.since), ("to", during.to), ("while", during.holds))
        )
        part = self._part((*path, "of"), during.of)
        return replace(part, since=since, until=until, holds=holds, nth=during.nth)

    def _part(self, path: KeyPath, text: str | None) -> Window:
        if text is None:
            return Window()
        if text.strip() in self.steps:
            return Window(text.strip())
        match = _WINDOW.match(text)
        if match is None:
            if _STEP.match(text):
                self._find_step(path, text.strip())
            else:
                self.reader.note(path, f"cannot read {text!r} as a part of the trial",
                                 "write a step, 'last 2 s of STEP', '1 s to 3 s of STEP', or "
                                 "'1 s to 3 s' of the trial")  # fmt: skip
            return Window()
        step = match["step"]
        if step is not None:
            self._find_step(path, step)
        if match["side"] is not None:
            span = self._time(path, match["span"])
            if match["side"] == "last":
                return Window(step, last_s=span)
            return Window(step, end_s=span)
        begin = self._time(path, match["begin"], zero=True)
        end = self._time(path, match["end"])
        if end <= begin:
            self.reader.note(path, f"{match['end']} does not follow {match['begin']}",
                             "give the earlier time first")  # fmt: skip
        return Window(step, begin, end)

    def _find_step(self, path: KeyPath, step: str) -> None:
        if step not in self.steps:
            self.reader.note(path, f"no step of the trial is called {step!r}",
                             suggest(step, self.steps))  # fmt: skip

    def _time(self, path: KeyPath, text: str, *, zero: bool = False) -> float:
        value = self.reader.number(path, text, "s", self.scope)
        if value < 0 or (value == 0 and not zero):
            self.reader.note(path, f"{text} must be above 0 s")
        return value

    def _bounds(
        self, accept: Sequence[str] | BoundsSource | None, unit: str, *, is_difference: bool
    ) -> tuple[float, float]:
        if accept is None:
            return -math.inf, math.inf
        path: KeyPath = ("accept", self.name)
        if isinstance(accept, BoundsSource):
            given: list[tuple[KeyPath, str | None]] = [
                (("min",), accept.min),
                (("max",), accept.max),
            ]
            if accept.min is None and accept.max is None:
                self.reader.note_key(path, "'accept' bounds nothing", "give min, max or both")
        else:
            given = [((index,), text) for index, text in enumerate(accept)]
        read = self.reader.difference if is_difference else self.reader.number
        low, high = (
            None if text is None else read((*path, *key), text, unit, self.scope)
            for key, text in given
        )
        low = -math.inf if low is None else low
        high = math.inf if high is None else high
        if low >= high:
            self.reader.note(path, "the first bound is not below the second", "swap the two")
        return low, high
