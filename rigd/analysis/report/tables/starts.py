"""Makes a table of the starts of a fit: the cost and the parameters at which each start ended."""

from __future__ import annotations

from dataclasses import dataclass

from rigd.analysis.report.rounding import number
from rigd.analysis.result import IdentificationResult, StartOutcome

#: Starts whose cost is within this share of the lowest found the same minimum.
SAME_MINIMUM = 1e-3


@dataclass(frozen=True)
class StartLine:
    """One start: its cost over the lowest, and its end (and begin) per parameter."""

    cost: str
    rise: str
    best: bool
    converged: bool
    iterations: int
    ends: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class StartTable:
    """All starts, the lowest cost first; ``loose`` marks columns the data do not determine."""

    sentence: str
    names: tuple[tuple[str, str], ...]
    loose: tuple[bool, ...]
    lines: tuple[StartLine, ...]


def start_table(result: IdentificationResult) -> StartTable | None:
    """Return the table of ``result.starts``, or None if there are none."""
    if not result.starts:
        return None
    ordered = sorted(result.starts, key=lambda start: start.cost)
    lowest = ordered[0].cost
    same = sum(_rise(start, lowest) <= SAME_MINIMUM for start in ordered)
    stopped = sum(not start.converged for start in ordered)
    names = tuple(dict.fromkeys(name for start in ordered for name in start.end))
    known = {p.name: p for p in (*result.parameters, *result.derived)}
    return StartTable(
        sentence=_sentence(len(ordered), same, stopped),
        names=tuple((name, known[name].unit if name in known else "") for name in names),
        loose=tuple(name in known and known[name].quoted is None for name in names),
        lines=tuple(_line(start, lowest, names) for start in ordered),
    )


def _sentence(count: int, same: int, stopped: int) -> str:
    text = f"{same} of {count} starts reached the lowest cost to within {100 * SAME_MINIMUM:g} %"
    if stopped:
        text += f"; {stopped} stopped before they had converged"
    if count > 1 and same == 1:
        text += ". Only one start found it: the minimum may not be the global one"
    return f"{text}."


def _rise(start: StartOutcome, lowest: float) -> float:
    return (start.cost - lowest) / abs(lowest) if lowest else start.cost


def _line(start: StartOutcome, lowest: float, names: tuple[str, ...]) -> StartLine:
    rise = _rise(start, lowest)
    return StartLine(
        cost=number(start.cost),
        rise="lowest" if start.cost == lowest else f"+{100 * rise:.2g} %",
        best=rise <= SAME_MINIMUM,
        converged=start.converged,
        iterations=start.iterations,
        ends=tuple((_value(start.end.get(name)), _value(start.start.get(name))) for name in names),
    )


def _value(value: float | None) -> str:
    return "–" if value is None else number(value)
