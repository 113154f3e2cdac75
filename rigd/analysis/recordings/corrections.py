"""Replaces constants of a recording before its evaluation: single ones, or all from a procedure."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

from rigd.analysis.plan import check_plan, find_analysis, of_kind
from rigd.analysis.recordings.source import Correction, RecordedSweep, needed_trials
from rigd.config.loader import parse_constants
from rigd.config.problems import Problems, suggest
from rigd.language.number import Number, number_in
from rigd.model.constants import Constant, Uncertainty, parse_uncertainty
from rigd.model.errors import ConfigError, DataError
from rigd.model.units import format_difference, format_quantity, parse_quantity, parse_unit
from rigd.procedure.expression import Value
from rigd.procedure.identify import read_plan
from rigd.procedure.loader import Procedure
from rigd.procedure.parameters import choices_of, read_tables
from rigd.procedure.program import IdentifyPlan
from rigd.procedure.reader import Reader
from rigd.record import Recording, TrialInfo

_BETWEEN: Final = re.compile(r"\s*(?:±|\+/?-)\s*")


@dataclass(frozen=True)
class Corrections:
    """The values that replace those in the recordings.

    ``constants`` maps names to texts such as ``50 mm`` or ``50 mm +- 0.1 mm``. Of ``procedure``
    the `identify` block is taken, before them.
    """

    constants: Mapping[str, str] = field(default_factory=dict)
    procedure: Procedure | None = None

    @property
    def plan(self) -> IdentifyPlan | None:
        """What ``procedure`` identifies, and by which groups; the rest waits for a recording."""
        source = None if self.procedure is None else self.procedure.source.identify
        if source is None:
            return None
        return IdentifyPlan(source.model, {}, {}, tuple(source.group_by))


def corrected(sweep: RecordedSweep, corrections: Corrections) -> RecordedSweep:
    """Return ``sweep`` with ``corrections`` applied; its ``corrections`` list what differs.

    Raises:
        ConfigError: a name is unknown, a quantity is wrong or of another kind, or the procedure
            does not fit the recording.
        DataError: a signal of the procedure was not recorded.
    """
    changed = sweep
    if corrections.procedure is not None:
        recording = with_derived_of(sweep.recording, corrections.procedure)
        changed = _replanned(replace(sweep, recording=recording), corrections.procedure)
    for name, text in corrections.constants.items():
        changed = replace(changed, plan=_with_constant(changed.plan, name, text))
    return replace(changed, corrections=_differences(sweep, changed, corrections.constants))


def _with_constant(plan: IdentifyPlan, name: str, text: str) -> IdentifyPlan:
    """Return ``plan`` with another value of one constant, which keeps its uncertainty if need be.

    Raises:
        ConfigError: the model has no such constant, or the quantity is wrong or of another kind.
    """
    needs = find_analysis(plan.model).needs
    known = {*plan.constants, *needs.constants, *needs.optional_constants}
    if name not in known:
        message = f"--set {name}: model {plan.model} has no such constant"
        raise ConfigError(message, hint=suggest(name, known))
    written, *further = _BETWEEN.split(text, maxsplit=1)
    uncertainties = dict(plan.uncertainties)
    try:
        value = parse_quantity(written)
        recorded, needed = plan.units.get(name), needs.constant_units.get(name)
        if recorded and needed and not of_kind(recorded, needed):
            recorded = None  # the correction may mend it
        expected = parse_unit(recorded or needed or value.unit.symbol)
        if not value.unit.same_kind(expected):
            given = "no unit" if value.unit.symbol == "1" else f"the unit {value.unit}"
            where = "recorded in" if recorded else "the model takes it in"
            raise ValueError(f"{written!r} has {given}, {where} {expected}")
        for u in further:
            uncertainties[name] = parse_uncertainty(u, value.unit)
    except ValueError as error:
        raise ConfigError(
            f"--set {name}={text}: {error}", hint="write '50 mm', or '50 mm +- 0.1 mm'"
        ) from error
    return replace(
        plan,
        constants={**plan.constants, name: value.value},
        uncertainties=uncertainties,
        units={**plan.units, name: value.unit.symbol},
    )


def _replanned(sweep: RecordedSweep, procedure: Procedure) -> RecordedSweep:
    """Return ``sweep`` with constants, signals and published values of ``procedure``.

    Names in it are constants of the recorded rig, parameters of the recorded trials, and the
    procedure's own tables.
    """
    source, document = procedure.source, procedure.document
    place = document.key_place(("identify",))
    if source.identify is None or source.identify.model != sweep.plan.model:
        model = "nothing" if source.identify is None else f"model {source.identify.model}"
        raise ConfigError(
            f"procedure {procedure.name} identifies {model}, {sweep.path} model {sweep.plan.model}",
            place=place,
            hint="give a procedure whose `identify` block has that model",
        )
    of_rig = _constants_of(sweep.recording)
    shared: dict[str, Value] = {
        f"rig.{name}": number_in(item.value, item.unit) for name, item in of_rig.items()
    }
    units = {f"rig.{name}": item.unit.symbol for name, item in of_rig.items()}
    problems = Problems()
    reader = Reader(document, problems)
    own = {name: table.unit or "1" for name, table in source.tables.items()}
    trials = sweep.info.trials
    scopes: list[dict[str, Value]] = []
    for trial in trials:
        scope = {**shared, **scope_of(trial, without=own)}
        for name, item in source.parameters.items():
            if name not in scope and item.default is not None and not item.choices:
                found = reader.value(("parameters", name, "default"), item.default, shared)
                scope |= {} if found is None else {name: found}
        scopes.append({**scope, **read_tables(reader, source, scope)})
        units |= trial.units
    everywhere = set(scopes[0]).intersection(*scopes[1:])
    for name in set(sweep.plan.group_by) - everywhere:
        hint = suggest(name, {name for name in everywhere if "." not in name})
        reader.note(("identify", "group_by"), f"{sweep.path} has no trial parameter {name!r}",
                    hint=hint)  # fmt: skip
    problems.raise_any()  # without it tables and constants have no value either
    same = {name: scopes[0][name] for name in everywhere
            if all(scope[name] == scopes[0][name] for scope in scopes)}  # fmt: skip
    hidden = {name for name in everywhere if "." not in name}
    reader = Reader(document, problems, {**units, **own}, frozenset(hidden - set(same)))
    streams = sweep.recording.streams
    there = {f"{name}.{item.name}" for name, found in streams.items() for item in found.channels}
    plan = read_plan(
        reader, choices_of(source), source.identify, of_rig, (same, scopes[0]), hidden,
        has=there.__contains__,
    )  # fmt: skip
    problems.raise_any()
    plan = replace(plan, group_by=sweep.plan.group_by)
    analysis = find_analysis(plan.model)
    check_plan(plan, analysis, place)
    followed = {value for value in plan.constants.values() if isinstance(value, str)}
    values = {trial.number: {name: scope[name] for name in followed}
              for trial, scope in zip(trials, scopes, strict=True)}  # fmt: skip
    info = replace(
        sweep.info,
        trials=tuple(
            replace(trial, parameters={**trial.parameters, **_plain(values[trial.number])})
            for trial in needed_trials(sweep.recording, plan.signals)
        ),
    )
    changed = replace(sweep, info=info, plan=plan).without(analysis.needs.optional_signals)
    for signal, unit in {**analysis.needs.signals, **analysis.needs.optional_signals}.items():
        if signal in changed.plan.signals:
            _check_signal(changed, signal, unit)
    return changed


def with_derived_of(recording: Recording, procedure: Procedure) -> Recording:
    """Return ``recording`` with the derived channels of ``procedure`` that it lacks.

    Its parameters with a default stand for those that the recording lacks.

    Raises:
        ConfigError: a channel does not fit the recording; names every problem with its place.
    """
    source, problems = procedure.source, Problems()
    if not source.derived:
        return recording
    reader = Reader(procedure.document, problems)
    defaults: dict[str, Value] = {
        f"rig.{name}": number_in(item.value, item.unit)
        for name, item in _constants_of(recording).items()
    }
    for name, item in source.parameters.items():
        if item.default is not None and not item.choices:
            found = reader.value(("parameters", name, "default"), item.default, defaults)
            defaults |= {} if found is None else {name: found}
    problems.raise_any()
    return recording.with_channels(procedure.document, source.derived, defaults)


def _constants_of(recording: Recording) -> Mapping[str, Constant]:
    rig = recording.attachments.get("rig.yaml")
    if rig is None:
        return {}
    return parse_constants(rig.data.decode(errors="replace"), Path("rig.yaml"))


def scope_of(trial: TrialInfo, without: Mapping[str, str]) -> dict[str, Value]:
    """Return the parameters of a recorded trial but those in ``without``, for expressions."""
    scope: dict[str, Value] = {}
    for name, value in trial.parameters.items():
        if name in without:
            continue
        if isinstance(value, str):
            scope[name] = value
        elif isinstance(value, int | float):
            scope[name] = number_in(float(value), parse_unit(trial.units.get(name, "1")))
    return scope


def _plain(values: Mapping[str, Value]) -> dict[str, float]:
    return {name: value.value for name, value in values.items() if isinstance(value, Number)}


def _check_signal(sweep: RecordedSweep, signal: str, unit: str) -> None:
    stream, field_name = sweep.field(signal)
    channel = next(item for item in stream.channels if item.name == field_name)
    if not of_kind(channel.unit, unit):
        raise DataError(
            f"{sweep.path}: the signal {signal} is {stream.name}.{field_name}, in {channel.unit}; "
            f"the model works from {unit}"
        )


def _differences(
    before: RecordedSweep, after: RecordedSweep, always: Mapping[str, str]
) -> tuple[Correction, ...]:
    """Return what differs, and of constants those in ``always`` in any case."""
    found = []
    for name in sorted({*before.plan.constants, *after.plan.constants}):
        units = {**after.plan.units, **before.plan.units}
        old, new = _text(before, name, units), _text(after, name, {**units, **after.plan.units})
        if old != new or name in always:
            found.append(Correction(before.path, name, old, new))
    for name in sorted({*before.plan.signals, *after.plan.signals}):
        old, new = before.plan.signals.get(name, ""), after.plan.signals.get(name, "")
        if old != new:
            found.append(Correction(before.path, f"signal {name}", old, new))
    published = [_published(sweep) for sweep in (before, after)]
    if published[0] != published[1]:
        found.append(Correction(before.path, "published values", *published))
    return tuple(found)


def _published(sweep: RecordedSweep) -> str:
    values = {name: value for trial in sweep.info.trials
              for name, value in sweep.reference(trial).items()}  # fmt: skip
    shown = ", ".join(f"{name} {value:.6g}" for name, value in sorted(values.items()))
    return f"{sweep.plan.reference_label}: {shown}" if shown else ""


def _text(sweep: RecordedSweep, name: str, units: Mapping[str, str]) -> str:
    """Return a constant as a person reads it, all values that it has; "" if there is none."""
    given = sweep.plan.constants.get(name, "")
    values = [given] if not isinstance(given, str) else [
        trial.parameters.get(given) for trial in sweep.info.trials
    ]  # fmt: skip
    unit = units.get(name, "1")
    shown = [format_quantity(float(value), unit) for value in dict.fromkeys(values)
             if isinstance(value, int | float)]  # fmt: skip
    if not shown:
        return ""
    u = sweep.plan.uncertainties.get(name)
    return ", ".join(shown) + ("" if u is None else f" ± {_amount(u, unit)}")


def _amount(u: Uncertainty, unit: str) -> str:
    return format_difference(u.size, "%" if u.is_share else unit)
