"""Groups the trials of a run by the parameter that distinguishes them, and colours the groups."""

from __future__ import annotations

import itertools
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from rigd.analysis.report.palette import SERIES
from rigd.model.units import Quantity, parse_unit
from rigd.record import RunInfo, TrialInfo

#: More groups than this cannot be distinguished by colour: numbers are put into ranges.
MOST: Final = 12
RANGES: Final = 6
#: Colours of an ordered parameter, from its least to its greatest value; they stand out from a
#: light page and a dark screen alike.
_SCALE: Final = ("#0072b2", "#009e73", "#e69f00", "#d55e00")


@dataclass(frozen=True)
class Groups:
    """The groups of trials: ``label`` and ``colour`` of each, and which attempt is in which."""

    by: str  #: name of the parameter; empty if nothing distinguishes trials
    labels: tuple[str, ...]
    colours: tuple[str, ...]
    of: Mapping[int, int]


def shown_value(trial: TrialInfo, name: str) -> str:
    """Return a parameter of a trial as a person writes it, such as ``0.15 A``."""
    value, unit = trial.parameters.get(name), trial.units.get(name)
    if isinstance(value, bool) or not isinstance(value, int | float) or unit is None:
        return "" if value is None else str(value)
    try:
        return str(Quantity(float(value), parse_unit(unit)))
    except ValueError:
        return f"{value} {unit}"


def varying(trials: Sequence[TrialInfo]) -> list[str]:
    """Return the parameters that are not the same in all trials, in the order they were given."""
    names = dict.fromkeys(name for trial in trials for name in trial.parameters)
    return [name for name in names if len({str(t.parameters.get(name)) for t in trials}) > 1]


def groups_of(info: RunInfo) -> Groups:
    """Return the groups of the attempts of a run.

    By what its identification groups by, if that varies; else by the parameter with most
    values that colours can still show; else by ranges of a number.
    """
    names = varying(info.trials)
    counts = {name: len({str(t.parameters.get(name)) for t in info.trials}) for name in names}
    planned = [name for name in _planned(info) if name in counts and counts[name] <= MOST]
    few = sorted((name for name in names if counts[name] <= MOST), key=lambda n: -counts[n])
    chosen = next(iter([*planned, *few, *names]), None)
    if chosen is None:
        of = {index: 0 for index, _ in enumerate(info.trials)} or {0: 0}
        return Groups("", ("all trials",), (SERIES[0],), of)
    if counts[chosen] <= MOST:
        return _by_value(info.trials, chosen)
    return _by_range(info.trials, chosen)


def _planned(info: RunInfo) -> list[str]:
    try:
        names: Any = json.loads(info.metadata.get("identify", {}).get("group_by", "[]"))
    except ValueError:
        return []
    return [str(name) for name in names] if isinstance(names, list) else []


def _by_value(trials: Sequence[TrialInfo], name: str) -> Groups:
    found: dict[str, int] = {}
    of = {}
    for index, trial in enumerate(trials):
        of[index] = found.setdefault(shown_value(trial, name), len(found))
    ordered = all(isinstance(trial.parameters.get(name), int | float) for trial in trials)
    return Groups(name, tuple(found), _colours(len(found), ordered=ordered), of)


def _by_range(trials: Sequence[TrialInfo], name: str) -> Groups:
    """Return as equal ranges as the values allow; all in one if they are no numbers."""
    numbers = [trial.parameters.get(name) for trial in trials]
    if not all(isinstance(number, int | float) for number in numbers):
        of = {index: 0 for index, _ in enumerate(trials)}
        return Groups("", ("all trials",), (SERIES[0],), of)
    order = sorted(range(len(trials)), key=lambda index: float(numbers[index] or 0.0))
    of, labels = {}, []
    size = -(-len(order) // RANGES)
    cuts = [0]
    for at in range(1, len(order)):  # trials of one value are of one group
        if at - cuts[-1] >= size and numbers[order[at]] != numbers[order[at - 1]]:
            cuts.append(at)
    for group, (first, last) in enumerate(itertools.pairwise([*cuts, len(order)])):
        members = order[first:last]
        of.update(dict.fromkeys(members, group))
        ends = (shown_value(trials[members[0]], name), shown_value(trials[members[-1]], name))
        labels.append(f"{ends[0]} … {ends[1]}")
    return Groups(name, tuple(labels), _colours(len(labels), ordered=True), of)


def _colours(count: int, *, ordered: bool) -> tuple[str, ...]:
    if count <= 2 or (count <= len(SERIES) and not ordered):
        return SERIES[:count]
    return tuple(_between(i / (count - 1)) for i in range(count))


def _between(share: float) -> str:
    """Return the colour at ``share`` (0 to 1) of the scale."""
    place = share * (len(_SCALE) - 1)
    low = min(int(place), len(_SCALE) - 2)
    ends = ([int(shade[i : i + 2], 16) for i in (1, 3, 5)] for shade in _SCALE[low : low + 2])
    mixed = (round(a + (b - a) * (place - low)) for a, b in zip(*ends, strict=True))
    return "#" + "".join(f"{part:02x}" for part in mixed)
