"""Reads the `identify` block of a procedure: the model to fit, its signals and known constants."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, field

from rigd.config.document import KeyPath
from rigd.config.problems import suggest
from rigd.config.quantities import read_uncertainty
from rigd.config.source import ConstantSource
from rigd.language.number import Number
from rigd.language.syntax import Literal, Reference
from rigd.model.constants import Constant, Uncertainty
from rigd.model.units import parse_unit
from rigd.procedure.expression import Scope
from rigd.procedure.program import IdentifyPlan, TrialCheck
from rigd.procedure.reader import Reader, describe_unit
from rigd.procedure.source import IdentifySource, ReferenceSource


@dataclass
class _Known:
    values: dict[str, float | str] = field(default_factory=dict)
    uncertainties: dict[str, Uncertainty] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)


def read_plan(
    reader: Reader,
    choices: Mapping[str, Sequence[str]],
    plan: IdentifySource,
    of_rig: Mapping[str, Constant],
    scopes: tuple[Scope, Scope],
    hidden: Collection[str],
    has: Callable[[str], bool],
) -> IdentifyPlan:
    """Return ``plan`` with its constants and published values; problems are noted in ``reader``.

    An optional signal is left out unless ``has`` finds its channel.

    ``choices`` are the words that each parameter may take. ``scopes`` are those of the whole run
    and of one trial; ``hidden`` are the names with a value of their own in each trial. ``of_rig``
    are the constants of the rig: the uncertainty of such a constant applies if the procedure gives
    none.
    """
    known = _read_constants(reader, plan, of_rig, scopes, hidden)
    published: dict[str, float] = {}
    if plan.reference is not None:
        published = _read_reference(reader, choices, plan.reference, scopes[0], hidden)
    return IdentifyPlan(
        plan.model,
        {**{name: at for name, at in plan.optional_signals.items() if has(at)}, **plan.signals},
        known.values,
        tuple(plan.group_by),
        published,
        "" if plan.reference is None else plan.reference.label,
        known.uncertainties,
        known.units,
        None if plan.check is None else TrialCheck(plan.check),
    )


def plan_metadata(plan: IdentifyPlan) -> dict[str, str]:
    """Return the plan as a metadata record of a recording, which `rigd identify` reads."""
    return {
        "model": plan.model,
        "signals": json.dumps(dict(plan.signals), sort_keys=True),
        "constants": json.dumps(dict(plan.constants), sort_keys=True),
        "group_by": json.dumps(list(plan.group_by)),
        "reference": json.dumps(dict(plan.reference), sort_keys=True),
        "reference_label": plan.reference_label,
        "uncertainties": json.dumps(
            {name: asdict(u) for name, u in plan.uncertainties.items()}, sort_keys=True
        ),
        "units": json.dumps(dict(plan.units), sort_keys=True),
    }


def _read_constants(
    reader: Reader,
    plan: IdentifySource,
    of_rig: Mapping[str, Constant],
    scopes: tuple[Scope, Scope],
    hidden: Collection[str],
) -> _Known:
    known = _Known()
    base, trial = scopes
    for name, item in plan.constants.items():
        path: KeyPath = ("identify", "constants", name)
        source = ConstantSource(value=item) if isinstance(item, str) else item
        value_path = path if isinstance(item, str) else (*path, "value")
        expression = reader.parse(value_path, source.value)
        if expression is None:
            continue
        root = expression.root
        reference = root.name if isinstance(root, Reference) else ""
        is_swept = reference in hidden
        value = (
            trial.get(reference) if is_swept else reader.value(value_path, source.value, base)
        )  # a sweep with a mistake has no trial
        if not isinstance(value, Number):
            if value is not None:
                reader.note(value_path, f"{value!r} is a word, expected a quantity")
            continue
        known.values[name] = reference if is_swept else value.value
        known.units[name] = reader.units.get(reference) or describe_unit(value)
        if isinstance(root, Literal):
            known.units[name] = "1" if root.unit is None else root.unit.symbol
        unit = parse_unit(known.units[name])
        u = read_uncertainty(reader.document, (*path, "u"), source.u, unit, reader.problems)
        if source.u is None and reference.startswith("rig."):
            u = of_rig[reference.removeprefix("rig.")].u
        if u is not None:
            known.uncertainties[name] = u
    return known


def _read_reference(
    reader: Reader,
    choices: Mapping[str, Sequence[str]],
    reference: ReferenceSource,
    base: Scope,
    hidden: Collection[str],
) -> dict[str, float]:
    """Return the published values for the choice of ``base``.

    If each trial has its own choice, return those of every choice, as ``choice.name``.
    """
    path: KeyPath = ("identify", "reference")
    wanted, other = ("parameters", "values") if reference.by is None else ("values", "parameters")
    if not getattr(reference, wanted) or getattr(reference, other):
        case = "without" if reference.by is None else "with"
        reader.note_key(
            path, f"{case} 'by', a reference has {wanted!r} and no {other!r}",
            "by: PARAMETER with values: {CHOICE: {...}}, or parameters: {...}",
        )  # fmt: skip
        return {}
    if reference.by is None:
        return _quantities(reader, (*path, "parameters"), reference.parameters, base)
    known = choices.get(reference.by, ())
    if not known:
        with_choices = [name for name, words in choices.items() if words]
        reader.note((*path, "by"), f"{reference.by!r} is not a parameter with choices",
                    suggest(reference.by, with_choices))  # fmt: skip
        return {}
    for choice in reference.values:
        if choice not in known:
            reader.note_key((*path, "values", choice),
                            f"{choice!r} is not a choice of {reference.by}",
                            suggest(choice, known))  # fmt: skip
    values: dict[str, float] = {}
    for choice, texts in reference.values.items():
        found = _quantities(reader, (*path, "values", choice), texts, base)
        if reference.by in hidden:
            values |= {f"{choice}.{name}": value for name, value in found.items()}
        elif base.get(reference.by) == choice:
            values |= found
    return values


def _quantities(
    reader: Reader, path: KeyPath, texts: Mapping[str, str], base: Scope
) -> dict[str, float]:
    """Return the values in SI; what is no quantity is noted."""
    found = {}
    for name, text in texts.items():
        value = reader.value((*path, name), text, base)
        if isinstance(value, Number):
            found[name] = value.value
        elif value is not None:
            reader.note((*path, name), f"{value!r} is a word, expected a quantity")
    return found
