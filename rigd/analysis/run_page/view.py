"""Builds the content of a run page: converts samples and events to rows, sentences and drawings.

Importing this module imports matplotlib. :mod:`rigd.analysis.run_page.report` imports this module
only when a page is requested.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from rigd.analysis.measures import measured_if_any
from rigd.analysis.measures.view import MeasuresView, view_of
from rigd.analysis.report.layout import spread
from rigd.analysis.report.plots.axes import words
from rigd.analysis.report.rounding import number
from rigd.analysis.report.svg import Drawing, draw
from rigd.analysis.report.trace import COLUMNS
from rigd.analysis.run_page import figures
from rigd.analysis.run_page.account import (
    EventRow,
    Fact,
    TrialRow,
    event_rows,
    facts,
    how_ended,
    marks_of,
    same_in_all,
    steps_of,
    trial_rows,
    warnings,
)
from rigd.analysis.run_page.bounds import SETPOINT, Bound, Bounds, bounds_of, recorded_during
from rigd.analysis.run_page.figures import Shown
from rigd.analysis.run_page.groups import Groups, groups_of, varying
from rigd.analysis.run_page.samples import Attempt, Samples, gather, shared_time, shown_streams
from rigd.model.errors import RigdError
from rigd.record import Event, Recording, RunInfo, Step, steps

#: Up to so many trials each is a line in the figure of all; more become bands.
LINES: Final = 30
#: So many trials are drawn one by one unless others are asked for, and so many panels in all: the
#: page of any campaign stays small and takes seconds.
FEW: Final = 6
LEAST: Final = 2
PANELS: Final = 60


@dataclass(frozen=True)
class RunTrialView:
    """One trial: a line if it is closed on the page, a drawing if it is open."""

    label: str
    ended: str
    drawing: Drawing


@dataclass(frozen=True)
class ChannelRow:
    """A channel with its extremes in the trials, and the bounds that apply to it."""

    name: str
    unit: str
    least: str
    greatest: str
    bounds: tuple[str, ...]
    passed: bool  #: whether a bound was passed
    doc: str


@dataclass(frozen=True)
class RunPageView:
    """The whole page."""

    info: RunInfo
    total: str
    facts: tuple[Fact, ...]
    warnings: tuple[str, ...]
    timeline: Drawing | None
    parameters: tuple[str, ...]  #: those that differ between trials
    same: tuple[Fact, ...]  #: those that do not
    rows: tuple[TrialRow, ...]
    measures: MeasuresView | None
    measures_problem: str
    overview: Drawing | None
    plane: Drawing | None  #: the paths of bodies, if the recording has poses
    trials: tuple[RunTrialView, ...]
    left: int  #: trials that are not drawn one by one
    channels: tuple[ChannelRow, ...]
    steady: tuple[str, ...]
    bounds_problem: str
    events: tuple[EventRow, ...]
    more_events: int
    identifies: str  #: the model of the identification, empty without one


def build_view(recording: Recording, info: RunInfo, numbers: frozenset[int] | None) -> RunPageView:
    """Return the view of a recording, for :func:`rigd.analysis.report.page.render`."""
    events = recording.events()
    attempts = _attempts(recording, info)
    groups, names = groups_of(info), varying(info.trials)
    chosen = _chosen(info, numbers, _few(recording))
    lines = len(attempts) <= LINES
    played = steps(events)
    draw_at = dict.fromkeys((attempt.index for attempt in attempts), COLUMNS // 2) if lines else {}
    draw_at |= dict.fromkeys(chosen, COLUMNS)
    time = shared_time(attempts, played, recorded_during(recording))
    samples = gather(recording, attempts, time, {} if lines else groups.of, draw_at)
    bounds = bounds_of(recording)
    shown, steady = _panels(recording, samples)
    rows, more = event_rows(recording, events)
    measures, measures_problem = _measures(recording)
    return RunPageView(
        info=info,
        total=info.metadata.get("run", {}).get("trials", ""),
        facts=facts(recording, info, events, samples),
        warnings=warnings(info, events),
        timeline=_timeline(recording, info, events),
        parameters=tuple(names),
        same=same_in_all(info.trials, names),
        rows=trial_rows(info, names, events, samples),
        measures=measures,
        measures_problem=measures_problem,
        overview=_overview(shown, samples, attempts, groups, bounds) if info.trials else None,
        plane=_plane(samples, groups),
        trials=tuple(
            _trial(attempts[index], info, events, played, samples, shown, bounds)
            for index in chosen
        ),
        left=len(info.trials) - len([index for index in chosen if info.trials]),
        channels=_channels(recording, samples, bounds),
        steady=steady,
        bounds_problem=bounds.problem,
        events=rows,
        more_events=more,
        identifies=info.metadata.get("identify", {}).get("model", ""),
    )


def _measures(recording: Recording) -> tuple[MeasuresView | None, str]:
    """Return what the procedure measures, as text, and why it could not be read."""
    try:
        result = measured_if_any(recording)
    except RigdError as error:  # of another version of rigd, or damaged: the page is drawn
        return None, f"What the procedure measures could not be read: {error.message}"
    return (None if result is None else view_of(result)), ""


def _attempts(recording: Recording, info: RunInfo) -> list[Attempt]:
    """Return the attempts at trials; if none began, the whole recording as one."""
    end = recording.end_ns + 1
    found = [
        Attempt(index, trial.start_ns, end if trial.end_ns is None else trial.end_ns)
        for index, trial in enumerate(info.trials)
    ]
    return found or [Attempt(0, recording.start_ns, end)]


def _few(recording: Recording) -> int:
    """Return how many trials are drawn one by one: fewer of a rig with many channels."""
    panels = {
        (stream.name, channel.shown_in)
        for stream in shown_streams(recording)
        for channel in stream.channels
        if channel.raw_of is None
    }
    return max(LEAST, min(FEW, PANELS // max(len(panels), 1)))


def _chosen(info: RunInfo, numbers: frozenset[int] | None, few: int) -> list[int]:
    """Return the attempts to draw: those asked for, or some, those that ended early first."""
    if not info.trials:
        return [0]
    if numbers is not None:
        return [i for i, trial in enumerate(info.trials) if trial.number in numbers]
    early = [i for i, trial in enumerate(info.trials) if not trial.complete]
    whole = [i for i, trial in enumerate(info.trials) if trial.complete]
    # Half of the room at most for those that ended early, if others fill the rest.
    share = early[: max(few // 2, few - len(whole))]
    return sorted([*share, *whole[: few - len(share)]])


def _panels(recording: Recording, samples: Samples) -> tuple[list[Shown], tuple[str, ...]]:
    """Return the panels of every device, and the channels that never changed, with their value."""
    shown: list[Shown] = []
    steady: list[str] = []
    for stream in shown_streams(recording):
        peaks: dict[str, dict[str, float]] = {}
        for channel in stream.channels:
            name = f"{stream.name}.{channel.name}"
            if name not in samples.extremes:
                continue
            low, high = samples.extremes[name]
            if low == high:
                steady.append(f"{name} {number(low)} {channel.shown_in}".removesuffix(" 1"))
            else:
                peaks.setdefault(channel.shown_in, {})[channel.name] = max(abs(low), abs(high))
        shown += [Shown(stream.name, panel) for panel in spread(_together(peaks))]
    return shown, tuple(steady)


def _together(peaks: Mapping[str, Mapping[str, float]]) -> dict[str, dict[str, float]]:
    """Return the peaks with those of a setpoint as its channel's: they share an axis."""
    return {
        unit: {
            name: max(peak, of.get(name.removesuffix(SETPOINT), 0.0)) for name, peak in of.items()
        }
        for unit, of in peaks.items()
    }


