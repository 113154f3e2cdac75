"""Reads the measures of recordings: those of their own procedure, or of another one."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TypeAlias

from rigd.analysis.measures.ranges import Sensors, changed_formula
from rigd.analysis.measures.reading import PlayedSteps, TrialReader
from rigd.analysis.measures.result import (
    MeasureResult,
    TrialReading,
    UsedConstants,
    summary_of,
)
from rigd.analysis.recordings.corrections import scope_of, with_derived_of
from rigd.analysis.recordings.duplicates import refuse_same_file, refuse_same_trials
from rigd.config.loader import parse_constants
from rigd.config.problems import Problems
from rigd.language.number import number_in
from rigd.model.constants import Constant
from rigd.model.errors import ConfigError, DataError
from rigd.procedure.conditions.conditions import ChannelFinder
from rigd.procedure.expression import Value
from rigd.procedure.loader import Procedure, parse_procedure
from rigd.procedure.measures import measured_channels, read_measures
from rigd.procedure.parameters import read_tables
from rigd.procedure.program import Measure
from rigd.procedure.reader import Reader
from rigd.procedure.source import MoveSource
from rigd.record import Recording, TrialInfo
from rigd.record.read.derived import recorded_sources

#: The setpoints of a trial, by name: its value in SI, or its word.
_Point: TypeAlias = tuple[tuple[str, str], ...]


def measured(recordings: Sequence[Recording], procedure: Procedure | None = None) -> MeasureResult:
    """Return the measures of all trials, those with equal setpoints together.

    ``procedure`` replaces those that the recordings carry. Of several attempts at a trial the last
    complete one counts.

    Raises:
        ConfigError: a measure does not fit a recording; names every problem with its place.
        DataError: there is nothing to measure, the recordings do not measure the same or are of
            different rigs, or one is there twice or beside a copy of itself.
        RecordingError: a recording is damaged.
    """
    refuse_same_file([recording.path for recording in recordings])
    _refuse_different_rigs(recordings)
    if procedure is not None:
        recordings = [with_derived_of(recording, procedure) for recording in recordings]
    found: dict[tuple[str, _Point], list[tuple[Measure, TrialReading]]] = {}
    shown: dict[_Point, dict[str, str]] = {}
    formulas: dict[str, dict[str, str]] = {}
    first: Procedure | None = None
    for recording in recordings:
        own = procedure or recorded_procedure(recording)
        first = first or own
        if not own.source.measure:
            raise DataError(
                f"the procedure of {recording.path} measures nothing",
                hint="give one with a 'measure' block: --plan PROCEDURE",
            )
        if (own.source.measure, own.source.accept) != (first.source.measure, first.source.accept):
            raise DataError(
                f"{recording.path} measures otherwise than {recordings[0].path}",
                hint="measure them one by one, or give --plan for all",
            )
        played = PlayedSteps.of(recording, _steps(own))
        sensors = Sensors.of(recording, _formulas(recording, own))
        for trial, measures in _trials(recording, own):
            reader = TrialReader(recording, trial, played, sensors)
            key = _point(trial)
            shown.setdefault(key, {name: trial.text(name) for name in trial.parameters})
            for measure in measures:
                found.setdefault((measure.name, key), []).append((measure, reader.reading(measure)))
                own_formulas = sensors.formulas_behind(measured_channels([measure]))
                formulas[measure.name] = _together(
                    formulas.get(measure.name, {}), own_formulas, measure.name, recording.path
                )
    if first is None or not found:
        raise DataError("no trial began in these recordings: there is nothing to measure")
    every = [items[0][0] for items in found.values()]
    refuse_same_trials(recordings, measured_channels(every))
    order = list(first.source.measure)
    names = varied(list(shown.values()))
    summaries = [
        summary_of(
            items[0][0],
            {name: text for name, text in shown[key].items() if name in names},
            [reading for _, reading in items],
            shown[key],
            {name: dict(key)[name] for name in shown[key]},
        )
        for (_, key), items in found.items()
    ]
    summaries.sort(key=lambda item: order.index(item.measure.name))
    constants = _used_constants(recordings[0], first, every)
    return MeasureResult(tuple(summaries), constants, formulas)


def _together(
    before: Mapping[str, str], formulas: Mapping[str, str], measure: str, path: Path
) -> dict[str, str]:
    """Return the formulas behind a measure, of a recording and of those before it.

    Raises:
        DataError: one of them is another one: the mean over both is that of none.
    """
    channel = changed_formula(before, formulas)
    if channel is not None:
        raise DataError(
            f"{path} measures {measure} otherwise than the recordings before it: {channel} is "
            f"{formulas[channel]!r}, before {before[channel]!r}",
            hint="measure the recordings of each formula by themselves",
        )
    return {**formulas, **before}


def _point(trial: TrialInfo) -> _Point:
    """Return the setpoints of a trial, however its recording orders and shows them."""
    values = trial.parameters.items()
    return tuple(
        sorted((name, f"{v:.9g}" if isinstance(v, float) else str(v)) for name, v in values)
    )


def _refuse_different_rigs(recordings: Sequence[Recording]) -> None:
    """Refuse recordings of different rigs: the mean over them is that of none.

    Raises:
        DataError: there are two.
    """
    rigs = [(recording, _rig(recording)) for recording in recordings]
    for recording, rig in rigs:
        first, expected = rigs[0]
        if rig != expected:
            raise DataError(
                f"{recording.path} is of the rig {rig!r}, {first.path} of the rig {expected!r}",
                hint="measure the recordings of each rig by themselves",
            )


def _rig(recording: Recording) -> str:
    return recording.metadata.get("run", {}).get("rig", "")


def _used_constants(
    recording: Recording, procedure: Procedure, measures: Sequence[Measure]
) -> tuple[UsedConstants, ...]:
    """Return what each measure rests on, of the constants in the rig file of a recording."""
    known, sensors = _constants(recording), Sensors.of(recording, _formulas(recording, procedure))
    found = {}
    for measure in measures:
        names = [name for name in sensors.constants(measure.channel) if name in known]
        exact = tuple(name for name in names if known[name].u is None)
        if names:
            uncertain = tuple(name for name in names if name not in exact)
            found[measure.name] = UsedConstants(measure.name, uncertain, exact)
    return tuple(found.values())


def measured_if_any(recording: Recording) -> MeasureResult | None:
    """Return the measures of a recording; None if no trial began or its procedure has none.

    Raises:
        ConfigError: its procedure cannot be read.
        RecordingError: it is damaged.
    """
    if "procedure.yaml" not in recording.attachments or not len(recording.trials):
        return None
    procedure = recorded_procedure(recording)
    return measured([recording], procedure) if procedure.source.measure else None


def recorded_procedure(recording: Recording) -> Procedure:
    """Return the procedure that a recording carries.

    Raises:
        DataError: it carries none.
        ConfigError: it carries one of another version of rigd, which cannot be read.
    """
    attached = recording.attachments.get("procedure.yaml")
    if attached is None:
        raise DataError(
            f"{recording.path} carries no procedure",
            hint="`rigd measure FILE --plan PROCEDURE` measures it by another one",
        )
    return parse_procedure(attached.data.decode(errors="replace"), Path("procedure.yaml"))


def formulas_behind(recording: Recording, channels: Collection[str]) -> dict[str, str]:
    """Return the formulas of derived channels that ``channels`` of a recording rest on, by name.

    Of a rig file or procedure of another version of rigd nothing is known.
    """
    own = None
    with suppress(ConfigError, DataError):
        own = recorded_procedure(recording)
    return Sensors.of(recording, _formulas(recording, own)).formulas_behind(channels)


def _steps(procedure: Procedure) -> list[str]:
    return [step.step for step in procedure.source.trial.steps if isinstance(step, MoveSource)]


def varied(points: Sequence[Mapping[str, str]]) -> tuple[str, ...]:
    """Return the parameters, in order, that differ between ``points`` or that one lacks."""
    names = dict.fromkeys(name for point in points for name in point)
    return tuple(name for name in names if len({point.get(name) for point in points}) > 1)


def _formulas(recording: Recording, procedure: Procedure | None) -> dict[str, str]:
    """Return the formulas of the derived channels of a recording, and of ``procedure``."""
    of_procedure = {} if procedure is None else procedure.source.derived
    found = {**recorded_sources(recording), **of_procedure}
    return {name: item.formula for name, item in found.items()}


def _constants(recording: Recording) -> dict[str, Constant]:
    """Return the constants of a recording's rig; of another version of rigd they are unknown."""
    rig = recording.attachments.get("rig.yaml")
    if rig is None:
        return {}
    try:
        return dict(parse_constants(rig.data.decode(errors="replace"), Path("rig.yaml")))
    except ConfigError:
        return {}


