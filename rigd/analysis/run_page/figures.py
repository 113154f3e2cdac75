"""Draws the figures of a run: times of the trials, all trials overlaid, and each trial alone.

Importing this module imports matplotlib.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator

from rigd.analysis.report.layout import Panel
from rigd.analysis.report.palette import FITTED, INK, MEASURED, MUTED, series
from rigd.analysis.report.plots.axes import Margins, grid, unit_text, words
from rigd.analysis.report.trace import thin
from rigd.analysis.run_page.bounds import SETPOINT, Bound
from rigd.analysis.run_page.groups import Groups
from rigd.analysis.run_page.paths import BodyPath
from rigd.analysis.run_page.samples import Attempt, Samples, Trace

WIDTH: Final = 11.0
ROW_INCHES: Final = 1.32
#: Above the panels: the names of the steps, or the legend.
STRIP_INCHES: Final = 0.2
LETTER_INCHES: Final = 0.062  #: of the step's names
#: A bound further from the data than this share of their range would flatten them.
NEAR: Final = 0.6
#: Bounds closer together than this share share one label.
APART: Final = 0.15
#: A band that fills less than this share of its columns is drawn as dots.
SPARSE: Final = 0.5
#: Columns of one of several trials in one panel.
OVERLAY_COLUMNS: Final = 80
#: The height of a plane with bodies, and what it shows beyond their paths, as a share of these.
PLANE_INCHES: Final = 2.6
PLANE_ROOM: Final = 1.12
DASHED: Final = (0, (4, 2))


@dataclass(frozen=True)
class Shown:
    """Channels of one device on one axis."""

    stream: str
    panel: Panel

    @property
    def channels(self) -> tuple[str, ...]:
        """Their names as ``device.channel``."""
        return tuple(f"{self.stream}.{name}" for name in self.panel.names)


@dataclass(frozen=True)
class StepSpan:
    """The time span of a step of a trial, in s since the trial began."""

    start_s: float
    end_s: float
    name: str


def timeline(bars: Sequence[tuple[float, float, bool]], marks: Sequence[float]) -> Figure:
    """Return when the trials were: (start s, length s, complete) each; ``marks`` are events."""
    margins = Margins(left=0.3, top=0.12, bottom=0.42)
    figure, (ax,) = grid(1, 1, WIDTH, 0.95, margins=margins)
    # Every other one is lighter, so that trials without a pause between them stay apart.
    for first, alpha in ((0, 0.9), (1, 0.55)):
        for complete, shade in ((True, series(0)), (False, FITTED)):
            spans = [(start, length) for start, length, done in bars[first::2] if done is complete]
            if spans:
                ax.broken_barh(spans, (0.15, 0.7), color=shade, alpha=alpha, linewidth=0)
    for at in marks:
        ax.axvline(at, color=INK, linewidth=0.8, linestyle=DASHED)
    ax.set_ylim(0.0, 1.0)
    ax.yaxis.set_visible(False)
    ax.spines["left"].set_visible(False)
    ax.set_xlabel("time since the recording began [s]")
    return figure


def one_trial(
    shown: Sequence[Shown],
    traces: Mapping[str, Trace],
    seconds: float,
    steps: Sequence[StepSpan],
    marks: Sequence[float],
    bounds: Mapping[str, Sequence[Bound]],
) -> Figure:
    """Return every panel of one trial, its steps shaded and named, bounds and events drawn."""
    figure, axes = _sheet(shown, seconds, "time since the trial began [s]")
    for ax, item in zip(axes, shown, strict=True):
        _shade(ax, steps)
        plain = 0
        for name, channel in zip(item.panel.names, item.channels, strict=True):
            if channel not in traces:
                continue
            commanded = name.endswith(SETPOINT)
            trace = traces[channel]
            ax.plot(
                trace.t_s,
                trace.values,
                color=INK if commanded else series(plain),
                linestyle=DASHED if commanded else "solid",
                linewidth=0.9 if commanded else 1.1,
                label=words(name),
            )
            plain += not commanded
        for at in marks:
            ax.axvline(at, color=FITTED, linewidth=0.9, linestyle=(0, (1, 1.5)))
        _draw_bounds(ax, item, bounds)
        if len(item.panel.names) > 1:
            ax.legend(loc="best", ncols=2, fontsize=6.5)
    for ax in axes[:2]:
        _name_steps(figure, ax, steps, seconds)
    return figure


def all_trials(
    shown: Sequence[Shown],
    samples: Samples,
    attempts: Sequence[Attempt],
    groups: Groups,
    bounds: Mapping[str, Sequence[Bound]],
) -> Figure:
    """Return every panel with all trials over one another: lines of few, bands of many."""
    figure, axes = _sheet(shown, samples.time.seconds, f"time since {samples.time.since} [s]")
    for ax, item in zip(axes, shown, strict=True):
        for channel in item.channels:
            if samples.bands:
                _bands(ax, channel, samples, groups)
            else:
                _lines(ax, channel, samples, attempts, groups)
        _draw_bounds(ax, item, bounds)
    _name_groups(figure, groups)
    return figure


def planes(
    paths: Mapping[str, Mapping[int, BodyPath]], extent: Sequence[float], groups: Groups
) -> Figure:
    """Return a plane for each body with its paths, both axes and all planes to one scale.

    Args:
        paths: the paths by attempt of each body.
        extent: least and greatest x, least and greatest y of all, in m.
        groups: the colours of the attempts.
    """
    columns = min(2, len(paths))
    rows = math.ceil(len(paths) / columns)
    margins = Margins(top=0.24 + STRIP_INCHES + 0.1, down=0.62, bottom=0.42)
    height = margins.top + margins.bottom + rows * PLANE_INCHES + (rows - 1) * margins.down
    figure, axes = grid(rows, columns, WIDTH, height, margins=margins)
    for ax in axes[len(paths) :]:
        ax.remove()
    for ax, (body, found) in zip(axes, paths.items(), strict=False):
        for index, path in found.items():
            _walked(ax, path, groups.colours[groups.of[index]] if groups.of else series(0))
        _fill_plane(ax, extent, WIDTH)
        ax.set_title(words(body), pad=3)
        ax.set_xlabel("x [m]")
        ax.set_ylabel("y [m]")
    _name_groups(figure, groups)
    return figure


def _walked(ax: Axes, path: BodyPath, shade: str) -> None:
    """Draw a path from its dot to its arrow, which has the last heading."""
    ax.plot(path.x, path.y, color=shade, linewidth=1.0)
    ends = np.flatnonzero(np.isfinite(path.x))[[0, -1]]
    ax.plot(path.x[ends[:1]], path.y[ends[:1]], color=shade, marker=".", markersize=5)
    if path.heading is None:
        return
    ax.plot(
        path.x[ends[1:]], path.y[ends[1:]], color=shade, markersize=8,
        marker=(3, 0, math.degrees(path.heading) - 90.0),
    )  # fmt: skip


def _fill_plane(ax: Axes, extent: Sequence[float], width: float) -> None:
    """Let an axes of the figure's ``width`` in inches hold ``extent`` at one scale."""
    box = ax.get_position()
    sides = np.array([box.width * width, PLANE_INCHES])
    low, high = np.array(extent[::2]), np.array(extent[1::2])
    per_inch = max(float(np.max((high - low) / sides)) * PLANE_ROOM, 1e-9)
    middle, half = (low + high) / 2, per_inch * sides / 2
    ax.set_xlim(middle[0] - half[0], middle[0] + half[0])
    ax.set_ylim(middle[1] - half[1], middle[1] + half[1])


