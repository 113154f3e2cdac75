"""Chooses which trial a report shows large, and which signals share an axis."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rigd.analysis.result import TrialFit
from rigd.model import parse_quantity

#: A signal that stays below this share of the largest one of its unit is a flat line beside it.
FLAT_LINE = 0.25

_QUANTITY = re.compile(r"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?\s*[^\s,;()=]*")


@dataclass(frozen=True)
class Panel:
    """Signals drawn on one axis: their names, and their common unit."""

    names: tuple[str, ...]
    unit: str


def featured(trials: Sequence[TrialFit]) -> TrialFit:
    """Return the trial with the greatest condition (such as the highest current, either way).

    If a condition holds no quantity, or several trials share the greatest, the one whose
    fitted output reaches furthest.

    Raises:
        ValueError: no trials.

    """
    if not trials:
        raise ValueError("there is no trial to choose from")
    return max(trials, key=lambda trial: (_condition(trial.condition), _reach(trial)))


def panels(trials: Sequence[TrialFit]) -> tuple[Panel, ...]:
    """Return how to spread the signals over axes: one per unit, small signals on their own.

    The choice is made over all trials, so that the figures of a section look alike.
    """
    peaks: dict[str, dict[str, float]] = {}
    for trial in trials:
        for name, signal in trial.signals.items():
            values = signal.values[np.isfinite(signal.values)]
            peak = float(np.abs(values).max()) if values.size else 0.0
            of_unit = peaks.setdefault(signal.unit, {})
            of_unit[name] = max(of_unit.get(name, 0.0), peak)
    return spread(peaks)


def spread(peaks: Mapping[str, Mapping[str, float]]) -> tuple[Panel, ...]:
    """Return the panels of signals whose greatest magnitudes are known, by unit and name."""
    found: list[Panel] = []
    for unit, of_unit in peaks.items():
        bar = FLAT_LINE * max(of_unit.values())
        tall = tuple(name for name, peak in of_unit.items() if peak >= bar)
        found.append(Panel(tall, unit))
        found.extend(Panel((name,), unit) for name in of_unit if name not in tall)
    return tuple(found)


def names_condition(trial: TrialFit) -> bool:
    """Return whether the label contains the condition already, also in other digits."""
    if trial.condition in trial.label:
        return True
    value = _condition(trial.condition)
    return bool(np.isfinite(value)) and value == _condition(trial.label)


def _condition(text: str) -> float:
    match = _QUANTITY.search(text)
    if match is None:
        return -np.inf
    try:
        return abs(parse_quantity(match.group()).value)
    except ValueError:
        return -np.inf  # words such as "run 3b": no order to go by


def _reach(trial: TrialFit) -> float:
    used = trial.fitted[trial.used]
    return float(np.abs(used).max()) if used.size else 0.0
