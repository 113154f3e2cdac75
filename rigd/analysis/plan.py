"""Judges a procedure against a rig and the analysis that its `identify` plan names.

Importing this module loads no large library.
"""

from __future__ import annotations

import difflib
from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import TYPE_CHECKING

from rigd.analysis.analysis import Analysis, ChecksTrials
from rigd.config.registry import ANALYSES, find, installed
from rigd.model.errors import ConfigError, Place
from rigd.model.units import parse_unit
from rigd.procedure.compile import compile_procedure
from rigd.procedure.loader import Procedure
from rigd.procedure.program import CompiledProcedure, IdentifyPlan
from rigd.procedure.sweep import MAX_SIZE
from rigd.sdk.analysis import ANY_UNIT, choices

if TYPE_CHECKING:
    from rigd.config.rig import RigConfig


def judged(
    procedure: Procedure,
    rig: RigConfig,
    overrides: Mapping[str, str] | None = None,
    *,
    done: Collection[int] = (),
    most: int = MAX_SIZE,
) -> CompiledProcedure:
    """Return ``procedure`` for ``rig``, compiled, and its plan checked against its analysis.

    This is the one judgement of a procedure: of a run, a dry run, a check, and of a daemon. The
    arguments are those of :func:`compile_procedure`.

    Raises:
        ConfigError: the procedure does not fit the rig, its sibling or its analysis.
    """
    compiled = compile_procedure(procedure, rig, overrides, done=done, most=most)
    if compiled.identify is not None:
        analysis_of(
            compiled.identify,
            procedure.document.key_place(("identify",)),
            compiled.trials[0].parameters,
            compiled.on(rig),
            compiled.record,
        )
    return compiled


def analysis_of(
    plan: IdentifyPlan,
    place: Place | None = None,
    trial_parameters: Collection[str] | None = None,
    rig: RigConfig | None = None,
    recorded: Collection[str] | None = None,
) -> type[Analysis]:
    """Return the analysis of ``plan``, once the plan gives all that it needs and nothing else.

    ``place`` is the plan's place in its file, for the error; ``trial_parameters`` are those
    that the trials have, ``rig`` the one whose channels are the signals, ``recorded`` the streams
    that a run records, if that is known.

    Raises:
        ConfigError: no such analysis is installed, or it cannot be loaded; a signal, constant or
            reference is missing or unknown; a signal or constant is of another kind; or a signal
            that the analysis cannot do without is not recorded.
    """
    analysis = _installed_analysis(plan.model, place)
    check_plan(plan, analysis, place, trial_parameters, rig)
    used = [plan.signals[name] for name in analysis.needs.signals]
    streams = {channel: channel.partition(".")[0] for channel in used}
    missing = [] if recorded is None else [at for at in used if streams[at] not in recorded]
    if missing:
        wanted = ", ".join(dict.fromkeys(f"{streams[channel]}: 1" for channel in missing))
        raise ConfigError(
            f"identify: model {plan.model} needs {', '.join(missing)}, which 'record' leaves out",
            hint=f"add to 'record': {wanted}",
            place=place,
        )
    return analysis


def not_given(plan: IdentifyPlan, analysis: type[Analysis], rig: RigConfig) -> tuple[str, ...]:
    """Return the constants that ``rig`` states and ``analysis`` takes, and ``plan`` leaves out."""
    names = analysis.needs.optional_constants
    return tuple(name for name in names if name in rig.constants and name not in plan.constants)


def check_plan(
    plan: IdentifyPlan,
    analysis: type[Analysis],
    place: Place | None = None,
    trial_parameters: Collection[str] | None = None,
    rig: RigConfig | None = None,
) -> None:
    """Refuse a plan that does not give ``analysis`` what it needs, or more; see `analysis_of`.

    Raises:
        ConfigError: a signal, constant or reference is missing, unknown or of another kind.
    """
    for message, hint in _mistakes(plan, analysis, trial_parameters):
        raise ConfigError(f"identify: {message}", hint=hint, place=place)
    if rig is not None:
        needs = analysis.needs
        for name, unit in {**needs.signals, **needs.optional_signals}.items():
            _check_unit(name, unit, plan.signals.get(name, ""), rig, place)


