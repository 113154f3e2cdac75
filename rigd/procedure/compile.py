"""Compiles a procedure for a rig to plain data, and checks everything before anything moves.

The check plays nothing and is fast. It covers names, units, ranges and limits for every trial of
the sweep. It also refuses an end condition that can never be met, because a range, a limit or an
interlock always acts first. The dry run computes the physics.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

from rigd.config.document import KeyPath
from rigd.config.loader import channel_names
from rigd.config.problems import Problems, suggest
from rigd.config.rig import RigConfig
from rigd.language.number import Number, number_in
from rigd.model.errors import ConfigError
from rigd.procedure.derived import with_derived
from rigd.procedure.expression import Scope, Value
from rigd.procedure.identify import read_plan
from rigd.procedure.loader import Procedure
from rigd.procedure.measures import check_measures
from rigd.procedure.parameters import (
    Parameters,
    choices_of,
    read_parameters,
    read_tables,
    read_unit,
)
from rigd.procedure.program import (
    CompiledProcedure,
    CycleProgram,
    IdentifyPlan,
    OnClientLoss,
    TrialPlan,
)
from rigd.procedure.reader import Reader, describe_unit
from rigd.procedure.source import FaultSource, MoveSource, ProcedureSource, PromptSource
from rigd.procedure.steps.other_rig import other_rig
from rigd.procedure.steps.recorded_streams import read_record
from rigd.procedure.steps.steps import StepCompiler
from rigd.procedure.sweep import MAX_SIZE, play_order, read_points


def compile_procedure(
    procedure: Procedure,
    rig: RigConfig,
    overrides: Mapping[str, str] | None = None,
    *,
    done: Collection[int] = (),
    most: int = MAX_SIZE,
) -> CompiledProcedure:
    """Return ``procedure`` for ``rig``, ready to play.

    ``overrides`` are the texts of ``--set NAME=VALUE``. ``done`` are the numbers of trials that an
    earlier, interrupted run has completed: they stay in the plan, but a prompt that is shown once
    per value is shown again in the first trial that is still to play.

    Raises:
        TooLong: all trials together have more than ``most`` steps and values; nothing was compiled.
        OtherRigError: the procedure needs devices that the rig lacks, and nothing else is wrong.
        ConfigError: the procedure does not fit the rig; names every problem with its place.
    """
    source, problems = procedure.source, Problems()
    swept = frozenset((*source.sweep.grid, *source.sweep.zip))
    hidden = swept | {name for name, table in source.tables.items() if table.by in swept}
    reader = Reader(procedure.document, problems, swept=hidden)
    parameters = read_parameters(reader, source, swept, overrides or {}, _constants(rig))
    base = {**parameters.scope, **read_tables(reader, source, parameters.scope)}
    points = read_points(reader, source, parameters, most)
    scopes = [_scope(reader, source, parameters.scope, point) for point in points]

    units = _units(rig, parameters, [base, *scopes[:1]])
    units |= {name: read_unit(reader, ("tables", name, "unit"), table.unit)
              for name, table in source.tables.items() if table.unit}  # fmt: skip
    reader = replace(reader, units=units)
    every = [scope for scope in scopes for _ in range(source.repeats)]
    known, rig = rig.devices, with_derived(reader, source, rig, base, hidden, every)
    if source.derived and rig.devices is known:
        # Uncomputed channels would all seem unknown; on another rig, all that it lacks is named.
        _raise_any(problems, source, rig, unless_other=True)
    compiler = StepCompiler(reader, rig, source.parameters)
    prepare = compiler.compile(("prepare",), source.prepare, base)
    trials = _trials(compiler, source, scopes, done)
    finish = compiler.compile(("finish",), source.finish, base)
    steps = [
        step.step for _, block in _blocks(source) for step in block if isinstance(step, MoveSource)
    ]
    record = read_record(reader, source, rig, base, steps)
    measures = check_measures(reader, source, rig, record, scopes, trials)
    identify = _identify(reader, source, rig, (base, next(iter(scopes), base)), hidden)
    _check_names(reader, source)
    _raise_any(problems, source, rig)
    return CompiledProcedure(
        name=source.procedure,
        title=source.title,
        parameters=_own(base),
        units={name: unit for name, unit in units.items() if "." not in name},
        prepare=prepare,
        trials=trials,
        finish=finish,
        record=record,
        identify=identify,
        measures=measures,
        on_client_loss=OnClientLoss(source.on_client_loss),
        derived={
            name: device for name, device in rig.devices.items() if device is not known.get(name)
        },
    )


def _raise_any(
    problems: Problems, source: ProcedureSource, rig: RigConfig, *, unless_other: bool = False
) -> None:
    try:
        problems.raise_any()
    except ConfigError as error:
        own = {name.partition(".")[0] for name in source.derived}
        other = other_rig(error, source.procedure, rig, own)
        if other is None or not unless_other:
            raise other or error from None


def _constants(rig: RigConfig) -> dict[str, Value]:
    return {
        f"rig.{name}": number_in(constant.value, constant.unit)
        for name, constant in rig.constants.items()
    }


def _scope(
    reader: Reader, source: ProcedureSource, base: Scope, point: Mapping[str, Value]
) -> dict[str, Value]:
    scope = {**base, **point}
    return {**scope, **read_tables(reader, source, scope)}


def _units(rig: RigConfig, parameters: Parameters, scopes: Sequence[Scope]) -> dict[str, str]:
    """Return the displayed unit of each named quantity."""
    units = {
        name: describe_unit(value)
        for scope in scopes
        for name, value in scope.items()
        if isinstance(value, Number)
    }
    units.update({f"rig.{name}": constant.unit.symbol for name, constant in rig.constants.items()})
    units.update(parameters.units)
    return units


def _trials(
    compiler: StepCompiler,
    source: ProcedureSource,
    scopes: Sequence[Scope],
    done: Collection[int],
) -> tuple[TrialPlan, ...]:
    """Return the trials in the order of play."""
    trials = []
    for index in play_order(len(scopes) * source.repeats, source):
        scope = scopes[index // source.repeats]
        limits = compiler.limits(("trial", "limits"), source.trial.limits, scope)
        compiler.remembers = index + 1 not in done
        trial = TrialPlan(
            number=index + 1,
            repeat=index % source.repeats + 1,
            parameters=_own(scope),
            steps=compiler.compile(("trial", "steps"), source.trial.steps, scope, limits),
            after=compiler.compile(("trial", "after"), source.trial.after, scope),
        )
        if not any(isinstance(step, CycleProgram) for step in trial.steps):
            words = {
                name: parameter
                for name, parameter in trial.parameters.items()
                if isinstance(parameter, str)
            }
            compiler.reader.note_key(("trial", "steps"), f"no step plays in the trial with {words}",
                                     "check each 'when'")  # fmt: skip
        trials.append(trial)
    return tuple(trials)


def _check_names(reader: Reader, source: ProcedureSource) -> None:
    """Note steps and prompts that share a name: logs, reports and answers use the names."""
    seen: dict[str, int] = {}
    for path, steps in _blocks(source):
        for index, step in enumerate(steps):
            if isinstance(step, FaultSource):
                continue  # a fault has the name of its device and kind, and may be shown often
            key, name = (
                ("step", step.step) if isinstance(step, MoveSource) else ("prompt", step.prompt)
            )
            place = reader.document.place((*path, index, key))
            if name in seen:
                message = f"the name {name!r} is used twice; first in line {seen[name]}"
                reader.problems.add(place, message, "give each step a different name")
            seen.setdefault(name, place.line)


def _blocks(
    source: ProcedureSource,
) -> tuple[tuple[KeyPath, Sequence[MoveSource | PromptSource | FaultSource]], ...]:
    """Return every list of steps, with its place."""
    return (
        (("prepare",), source.prepare),
        (("trial", "steps"), source.trial.steps),
        (("trial", "after"), source.trial.after),
        (("finish",), source.finish),
    )


def _own(scope: Scope) -> dict[str, float | str | bool]:
    """Return parameters and tables as plain values; the rig file has the rig's constants."""
    return {
        name: value.value if isinstance(value, Number) else value
        for name, value in scope.items()
        if "." not in name
    }


def _identify(
    reader: Reader,
    source: ProcedureSource,
    rig: RigConfig,
    scopes: tuple[Scope, Scope],
    hidden: Collection[str],
) -> IdentifyPlan | None:
    """Return the plan; ``scopes`` are those of the whole run and of its first trial."""
    plan = source.identify
    if plan is None:
        return None
    for signal, channel in plan.signals.items():
        if rig.recorded(channel) is None:
            place = reader.document.place(("identify", "signals", signal))
            known = channel_names(rig)
            reader.problems.add_lacking(place, rig.name, "channel", channel, known)
    for signal in plan.signals.keys() & plan.optional_signals.keys():
        reader.note_key(("identify", "optional_signals", signal),
                        f"{signal!r} stands in 'signals' as well", "give it once")  # fmt: skip
    for index, name in enumerate(plan.group_by):
        if name not in source.parameters:
            reader.note(("identify", "group_by", index), f"unknown parameter {name!r}",
                        suggest(name, source.parameters))  # fmt: skip
    return read_plan(
        reader, choices_of(source), plan, rig.constants, scopes, hidden,
        has=lambda channel: rig.recorded(channel) is not None,
    )  # fmt: skip
