"""Designs a procedure for a saved model: what an analysis is asked, and what it answers."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from rigd.analysis.analysis import Designs
from rigd.analysis.plan import find_analysis
from rigd.analysis.validation.saved_models import SavedModel, chosen, read_models
from rigd.config.rig import RigConfig
from rigd.model.errors import ConfigError
from rigd.procedure.compile import compile_procedure
from rigd.procedure.loader import Procedure, parse_procedure
from rigd.procedure.program import CompiledProcedure, CycleProgram, IdentifyPlan


@dataclass(frozen=True, eq=False)
class Ground:
    """What tests of one model are made with, from the base procedure on the rig; all in SI.

    ``uncertainties`` are the standard ones that are stated. ``limits`` of a signal are those of its
    channel, as a reading and as a setpoint. ``trials`` are the parameters of the base's trials.
    """

    model: SavedModel
    constants: Mapping[str, float]
    uncertainties: Mapping[str, float]
    limits: Mapping[str, tuple[float, float]]
    trials: tuple[Mapping[str, float | str | bool], ...]


@dataclass(frozen=True, eq=False)
class DesignRequest:
    """What a design is asked: tests on each of the ``grounds``, the same ones for all of them.

    ``targets`` are names of quantities, empty for those that the analysis reports. ``base`` is the
    text of the procedure that the tests take their surroundings from, ``signals`` those of its
    plan. ``name`` is that of the new procedure.
    """

    grounds: tuple[Ground, ...]
    budget_s: float
    targets: tuple[str, ...]
    base: str
    base_name: str
    signals: Mapping[str, str]
    name: str


@dataclass(frozen=True)
class Promise:
    """The relative 95 % half width of one target; None: its interval stays open.

    ``base`` is that of the base procedure's own tests in equal time.
    """

    group: str
    target: str
    half_width: float | None
    base: float | None


@dataclass(frozen=True, eq=False)
class Designed:
    """A procedure: its ``text`` without a head, what it promises, and how it came about."""

    text: str
    trials: int
    duration_s: float
    promises: tuple[Promise, ...]
    notes: tuple[str, ...]


def design(
    model: Path,
    rig: RigConfig,
    base: Procedure,
    minutes: float,
    targets: Sequence[str],
    name: str,
    *,
    group: str = "",
    notify: Callable[[str], None] = lambda _: None,
) -> Designed:
    """Return the tests of ``minutes`` that make the intervals of ``targets`` narrow.

    ``base`` has the surroundings of the tests: the way back, constants and signals. ``group`` names
    the model to take, of several in the file; without, the tests are for all of them together.

    Raises:
        ConfigError: the model cannot be used, its analysis cannot design, or the base does not
            identify with that analysis.
        DataError: the time is too short, or no target can be reached.
    """
    if not (math.isfinite(minutes) and minutes > 0.0):
        raise ConfigError(f"--minutes {minutes:g} must be above 0")
    models = read_models(model)
    if group:
        models = (chosen(models, {}, group),)
    names = list(dict.fromkeys(item.model for item in models))
    if len(names) > 1:
        raise ConfigError(f"{model} has models of several analyses: {', '.join(names)}")
    analysis = find_analysis(names[0])()
    if not isinstance(analysis, Designs):
        raise ConfigError(
            f"no tests can be designed for models of {names[0]}: this analysis has no design of "
            "tests"
        )
    found = [_ground(item, rig, base, names[0]) for item in models]
    request = DesignRequest(
        tuple(ground for ground, _ in found), 60.0 * minutes, tuple(targets), base.file.text,
        base.name, found[0][1].signals, name,
    )  # fmt: skip
    designed = analysis.design(request, notify)
    written = parse_procedure(designed.text, Path(f"{name}.yaml"))
    for item in models:
        compile_procedure(written, rig, _conditions(item, written))
    return designed


def _ground(
    model: SavedModel, rig: RigConfig, base: Procedure, name: str
) -> tuple[Ground, IdentifyPlan]:
    compiled = compile_procedure(base, rig, _conditions(model, base))
    plan = compiled.identify
    if plan is None or plan.model != name:
        what = "nothing" if plan is None else plan.model
        raise ConfigError(
            f"the procedure {base.name} identifies {what}, the model is of {name}",
            hint="give the procedure that the recordings were made with: --base PROCEDURE",
        )
    constants = {}
    for key, value in plan.constants.items():
        if isinstance(value, str):
            raise ConfigError(
                f"the constant {key} changes from trial to trial of {base.name}",
                hint="tests are designed for constants that stay",
            )
        constants[key] = value
    ground = Ground(
        model,
        constants,
        {key: u.of(constants[key]) for key, u in plan.uncertainties.items()},
        {signal: _limits(channel, compiled, rig) for signal, channel in plan.signals.items()},
        tuple({**compiled.parameters, **trial.parameters} for trial in compiled.trials),
    )
    return ground, plan


def _conditions(model: SavedModel, procedure: Procedure) -> dict[str, str]:
    known = procedure.source.parameters
    return {name: value for name, value in model.conditions.items() if name in known}


def _limits(channel: str, compiled: CompiledProcedure, rig: RigConfig) -> tuple[float, float]:
    """Return between which values a channel stays: of the rig, and of every trial."""
    low, high = [-math.inf], [math.inf]
    device, _, name = channel.partition(".")
    if device in rig.devices and name in rig.devices[device].limits:
        limit = rig.devices[device].limits[name]
        low.append(limit.low)
        high.append(limit.high)
    for interlock in rig.interlocks:
        if interlock.source == channel:
            low += [interlock.low] if isinstance(interlock.low, float | int) else []
            high += [interlock.high] if isinstance(interlock.high, float | int) else []
    for trial in compiled.trials:
        for step in trial.steps:
            for bound in step.limits if isinstance(step, CycleProgram) else ():
                if bound.channel == channel:
                    low.append(bound.low)
                    high.append(bound.high)
    return max(low), min(high)