def _name_groups(figure: Figure, groups: Groups) -> None:
    if not groups.by:
        return
    handles = [Line2D([], [], color=shade, linewidth=2.0) for shade in groups.colours]
    figure.legend(
        handles, groups.labels, loc="upper left", ncols=6, bbox_to_anchor=(0.05, 1.0), fontsize=8
    )


def _bands(ax: Axes, channel: str, samples: Samples, groups: Groups) -> None:
    for group, shade in enumerate(groups.colours):
        band = samples.bands.get(group, {}).get(channel)
        if band is None:
            continue
        t_s = (np.arange(band.low.size) + 0.5) * samples.time.column_s
        ax.fill_between(t_s, band.low, band.high, color=shade, alpha=0.16, linewidth=0)
        # Samples of a slow stream have no neighbours that a line could reach.
        slow = np.count_nonzero(np.isfinite(band.low)) < SPARSE * band.low.size
        for edge in (band.low, band.high):
            ax.plot(t_s, edge, color=shade, linewidth=0.7, marker="." if slow else "", markersize=2)


def _lines(
    ax: Axes, channel: str, samples: Samples, attempts: Sequence[Attempt], groups: Groups
) -> None:
    dash = DASHED if channel.endswith(SETPOINT) else "solid"
    for attempt in attempts:
        trace = samples.traces.get(attempt.index, {}).get(channel)
        origin_s = samples.time.origins_s.get(attempt.index)
        if trace is not None and origin_s is not None:
            shade = groups.colours[groups.of[attempt.index]]
            t_s, values = thin(trace.t_s, trace.values, OVERLAY_COLUMNS)
            ax.plot(t_s - origin_s, values, color=shade, linewidth=0.8, linestyle=dash)


