"""Adds the derived channels of a procedure to its rig: they live as long as the run."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from rigd.config.computed.derived import ALL_ALIKE, ByTrial, add_derived
from rigd.config.problems import suggest
from rigd.config.rig import RigConfig
from rigd.language.number import ExpressionError, Number
from rigd.procedure.expression import Scope
from rigd.procedure.reader import Reader
from rigd.procedure.source import ProcedureSource


def with_derived(
    reader: Reader,
    source: ProcedureSource,
    rig: RigConfig,
    scope: Scope,
    hidden: Collection[str],
    trials: Sequence[Scope],
) -> RigConfig:
    """Return ``rig`` with the derived channels of ``source``; problems are noted.

    A formula may use the parameters, tables and constants of ``scope`` as ``${name}``, and the
    quantities in ``hidden``, of which each of ``trials``, in the order of their numbers, has its
    own value.
    """

    def named(name: str, offset: int) -> Number:
        value = scope.get(name)
        if value is None:
            if trials and isinstance(trials[0].get(name), str):
                raise ExpressionError(f"{name} is a word, expected a quantity", offset)
            hint = suggest(name, {*scope, *hidden})
            lacks = name if name.startswith("rig.") else ""
            raise ExpressionError(f"unknown name '${{{name}}}'", offset, hint, lacks=lacks)
        if isinstance(value, str):
            raise ExpressionError(f"{name} is a word, expected a quantity", offset)
        return value

    return add_derived(
        reader.document, source.derived, rig, reader.problems, named, _by_trial(hidden, trials)
    )


def _by_trial(names: Collection[str], trials: Sequence[Scope]) -> ByTrial:
    """Return the quantities of ``names`` that all ``trials`` have, by number of trial."""
    if not trials:
        return ALL_ALIKE
    kinds = {}
    for name in names:
        values = [scope.get(name) for scope in trials]
        if all(isinstance(value, Number) for value in values) and isinstance(values[0], Number):
            kinds[name] = values[0]
    return ByTrial(
        kinds,
        {
            number: {
                name: value.value for name in kinds if isinstance(value := scope[name], Number)
            }
            for number, scope in enumerate(trials, 1)
        },
    )