def calibrating() -> list[str]:
    """Return the names of the installed analyses that measure calibrated values."""
    return [name for name in sorted(installed(ANALYSES)) if find_analysis(name).measures]


def find_analysis(name: str) -> type[Analysis]:
    """Return the analysis called ``name``.

    Raises:
        ConfigError: no such analysis is installed, or it cannot be loaded.
    """
    return find(ANALYSES, Analysis, "analysis", name)


def _installed_analysis(name: str, place: Place | None) -> type[Analysis]:
    known = installed(ANALYSES)
    if name not in known:
        raise ConfigError(
            f"identify: there is no model {name!r}", hint=_nearest(name, sorted(known)), place=place
        )
    try:
        return find_analysis(name)
    except ConfigError as error:
        raise ConfigError(f"identify: {error.message}", hint=error.hint, place=place) from error


def _mistakes(
    plan: IdentifyPlan, analysis: type[Analysis], trial_parameters: Collection[str] | None
) -> Iterator[tuple[str, str]]:
    """Yield what is wrong with the names of ``plan``, each with what to do."""
    needs, model = analysis.needs, plan.model
    wanted: tuple[tuple[str, Iterable[str], Collection[str]], ...] = (
        ("signal", needs.signals, plan.signals),
        ("constant", needs.constants, plan.constants),
    )
    for kind, names, given in wanted:
        if missing := [name for name in names if name not in given]:
            yield (
                f"model {model} needs the {kind} {', '.join(missing)}",
                f"give it under `identify: {kind}s:` in the procedure",
            )
    for kind, known, names in (
        ("signal", [*needs.signals, *needs.optional_signals], plan.signals),
        ("constant", [*needs.constants, *needs.optional_constants], plan.constants),
        ("reference", needs.references, _references(plan.reference)),
    ):
        for name in names:
            if name not in known:
                yield f"model {model} has no {kind} {name!r}", _nearest(name, known)
    if plan.check is not None and not issubclass(analysis, ChecksTrials):
        yield (
            f"model {model} does not evaluate single trials",
            "leave `identify: check` out; `rigd identify` evaluates the recording",
        )
    for name, unit in needs.constant_units.items():
        stated = plan.units.get(name)
        if stated is not None and not of_kind(stated, unit):
            kind = "no unit" if stated == "1" else f"the unit {stated}"
            wanted_unit = "a plain number" if unit == "1" else unit
            yield (
                f"the constant {name} has {kind}; model {model} takes it in {wanted_unit}",
                "correct it under `identify: constants:` in the procedure",
            )
    for name in needs.trial_parameters:
        if trial_parameters is not None and name not in trial_parameters:
            message = f"model {model} needs trials with a parameter {name!r}"
            yield message, _nearest(name, trial_parameters)


def _references(reference: Mapping[str, float]) -> list[str]:
    """Return which results are given, without the group that each belongs to."""
    return [name.rpartition(".")[2] for name in reference]


def _check_unit(signal: str, unit: str, written: str, rig: RigConfig, place: Place | None) -> None:
    channel = rig.recorded(written)
    if channel is None or of_kind(channel.unit, unit):
        return
    raw = rig.channel(f"{written}_raw")
    fits = raw is not None and of_kind(raw.unit, unit)
    raise ConfigError(
        f"identify: the signal {signal} is {written}, in {channel.unit}; the model works from "
        f"{unit}",
        hint=f"did you mean '{written}_raw'?" if fits else f"choose a channel in {unit}",
        place=place,
    )


def of_kind(found: str, wanted: str) -> bool:
    """Return whether a channel in the unit ``found`` can be a signal in ``wanted``."""
    return wanted == ANY_UNIT or any(
        parse_unit(found).same_kind(parse_unit(unit)) for unit in choices(wanted)
    )


def _nearest(name: str, known: Iterable[str]) -> str:
    names = list(known)
    close = difflib.get_close_matches(name, names, n=1)
    if close:
        return f"did you mean {close[0]!r}?"
    return f"there are: {', '.join(names)}" if names else "there are none"