def _sheet(shown: Sequence[Shown], seconds: float, time: str) -> tuple[Figure, list[Axes]]:
    """Return a figure with two columns of panels, each with its title and unit."""
    columns = min(2, len(shown))
    rows = math.ceil(len(shown) / columns)
    margins = Margins(top=0.24 + STRIP_INCHES + 0.1, down=0.3, bottom=0.42)
    height = margins.top + margins.bottom + rows * ROW_INCHES + (rows - 1) * margins.down
    figure, axes = grid(rows, columns, WIDTH, height, margins=margins)
    for ax in axes[len(shown) :]:
        ax.remove()
    axes = axes[: len(shown)]
    for index, (ax, item) in enumerate(zip(axes, shown, strict=True)):
        ax.xaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
        ax.yaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))
        ax.yaxis.get_offset_text().set(ha="right")
        ax.set_xlim(0.0, seconds if seconds > 0.0 else 1.0)
        ax.set_title(words(item.stream), pad=3)
        ax.set_ylabel(_axis_words(item), fontsize=7)
        if index >= len(shown) - columns:
            ax.set_xlabel(time)
        else:
            ax.tick_params(labelbottom=False)
    return figure, axes


def _axis_words(shown: Shown) -> str:
    plain = [name for name in shown.panel.names if not name.endswith(SETPOINT)] or shown.panel.names
    name = words(plain[0]) if len(plain) == 1 else ""
    return f"{name} [{unit_text(shown.panel.unit)}]".strip()


def _shade(ax: Axes, steps: Sequence[StepSpan]) -> None:
    spans = [(step.start_s, step.end_s - step.start_s) for step in steps[1::2]]
    if spans:
        whole = ax.get_xaxis_transform()
        ax.broken_barh(spans, (0.0, 1.0), transform=whole, color=MEASURED, alpha=0.13, linewidth=0)


def _name_steps(figure: Figure, ax: Axes, steps: Sequence[StepSpan], seconds: float) -> None:
    """Write the names of the steps above the panels, as far as they have room."""
    if seconds <= 0.0:
        return
    box = ax.get_position()
    width, height = figure.get_size_inches()
    inches = box.width * width / seconds
    foot = 1.0 - (STRIP_INCHES + 0.02) / height
    for index, step in enumerate(steps):
        room = int((step.end_s - step.start_s) * inches / LETTER_INCHES)
        name = step.name if len(step.name) <= room else f"{step.name[: room - 1]}…"
        left = box.x0 + step.start_s / seconds * box.width
        share = (step.end_s - step.start_s) / seconds * box.width
        if index % 2:
            figure.add_artist(_bar(left, foot, share, STRIP_INCHES / height))
        if room >= 3:
            figure.text(
                left + share / 2, foot + 0.5 * STRIP_INCHES / height, name,
                fontsize=6.5, color=MUTED, ha="center", va="center",
            )  # fmt: skip


def _bar(left: float, foot: float, width: float, height: float) -> Rectangle:
    return Rectangle((left, foot), width, height, color=MEASURED, alpha=0.22, linewidth=0)


def _draw_bounds(ax: Axes, shown: Shown, bounds: Mapping[str, Sequence[Bound]]) -> None:
    """Draw the bounds that are near the data; the others would flatten them."""
    low, high = ax.get_ylim()
    room = NEAR * (high - low)
    labelled: list[float] = []
    for bound in _bounds_of(shown.channels, bounds):
        if not low - room <= bound.value <= high + room:
            continue
        shade = FITTED if bound.hard else MUTED
        style = (0, (6, 2, 1, 2)) if bound.hard else DASHED
        ax.axhline(bound.value, color=shade, linewidth=0.9, linestyle=style)
        if all(abs(bound.value - other) > APART * (high - low) for other in labelled):
            labelled.append(bound.value)
            ax.annotate(
                bound.by, (0.995, bound.value), (0.0, -1.5 if bound.upper else 1.5),
                xycoords=ax.get_yaxis_transform(), textcoords="offset points", fontsize=6,
                color=shade, ha="right", va="top" if bound.upper else "bottom",
            )  # fmt: skip


def _bounds_of(channels: Iterable[str], bounds: Mapping[str, Sequence[Bound]]) -> Iterable[Bound]:
    for channel in channels:
        yield from bounds.get(channel, ())


def empty(text: str) -> Figure:
    """Return a figure with the reason why there is nothing in it."""
    figure = Figure(figsize=(WIDTH, 0.6))
    figure.text(0.5, 0.5, text, ha="center", va="center", color=MUTED)
    return figure
