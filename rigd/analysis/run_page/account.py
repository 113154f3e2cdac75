"""Describes in words how a run went: its facts, trials and events, and warnings for the reader."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from rigd.analysis.report.rounding import count, number
from rigd.analysis.run_page.figures import StepSpan
from rigd.analysis.run_page.groups import shown_value
from rigd.analysis.run_page.samples import Attempt, Samples
from rigd.record import Event, Recording, RunInfo, Step, TrialInfo
from rigd.record.events.trials import INTERRUPTED
from rigd.record.read.info import COMPLETE

#: Kinds of events that stand elsewhere on the page: in the figures and the table of trials.
_ELSEWHERE: Final = frozenset({"step", "trial_start", "trial_end"})
#: Kinds of events that are drawn within a trial.
_MARKED: Final = frozenset({"interlock", "fault", "late"})
#: So many events are listed.
_LISTED: Final = 300
#: Letters of an event's data that are shown.
_LETTERS: Final = 300

Fact = tuple[str, str]


@dataclass(frozen=True)
class TrialRow:
    """One attempt at a trial, as text."""

    number: int
    repeat: str
    parameters: tuple[str, ...]
    complete: bool
    ended: str
    start: str
    seconds: str
    clipped: str
    stale: str


@dataclass(frozen=True)
class EventRow:
    """One event, as text."""

    at: str
    trial: str
    kind: str
    text: str


def facts(
    recording: Recording, info: RunInfo, events: Sequence[Event], samples: Samples
) -> tuple[Fact, ...]:
    """Return the facts on the run as a whole."""
    acted = Counter(str(e.data.get("name", "")) for e in events if e.kind == "interlock")
    missed = sum(_whole(event.data.get("missed_slots")) for event in events if event.kind == "late")
    stale = sum(samples.stale.values())
    found = [
        ("Took", "never armed" if info.took_s is None else f"{info.took_s:.1f} s"),
        ("Samples", count(sum(stream.rows for stream in info.streams))),
        ("Size of the file", f"{info.size / 1e6:.1f} MB"),
        ("Interlocks that acted", _counted(acted) or "none"),
        ("Setpoints cut by a limit", ", ".join(sorted(_cut(events))) or "none"),
        ("Cycles missed", count(missed)),
        ("Rows that repeat an earlier one (stale), in trials", count(stale)),
    ]
    return tuple(found)


def same_in_all(trials: Sequence[TrialInfo], names: Sequence[str]) -> tuple[Fact, ...]:
    """Return the parameters besides ``names``, which all trials have in common."""
    known = dict.fromkeys(name for trial in trials for name in trial.parameters)
    return tuple((name, shown_value(trials[0], name)) for name in known if name not in names)


def warnings(info: RunInfo, events: Sequence[Event]) -> tuple[str, ...]:
    """Return what a person must know before they use the page."""
    found = []
    if not events and not info.procedure:
        found.append("This is no recording of a run: it has no events and names no procedure.")
    elif info.state == INTERRUPTED:
        found.append("The run has no end: it was interrupted, or goes on while this is written.")
    elif info.state != COMPLETE:
        found.append(f"The run ended as {info.state}{f': {info.reason}' if info.reason else ''}.")
    if not info.trials:
        found.append("No trial began: the figure shows the whole recording.")
    return tuple(found)


def trial_rows(
    info: RunInfo, names: Sequence[str], events: Sequence[Event], samples: Samples
) -> tuple[TrialRow, ...]:
    """Return a row for each attempt, with the parameters ``names``."""
    origin = info.trials[0].start_ns if info.trials else 0
    cut = _cut_in_trials(info.trials, events)
    return tuple(
        TrialRow(
            number=trial.number,
            repeat="" if trial.repeat is None else str(trial.repeat),
            parameters=tuple(shown_value(trial, name) for name in names),
            complete=trial.complete,
            ended=how_ended(trial),
            start=f"{(trial.start_ns - origin) * 1e-9:.1f}",
            seconds="" if trial.end_ns is None else f"{(trial.end_ns - trial.start_ns) * 1e-9:.2f}",
            clipped=", ".join(sorted(cut[index])),
            stale=count(samples.stale.get(index, 0)) if samples.stale.get(index) else "",
        )
        for index, trial in enumerate(info.trials)
    )


def how_ended(trial: TrialInfo) -> str:
    """Return what ended an attempt, and what of it is lost."""
    if trial.lost:
        return f"{trial.reason}; {trial.lost}" if trial.reason else trial.lost
    return trial.reason or ("" if trial.complete else "the recording ends within it")


def event_rows(recording: Recording, events: Sequence[Event]) -> tuple[tuple[EventRow, ...], int]:
    """Return the events to list, and how many more there are."""
    listed = [event for event in events if event.kind not in _ELSEWHERE]
    rows = tuple(
        EventRow(
            at=f"{(event.t_ns - recording.start_ns) * 1e-9:.3f}",
            trial="" if event.trial < 0 else str(event.trial),
            kind=event.kind.replace("_", " "),
            text=_told(event.data),
        )
        for event in listed[:_LISTED]
    )
    return rows, len(listed) - len(rows)


def steps_of(attempt: Attempt, played: Sequence[Step]) -> list[StepSpan]:
    """Return the steps that were played in an attempt."""
    return [
        StepSpan(
            (step.start_ns - attempt.start_ns) * 1e-9,
            (min(step.end_ns or attempt.end_ns, attempt.end_ns) - attempt.start_ns) * 1e-9,
            step.name,
        )
        for step in played
        if attempt.start_ns <= step.start_ns < attempt.end_ns
    ]


def marks_of(attempt: Attempt, events: Sequence[Event]) -> list[tuple[float, str]]:
    """Return when something happened in an attempt that should not, and what, in s since it began.

    A setpoint that is being cut counts from the moment it is.
    """
    marks = []
    for event in events:
        if not _within(attempt, event):
            continue
        at = (event.t_ns - attempt.start_ns) * 1e-9
        cut = event.data.get("setpoints") if event.kind == "limit" else None
        if event.kind in _MARKED:
            name = event.data.get("name") or event.data.get("reason") or ""
            marks.append((at, f"{event.kind} {name}".strip()))
        elif cut:
            marks.append((at, f"limit cuts {', '.join(map(str, cut))}"))
    return marks[:20]


def _within(attempt: Attempt, event: Event) -> bool:
    return attempt.start_ns <= event.t_ns < attempt.end_ns


def _cut(events: Sequence[Event]) -> set[str]:
    """Return the setpoints that a limit has cut."""
    return {
        str(name)
        for event in events
        if event.kind == "limit"
        for name in event.data.get("setpoints") or ()
    }


def _cut_in_trials(trials: Sequence[TrialInfo], events: Sequence[Event]) -> list[set[str]]:
    """Return for each attempt the setpoints that a limit has cut in it."""
    found: list[set[str]] = [set() for _ in trials]
    limits = [event for event in events if event.kind == "limit" and event.data.get("setpoints")]
    for cut, trial in zip(found, trials, strict=True):
        end = trial.end_ns
        for event in limits:
            if trial.start_ns <= event.t_ns and (end is None or event.t_ns < end):
                cut.update(map(str, event.data["setpoints"]))
    return found


def _told(data: Mapping[str, Any]) -> str:
    """Return the data of an event as a line."""
    parts = []
    for name, value in data.items():
        if value in ("", None, [], {}):
            continue
        if isinstance(value, float):
            text = number(value)
        else:
            text = value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
        parts.append(f"{name.replace('_', ' ')}: {text}")
    line = "; ".join(parts)
    return line if len(line) <= _LETTERS else f"{line[: _LETTERS - 1]}…"


def _counted(names: Counter[str]) -> str:
    return ", ".join(f"{name} ({times}×)" if times > 1 else name for name, times in names.items())


def _whole(value: object) -> int:
    return value if isinstance(value, int) else 0
