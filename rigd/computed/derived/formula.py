"""Reads a formula such as ``derivative(wheel.angle) * 0.03 m - carriage.speed`` into a graph."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

from rigd.computed.derived.graph import Builder
from rigd.language.evaluate import evaluate
from rigd.language.functions import FUNCTIONS
from rigd.language.number import ExpressionError, Number, UnknownName
from rigd.language.syntax import Name, Reference, parse

#: ``find(name, offset)``: returns the channel or constant ``name``.
Find: TypeAlias = Callable[[str, int], Number]


def no_names(name: str, offset: int) -> Number:
    """Refuse ``${name}``: a rig file has no parameters.

    Raises:
        ExpressionError: always.
    """
    error = UnknownName(name, offset)
    error.hint = "channels are written bare, as device.channel; constants as rig.NAME"
    raise error


def read_formula(text: str, builder: Builder, find: Find, named: Find = no_names) -> Number:
    """Return what ``text`` is; its rows are added to ``builder``.

    ``named`` knows what is written ``${name}``.

    Raises:
        ExpressionError: it is no formula, a unit does not fit, or a name is unknown; with the
            place.
    """

    def known(node: Name | Reference) -> Number:
        if isinstance(node, Reference):
            return named(node.name, node.start)
        if "." in node.name:
            return find(node.name, node.start)
        hint = "channels are written as device.channel"
        if node.name in FUNCTIONS:
            hint = f"it is a function: {FUNCTIONS[node.name].usage}"
        raise ExpressionError(f"unknown name {node.name!r}", node.start, hint)

    return evaluate(parse(text), known, builder)