def _timeline(recording: Recording, info: RunInfo, events: Sequence[Event]) -> Drawing | None:
    if not info.trials:
        return None
    start, end = recording.start_ns, recording.end_ns
    bars = [
        ((t.start_ns - start) * 1e-9, ((t.end_ns or end) - t.start_ns) * 1e-9, t.complete)
        for t in info.trials
    ]
    marks = [(event.t_ns - start) * 1e-9 for event in events if event.kind == "interlock"]
    early = sum(not trial.complete for trial in info.trials)
    alt = f"When each trial ({len(bars)}) was played; {early or 'none'} of them ended early."
    caption = "Blue, dark and light in turn: trials that played to their end."
    if early:
        caption += " Orange: trials that ended early."
    if marks:
        caption += " Dashed: an interlock acted."
    return draw(figures.timeline(bars, marks), "timeline", alt, caption)


def _overview(
    shown: Sequence[Shown],
    samples: Samples,
    attempts: Sequence[Attempt],
    groups: Groups,
    bounds: Bounds,
) -> Drawing | None:
    if not shown or len(attempts) < 2:
        return None
    figure = figures.all_trials(shown, samples, attempts, groups, _bounds_by_channel(bounds))
    what = "Bands reach from the least to the greatest value of all trials of a colour."
    if not samples.bands:
        what = "Each line is a trial; setpoints are dashed."
    by = f" Colours: {words(groups.by)}." if groups.by else ""
    if len(samples.time.origins_s) < len(attempts):
        by += f" {len(attempts) - len(samples.time.origins_s)} trials did not get that far."
    alt = f"Every channel of {len(attempts)} trials over the time since each began.{by}"
    return draw(figure, "overview", alt, f"{what}{by} Each point stands for its least and greatest "
                "sample: no peak is hidden.")  # fmt: skip