def _trials(
    recording: Recording, procedure: Procedure
) -> list[tuple[TrialInfo, tuple[Measure, ...]]]:
    """Return each trial that counts, in order, with its measures.

    Raises:
        ConfigError: a measure does not fit the recording.
    """
    source, problems = procedure.source, Problems()
    shared: dict[str, Value] = {
        f"rig.{name}": number_in(item.value, item.unit)
        for name, item in _constants(recording).items()
    }
    known = Sensors.of(recording, {}).channels
    name = _rig(recording) or str(recording.path)
    finder = ChannelFinder(name, known.get, lambda: list(known))
    own = {table: item.unit or "1" for table, item in source.tables.items()}
    reader = Reader(procedure.document, problems)
    found = []
    last = {trial.info.number: trial.info for trial in recording.trials if not trial.complete}
    last |= {trial.info.number: trial.info for trial in recording.trials if trial.complete}
    for _, trial in sorted(last.items()):
        scope = {**shared, **scope_of(trial, without=own)}
        for parameter, item in source.parameters.items():
            if parameter in scope or item.default is None:
                continue
            path = ("parameters", parameter, "default")
            read = reader.word if item.choices else reader.value
            value = read(path, item.default, scope)
            scope |= {} if value is None else {parameter: value}
        scope |= read_tables(reader, source, scope)
        measures = read_measures(reader, source, _steps(procedure), scope, finder)
        problems.raise_any()
        found.append((trial, measures))
    # Only what is lost of the streams that are measured counts.
    streams = {name.partition(".")[0] for _, measures in found
               for name in measured_channels(measures)}  # fmt: skip
    judged = {item.info.start_ns: item.info for item in recording.trials_for(streams)}
    return [(judged[trial.start_ns], measures) for trial, measures in found]
