"""End conditions: ``|carriage_speed| < 3 mm/s for 0.2 s and carriage.position > 1 m``."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from rigd.config.document import Path_
from rigd.config.loader import channel_names
from rigd.config.problems import suggest
from rigd.config.rig import RigConfig
from rigd.model.channels import Channel
from rigd.model.limits import Action
from rigd.model.units import format_quantity
from rigd.procedure.expression import Scope
from rigd.procedure.program import Comparison, Condition, TrialLimit
from rigd.procedure.reader import Reader

_CLAUSE = re.compile(
    r"\s*(?P<open>\|)?\s*(?P<channel>[A-Za-z_]\w*(?:\.\w+)?)\s*(?P<close>\|)?\s*"
    r"(?P<sign>[<>])\s*(?P<threshold>[^<>=\s].*?)(?:\sfor\s(?P<time>.+))?$",
    re.DOTALL,
)
_JOIN = re.compile(r"\sand\s")


def read_until(
    reader: Reader,
    path: Path_,
    texts: Sequence[str],
    scope: Scope,
    rig: RigConfig,
    limits: Sequence[TrialLimit],
) -> tuple[tuple[Condition, ...], ...]:
    """Return the conditions of ``until``: any row of all its clauses; problems are noted.

    ``limits`` are those of the trial that the step plays in.
    """
    is_list = isinstance(reader.document.get(path), list)
    rows = []
    for index, text in enumerate(texts):
        where = (*path, index) if is_list else path
        row = []
        start = 0
        for clause in _JOIN.split(text):
            condition = _read_clause(reader, where, clause, start, scope, rig)
            if condition is not None:
                row.append(condition)
                _check_reachable(reader, where, start, condition, rig, limits)
            start += len(clause) + len(" and ")
        rows.append(tuple(row))
    return tuple(rows)


def _read_clause(
    reader: Reader, path: Path_, text: str, start: int, scope: Scope, rig: RigConfig
) -> Condition | None:
    match = _CLAUSE.match(text)
    place = reader.document.inside(path, start)
    if match is None or bool(match["open"]) != bool(match["close"]):
        hint = "such as 'carriage.position > 1.15 m' or '|belt.speed| < 3 mm/s for 0.2 s'"
        reader.problems.add(place, f"cannot read the condition {text.strip()!r}", hint)
        return None
    name = match["channel"]
    channel = rig.channel(name)
    if channel is None:
        place = reader.document.inside(path, start + match.start("channel"))
        reader.problems.add(place, f"the rig {rig.name} has no channel {name!r}",
                            suggest(name, channel_names(rig)))  # fmt: skip
        return None
    threshold = reader.number(
        path, match["threshold"], channel.unit, scope, start + match.start("threshold")
    )
    for_s = 0.0
    if match["time"] is not None:
        for_s = reader.number(path, match["time"], "s", scope, start + match.start("time"))
        if for_s < 0:
            reader.problems.add(place, f"the time {match['time'].strip()} is negative")
    return Condition(
        channel=name,
        comparison=Comparison(match["sign"]),
        threshold=threshold,
        magnitude=match["open"] is not None,
        for_s=for_s,
    )


def _check_reachable(
    reader: Reader,
    path: Path_,
    start: int,
    condition: Condition,
    rig: RigConfig,
    limits: Sequence[TrialLimit],
) -> None:
    """Note a condition that the channel's range, an interlock or a trial limit always precedes."""
    channel = rig.channel(condition.channel)
    if channel is None:
        return
    hint = "choose a threshold inside that range"
    barriers = [(channel.low, channel.high, f"{condition.channel} measures")]
    barriers += [
        (limit.low, limit.high, "the trial's limit keeps it")
        for limit in limits
        if limit.channel == condition.channel
    ]
    for lock in rig.interlocks:
        if lock.source == condition.channel and lock.action > Action.WARN:
            low = lock.low if isinstance(lock.low, float) else -math.inf
            high = lock.high if isinstance(lock.high, float) else math.inf
            barriers.append((low, high, f"interlock {lock.name} keeps it"))
    for low, high, owner in barriers:
        if _precedes(condition, low, high):
            reader.problems.add(
                reader.document.inside(path, start),
                f"{_describe(condition, channel)} can never be reached: {owner} "
                f"{_between(low, high, channel.unit)}",
                hint,
            )
            return


def _between(low: float, high: float, unit: str) -> str:
    if math.isinf(low):
        return f"below {format_quantity(high, unit)}"
    if math.isinf(high):
        return f"above {format_quantity(low, unit)}"
    return f"between {format_quantity(low, unit)} and {format_quantity(high, unit)}"


def _precedes(condition: Condition, low: float, high: float) -> bool:
    threshold = condition.threshold
    if condition.comparison is Comparison.ABOVE:
        return threshold >= (max(abs(low), abs(high)) if condition.magnitude else high)
    return threshold <= (0.0 if condition.magnitude else low)


def _describe(condition: Condition, channel: Channel) -> str:
    name = f"|{condition.channel}|" if condition.magnitude else condition.channel
    threshold = format_quantity(condition.threshold, channel.unit)
    return f"{name} {condition.comparison.value} {threshold}"