def _plane(samples: Samples, groups: Groups) -> Drawing | None:
    """Return the paths of all bodies in the plane; None if the recording has no poses."""
    extents = {
        body: [
            (float(np.nanmin(part)), float(np.nanmax(part)))
            for part in (
                np.concatenate([path.x for path in paths.values()]),
                np.concatenate([path.y for path in paths.values()]),
            )
        ]
        for body, paths in samples.paths.items()
    }
    if not extents:
        return None
    whole = [
        find(extent[axis][end] for extent in extents.values())
        for axis in (0, 1)
        for end, find in ((0, min), (1, max))
    ]
    reached = "; ".join(
        f"{words(body)}: x {number(x[0])} to {number(x[1])} m, y {number(y[0])} to {number(y[1])} m"
        for body, (x, y) in extents.items()
    )
    by = f" Colours: {words(groups.by)}." if groups.by else ""
    caption = (
        f"Both axes, and all planes, have one scale.{by} A dot: where a trial began. An arrow: "
        "where the body was at its end, and which way it headed. A path is interrupted while the "
        "body was not seen."
    )
    figure = figures.planes(samples.paths, whole, groups)
    return draw(
        figure, "plane", f"Paths in the plane, by the channels x and y. {reached}.", caption
    )


def _trial(
    attempt: Attempt,
    info: RunInfo,
    events: Sequence[Event],
    played: Sequence[Step],
    samples: Samples,
    shown: Sequence[Shown],
    bounds: Bounds,
) -> RunTrialView:
    spans = steps_of(attempt, played)
    marks = marks_of(attempt, events)
    traces = samples.traces.get(attempt.index, {})
    label, ended = "The whole recording", ""
    if info.trials:
        trial = info.trials[attempt.index]
        again = f", repeat {trial.repeat}" if (trial.repeat or 1) > 1 else ""
        label = f"Trial {trial.number}{again}"
        ended = how_ended(trial) or "complete"
    named = "; ".join(f"{step.name} {step.start_s:.2f} to {step.end_s:.2f} s" for step in spans)
    marked = "; ".join(f"{text} at {at:.3f} s" for at, text in marks)
    caption = f"Steps: {named}." if named else "No steps are recorded."
    if marked:
        caption += f" Dotted: {marked}."
    alt = f"{label}: {', '.join(sorted(traces))} over time."
    present = [item for item in shown if any(channel in traces for channel in item.channels)]
    if not present:
        figure = figures.empty("no samples were recorded in this trial")
    else:
        figure = figures.one_trial(
            present, traces, attempt.seconds, spans, [at for at, _ in marks],
            _bounds_by_channel(bounds),
        )  # fmt: skip
    return RunTrialView(label, ended, draw(figure, f"t{attempt.index}", alt, caption))


def _bounds_by_channel(bounds: Bounds) -> Mapping[str, list[Bound]]:
    found: dict[str, list[Bound]] = {}
    for bound in bounds.known:
        found.setdefault(bound.channel, []).append(bound)
    return found


def _channels(recording: Recording, samples: Samples, bounds: Bounds) -> tuple[ChannelRow, ...]:
    rows = []
    for stream in shown_streams(recording):
        for channel in stream.channels:
            name = f"{stream.name}.{channel.name}"
            if channel.raw_of is not None or name not in samples.extremes:
                continue
            low, high = samples.extremes[name]
            known = bounds.of(name)
            passed = any(bound.passed(low, high) for bound in known)
            texts = tuple(f"{'≤' if b.upper else '≥'} {number(b.value)} ({b.by})" for b in known)
            rows.append(ChannelRow(name, channel.shown_in, number(low), number(high), texts, passed,
                                   channel.doc))  # fmt: skip
    return tuple(rows)
