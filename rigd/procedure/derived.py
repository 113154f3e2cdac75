"""Adds the derived channels of a procedure to its rig: they live as long as the run."""

from __future__ import annotations

from collections.abc import Collection

from rigd.config.computed.derived import add_derived
from rigd.config.problems import suggest
from rigd.config.rig import RigConfig
from rigd.language.number import ExpressionError, Number
from rigd.procedure.expression import Scope
from rigd.procedure.reader import Reader
from rigd.procedure.source import ProcedureSource


def with_derived(
    reader: Reader, source: ProcedureSource, rig: RigConfig, scope: Scope, hidden: Collection[str]
) -> RigConfig:
    """Return ``rig`` with the derived channels of ``source``; problems are noted.

    A formula may use the parameters, tables and constants of ``scope`` as ``${name}``; those in
    ``hidden`` have a value only inside a trial, and are refused.
    """

    def named(name: str, offset: int) -> Number:
        value = scope.get(name)
        if value is None:
            hint = suggest(name, scope)
            if name in hidden:
                hint = f"the sweep varies {name}: a derived channel lives as long as the run"
            lacks = name if name.startswith("rig.") else ""
            raise ExpressionError(f"unknown name '${{{name}}}'", offset, hint, lacks=lacks)
        if isinstance(value, str):
            raise ExpressionError(f"{name} is a word, expected a quantity", offset)
        return value

    return add_derived(reader.document, source.derived, rig, reader.problems, named)
