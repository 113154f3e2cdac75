"""Shows measures: as text for a terminal and a page, as JSON, and as columns of the trials."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from rigd.analysis.measures.result import (
    MeasureResult,
    Summary,
    TrialReading,
    UsedConstants,
)
from rigd.analysis.measures.trend import FALSE_ALARM
from rigd.model.units import parse_unit, si_symbol
from rigd.procedure.conditions.condition_text import describe_until, describe_window
from rigd.procedure.program import Measure

#: What the intervals hold, and what not; stands below every table.
REPEATABILITY: Final = (
    "95 % interval of the mean: repeatability only (type A). Errors that are the same in all "
    "trials, such as those of a calibration, are not in it: state them as 'u' of the measure."
)
SYSTEMATIC: Final = (
    "95 % interval of the mean: repeatability (type A) and the stated uncertainty 'u', which no "
    "repeat makes smaller."
)
#: Stands below a table with a trend.
TREND: Final = (
    "A measure that rises or falls: by the slope over the trials as played (t test), which names "
    f"1 in {1 / FALSE_ALARM:.0f} results that have no trend. s and the interval take the drift for "
    "scatter. A rig that warms up drifts so: wait longer before the first trial."
)
_NONE: Final = "–"


@dataclass(frozen=True)
class ResultLine:
    """A summary as text: one row of the table."""

    name: str
    setpoints: str
    count: str
    mean: str
    std: str
    interval: str
    accept: str
    verdict: str
    why: str


@dataclass(frozen=True)
class TrialLine:
    """A trial as text: a cell for each measure."""

    trial: str
    setpoints: str
    cells: tuple[str, ...]


@dataclass(frozen=True)
class MeasuresView:
    """All measures as text: what they are, each trial, each result, and remarks."""

    about: tuple[tuple[str, str], ...]  #: name and description
    headings: tuple[str, ...]
    trials: tuple[TrialLine, ...]
    lines: tuple[ResultLine, ...]
    remarks: tuple[str, ...]
    verdict: str  #: on all together; "" if nothing is demanded
    unread: str  #: names the measures that have no value at all; "" if there are none


def view_of(result: MeasureResult) -> MeasuresView:
    """Return ``result`` as text."""
    measures = {item.measure.name: item.measure for item in result.summaries}
    rows: dict[tuple[str, Path, int], dict[str, TrialReading]] = {}
    files = {reading.recording for item in result.summaries for reading in item.readings}
    remarks: dict[str, list[str]] = {}
    for item in result.summaries:
        for reading in item.readings:
            key = (_setpoints(item.setpoints), reading.recording, reading.trial)
            rows.setdefault(key, {})[item.measure.name] = reading
            if text := reading.reason or reading.note:
                remarks.setdefault(f"{item.measure.name}: {text}", []).append(
                    _trial(reading, files)
                )
    trials = tuple(
        TrialLine(
            _trial(next(iter(cells.values())), files),
            key[0],
            tuple(_cell(measures[name], cells.get(name)) for name in measures),
        )
        for key, cells in sorted(rows.items(), key=lambda row: row[0][1:])
    )
    notes = _of_intervals(measures)
    notes += [_of_constants(item, measures[item.measure]) for item in result.constants]
    if any(item.trend for item in result.summaries):
        notes.append(TREND)
    return MeasuresView(
        about=tuple((name, describe(item)) for name, item in measures.items()),
        headings=tuple(_with_unit(name, item.unit) for name, item in measures.items()),
        trials=trials,
        lines=tuple(map(_line, result.summaries)),
        remarks=(*(f"{text} (trial {_few(at)})" for text, at in remarks.items()), *notes),
        verdict="" if result.judgement is None else result.judgement.value,
        unread=f"read in no trial: {', '.join(result.unread)}" if result.unread else "",
    )


def describe(measure: Measure) -> str:
    """Return what a measure is, in words, behind what its author calls it."""
    text = definition(measure)
    return f"{measure.doc}: {text}" if measure.doc else text


def definition(measure: Measure) -> str:
    """Return how a measure is read off a trial, in words."""
    if measure.kind == "channel":
        text = f"{measure.channel} when {describe_until(measure.when)}"
    elif measure.kind == "duration":
        begin = describe_until(measure.since) if measure.since else "the beginning"
        text = f"time from {begin} to {describe_until(measure.when)}"
    else:
        text = f"{measure.kind.replace('_', ' ')} of {measure.channel}"
    return f"{text}, during {describe_window(measure.window)}"


def result_json(result: MeasureResult) -> dict[str, Any]:
    """Return ``result`` for ``json.dumps``: numbers in SI, None for what is not determined."""
    return {
        "verdict": None if result.judgement is None else result.judgement.value,
        "results": [_summary_json(item) for item in result.summaries],
    }


def trial_columns(result: MeasureResult) -> dict[str, tuple[str, dict[int, float]]]:
    """Return for each measure of one recording its SI unit and its value by number of trial."""
    found: dict[str, tuple[str, dict[int, float]]] = {}
    for item in result.summaries:
        _, values = found.setdefault(item.measure.name, (_si(item.measure), {}))
        values |= {
            reading.trial: reading.value for reading in item.readings if reading.value is not None
        }
    return found


def verdict_text(item: Summary) -> str:
    """Return a result and its verdict in one line, for a test case or a log."""
    line = _line(item)
    parts = [f"{line.verdict or 'not read'}: mean {line.mean}"]
    parts += [f"95 % interval {line.interval}"] if line.interval != _NONE else []
    parts += [f"must be {line.accept}"] if line.accept else []
    return ", ".join(parts) + (f" ({line.why})" if line.why else "")


def label(item: Summary) -> str:
    """Return the name of a result with its setpoints: ``mu, floor pvc``."""
    setpoints = _setpoints(item.setpoints)
    return f"{item.measure.name}, {setpoints}" if setpoints else item.measure.name


def _si(measure: Measure) -> str:
    return si_symbol(parse_unit(measure.unit).dimension)


def _summary_json(item: Summary) -> dict[str, Any]:
    measure = item.measure
    accept = [None if math.isinf(bound) else bound for bound in (measure.low, measure.high)]
    return {
        "measure": measure.name,
        "is": describe(measure),
        "unit": _si(measure),
        "shown_in": measure.unit,
        "setpoints": dict(item.setpoints),
        "trials": [
            {
                "recording": str(reading.recording),
                "trial": reading.trial,
                "value": reading.value,
                "u": reading.u,
                "reason": reading.reason or reading.note,
            }
            for reading in item.readings
        ],
        "count": item.count,
        "mean": item.mean,
        "std": item.std,
        "systematic": item.systematic,
        "low": item.low,
        "high": item.high,
        "accept": accept if measure.is_judged else None,
        "verdict": None if item.judgement is None else item.judgement.value,
        "why": item.why,
        "runs": item.runs,
        "trend_per_trial": None if item.trend is None else item.trend.per_trial,
    }


def _line(item: Summary) -> ResultLine:
    measure = item.measure
    digits = _digits(measure, item.std, item.high, item.low)
    interval = _NONE
    if item.low is not None and item.high is not None:
        interval = f"{_number(measure, item.low, digits)} to {_number(measure, item.high, digits)}"
    of = len(item.readings)
    return ResultLine(
        _with_unit(measure.name, measure.unit),
        _setpoints(item.setpoints),
        str(of) if item.count == of else f"{item.count} of {of}",
        _NONE if item.mean is None else _number(measure, item.mean, digits),
        _NONE if item.std is None else _difference(measure, item.std),
        interval,
        _bounds(measure),
        "" if item.judgement is None else item.judgement.value,
        _why(item),
    )


def _why(item: Summary) -> str:
    parts = [item.why] if item.why else []
    if item.runs is not None:
        parts.append(f"the interval is that of the means of {item.runs} runs")
    if item.trend is not None:
        word = "rises" if item.trend.per_trial > 0 else "falls"
        step = _difference(item.measure, abs(item.trend.per_trial))
        unit = parse_unit(item.measure.unit).difference().symbol
        parts.append(f"{word} by {step} {unit}".removesuffix(" 1") + " with each trial")
    return "; ".join(parts)


def _of_intervals(measures: Mapping[str, Measure]) -> list[str]:
    """Return what the intervals hold: of all measures, or of each kind by name."""
    stated = [name for name, item in measures.items() if item.systematic is not None]
    others = [name for name in measures if name not in stated]
    if not stated:
        return [REPEATABILITY]
    if not others:
        return [SYSTEMATIC]
    return [
        text.replace("of the mean:", f"of the mean of {', '.join(names)}:", 1)
        for text, names in ((SYSTEMATIC, stated), (REPEATABILITY, others))
    ]


def _of_constants(used: UsedConstants, measure: Measure) -> str:
    """Return which constants a measure rests on, and what of them is in its interval."""
    parts = []
    if used.uncertain:
        names = ", ".join(f"rig.{name}" for name in used.uncertain)
        stated = "is in the interval only as far as 'u' of the measure holds it"
        if measure.systematic is None:
            stated = "is not in the interval: state what it gives as 'u' of the measure"
        parts.append(f"the stated 'u' of {names} {stated}")
    if used.exact:
        names = ", ".join(f"rig.{name}" for name in used.exact)
        parts.append(f"{names} without 'u' counts as exact")
    return f"{used.measure} rests on constants: {'; '.join(parts)}."


def _bounds(measure: Measure) -> str:
    if not measure.is_judged:
        return ""
    low, high = (f"{_shown(measure, bound):.6g}" for bound in (measure.low, measure.high))
    if math.isinf(measure.low):
        return f"at most {high}"
    return f"at least {low}" if math.isinf(measure.high) else f"{low} to {high}"


def _cell(measure: Measure, reading: TrialReading | None) -> str:
    if reading is None or reading.value is None:
        return _NONE
    if not reading.u:
        return f"{_shown(measure, reading.value):.5g}"
    scale = reading.u / parse_unit(measure.unit).difference().factor
    digits = max(0, 1 - math.floor(math.log10(scale)))
    return f"{_number(measure, reading.value, digits)} ± {scale:.{digits}f}"


def _digits(
    measure: Measure, std: float | None, high: float | None, low: float | None
) -> int | None:
    """Return the decimals that show two digits of the interval; None: no interval has a width."""
    width = (high - low) / 2 if high is not None and low is not None else std
    if not width:
        return None
    scale = width / parse_unit(measure.unit).difference().factor
    return max(0, 1 - math.floor(math.log10(scale)))


def _number(measure: Measure, value: float, digits: int | None) -> str:
    shown = _shown(measure, value)
    return f"{shown:.5g}" if digits is None or digits > 12 else f"{shown:.{digits}f}"


def _shown(measure: Measure, value: float) -> float:
    return parse_unit(measure.unit).from_si(value)


def _difference(measure: Measure, value: float) -> str:
    return f"{value / parse_unit(measure.unit).factor:.2g}"


def _with_unit(name: str, unit: str) -> str:
    return name if unit == "1" else f"{name} [{unit}]"


def _setpoints(given: Mapping[str, str]) -> str:
    return ", ".join(f"{name} {text}" for name, text in given.items())


def _trial(reading: TrialReading, files: set[Path]) -> str:
    return str(reading.trial) if len(files) == 1 else f"{reading.recording.stem} {reading.trial}"


def _few(numbers: Sequence[str]) -> str:
    return ", ".join(numbers) if len(numbers) <= 6 else f"{', '.join(numbers[:5])} and others"
