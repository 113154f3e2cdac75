"""Finds the column of the times of a table, and what a map must state of it."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rigd.importing.proposal.columns import SeenColumn
from rigd.importing.proposal.lines import MapLine, quoted
from rigd.model.units import parse_unit

_TIME: Final = re.compile(
    r"\(time\)|t|x_value|.*(time|zeit|temps|tiempo|tempo|stamp|date|datum|elapsed|millis|micros"
    r"|seconds?\b|secs?\b).*"
)
#: Forms of dates and of times of a day, as Python writes them; two that read the same differ.
_FORMS: Final = (
    "%Y-%m-%d %H:%M:%S,%f", "%Y/%m/%d %H:%M:%S.%f", "%Y/%m/%d %H:%M:%S", "%d.%m.%Y %H:%M:%S.%f",
    "%d.%m.%Y %H:%M:%S,%f", "%d.%m.%Y %H:%M:%S", "%d/%m/%Y %H:%M:%S.%f", "%m/%d/%Y %H:%M:%S.%f",
    "%d/%m/%Y %H:%M:%S", "%m/%d/%Y %H:%M:%S", "%m/%d/%Y %I:%M:%S.%f %p", "%m/%d/%Y %I:%M:%S %p",
    "%H:%M:%S.%f", "%H:%M:%S,%f", "%H:%M:%S",
)  # fmt: skip
_DATE: Final = "%Y"
_MOST_TEXTS: Final = 200
_LATEST_YEAR: Final = 2040
#: A logger has rows no farther apart, in s: else a count would be taken for a date.
_STEP_S: Final = 1.5
#: Zeros of clocks, and the unit in which their times are usual.
_ZEROS: Final = (
    ("1970-01-01", "s"), ("1970-01-01", "ms"), ("1970-01-01", "us"), ("1970-01-01", "ns"),
    ("1904-01-01", "s"), ("1899-12-30", "d"), ("0000-01-00", "d"),
)  # fmt: skip
#: The day of 1970 in the two of them that count days or have another zero, in s before 1970.
_BEFORE_S: Final = {
    "1970-01-01": 0.0, "1904-01-01": 2_082_844_800.0, "1899-12-30": 25_569 * 86_400.0,
    "0000-01-00": 719_529 * 86_400.0,
}  # fmt: skip
_EARLIEST_S: Final = 631_152_000.0  #: 1990
#: So much of the rows has the time of the row before, if the clock is coarser than the rate.
_COARSE: Final = 1 / 3


@dataclass
class ProposedTimes:
    """The column of the times, None for a rate, with the lines below `time:` of the map.

    ``dated``: they show which day it was.
    """

    column: SeenColumn | None
    lines: list[MapLine] = field(default_factory=list)
    dated: bool = False


def find_clock(columns: Sequence[SeenColumn], names: Sequence[str]) -> ProposedTimes:
    """Return the times of a table; a rate that is to be filled in, if no column has any."""
    best = max(columns, key=_likelihood, default=None)
    if best is None or not _likelihood(best):
        why = "no column looks like times: state samples per second, or name the column of times"
        return ProposedTimes(None, [MapLine("rate", "1 Hz", why, asks=True)])
    clock = ProposedTimes(best, [MapLine("column", quoted(best.written(names)))])
    if best.values is None:
        _state_dates(clock, best.texts)
        return clock
    values = np.asarray(best.values, np.float64)
    if best.moment:
        clock.dated = True
        clock.lines[0].note = f"moments; {_steps(values * 1e-9)}"
        return clock
    _state_numbers(clock, best, values)
    steps = np.diff(values)
    if len(steps) and np.mean(steps == 0) >= _COARSE:
        why = f"{np.mean(steps == 0):.0%} of the rows have the time of the row before"
        clock.lines.append(MapLine("coarse", "spread", why))
    return clock


def is_time(column: SeenColumn) -> bool:
    """Return whether a column can be the times of a table, by its name, unit and values."""
    return _likelihood(column) > 0


def _likelihood(column: SeenColumn) -> int:
    """Return how likely a column has the times, 0 for not at all; of equals, the first counts."""
    named = _TIME.fullmatch(column.bare.lower()) is not None
    if column.values is None:
        return 6 if column.texts and _forms(column.texts) else 0
    if column.moment or column.name == "(time)":
        return 8
    of_time = column.unit is not None and column.unit.same_kind(parse_unit("s"))
    if column.unit is not None and not of_time:
        return 0
    steps = np.diff(column.values)
    if not np.any(steps > 0) or np.any(np.isnan(steps)):
        return 0
    if named and np.mean(steps >= 0) > 0.9:
        return 5 if of_time else 4
    if of_time and np.all(steps >= 0):
        return 3
    even = np.all(steps > 0) and np.median(steps) * 2 > np.max(steps)
    return 1 if even and not named and column.index == 0 else 0


def _state_numbers(clock: ProposedTimes, column: SeenColumn, values: NDArray[np.float64]) -> None:
    named = column.unit_in_name
    unit = column.unit.symbol if column.unit is not None else named
    zeros = [
        (since, written)
        for since, written in _ZEROS
        if (written == unit if unit is not None else True) and _is_recent(values, since, written)
    ]
    note = f"by its name; {_span(values, named)}" if named else _span(values, unit)
    if unit is None and len(zeros) == 1:
        unit, note = zeros[0][1], f"by its values; {_span(values, zeros[0][1])}"
        clock.lines.append(MapLine("unit", unit, note))
    elif unit is None:
        word = "the file states no unit that rigd knows"
        if column.stated:
            word = f"the file states the unit {column.stated!r}, which rigd does not know"
        if _likelihood(column) == 1:
            word = f"if this column has the times, for it only rises; {word}"
        clock.lines.append(MapLine("unit", _usual(values), f"{word}; {_rates(values)}", asks=True))
    elif column.unit is None:
        clock.lines.append(MapLine("unit", unit, note))
    else:
        clock.lines[0].note = note
    if len(zeros) == 1 and (unit in ("d", zeros[0][1])):
        since, written = zeros[0]
        seconds = values[0] * parse_unit(written).factor - _BEFORE_S[since]
        day = f"{np.datetime64(round(seconds), 's')}".replace("T", " ")
        clock.lines.append(MapLine("since", since, f"the first time is then {day}"))
        clock.dated = True


def _is_recent(values: NDArray[np.float64], since: str, unit: str) -> bool:
    """Return whether all times lie between 1990 and 2040, with usual steps."""
    seconds = np.asarray(values, np.float64) * parse_unit(unit).factor - _BEFORE_S[since]
    latest = (np.datetime64(str(_LATEST_YEAR), "s") - np.datetime64(0, "s")).astype(float)
    steps = np.abs(np.diff(seconds))
    usual = float(np.median(steps)) if len(steps) else 0.0
    return bool(np.all((seconds > _EARLIEST_S) & (seconds < latest)) and usual <= _STEP_S)


def _forms(texts: Sequence[str]) -> list[str]:
    """Return the forms of dates that fit all of ``texts``."""
    some = [*texts[:_MOST_TEXTS], *texts[-_MOST_TEXTS:]]
    found = []
    for form in ("iso", *_FORMS):
        try:
            for text in some:
                if form == "iso":
                    datetime.fromisoformat(text)
                else:
                    datetime.strptime(text, form)
        except ValueError:
            continue
        found.append(form)
    return found


def _state_dates(clock: ProposedTimes, texts: Sequence[str]) -> None:
    forms = _forms(texts)
    form = forms[0]
    if len(forms) > 1 and form != "iso":
        why = f"{texts[0]} may be {' or '.join(forms)}"
        clock.lines.append(MapLine("format", quoted(form), why, asks=True))
        clock.dated = True
        return
    clock.lines.append(MapLine("format", quoted(form), f"such as {texts[0]}"))
    if form != "iso" and _DATE not in form:
        why = "the day of the first row, such as 2025-03-03; the file states none"
        clock.lines.append(MapLine("since", "2000-01-01", why, asks=True))
    clock.dated = True


def _span(values: NDArray[np.float64], unit: str | None) -> str:
    factor = parse_unit(unit).factor if unit else 1.0
    return _steps(np.asarray(values) * factor)


def _steps(seconds: NDArray[np.float64]) -> str:
    """Return step, rate and jitter of times in s, in words."""
    steps = np.diff(seconds)
    usual = float(np.median(steps[steps > 0])) if np.any(steps > 0) else 0.0
    if not usual:
        return "all rows have the same time" if len(steps) else "one row"
    low, high = (float(item) for item in np.percentile(steps, (1, 99)))
    text = f"steps of {usual:.4g} s, {1 / usual:.4g} Hz"
    uneven = max(high - usual, usual - low) / usual
    return f"{text}, jitter {uneven:.1%}" if uneven > 1e-3 else f"{text}, even"


def _usual(values: NDArray[np.float64]) -> str:
    """Return the longest unit in which the rows lie no farther apart than those of a logger do."""
    steps = np.abs(np.diff(values))
    usual = float(np.median(steps)) if len(steps) else 0.0
    units = ("s", "ms", "us", "ns")
    return next((unit for unit in units if usual * parse_unit(unit).factor <= _STEP_S), "ns")


def _rates(values: NDArray[np.float64]) -> str:
    """Return what rate each unit would mean."""
    steps = np.diff(values)
    usual = float(np.median(steps[steps > 0])) if np.any(steps > 0) else 0.0
    if not usual:
        return "all rows have the same time"
    factors: Mapping[str, float] = {"s": 1.0, "ms": 1e-3, "us": 1e-6}
    rates = ", ".join(f"{1 / (usual * f):.4g} Hz if {unit}" for unit, f in factors.items())
    return f"from {values[0]:.9g} to {values[-1]:.9g} in steps of {usual:.4g}: {rates}"
