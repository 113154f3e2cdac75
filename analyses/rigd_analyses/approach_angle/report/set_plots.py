"""Plots friction over slip (Figs. 11, 12), pooled curves, and the maximum over the angle (Fig. 13).

The marker of a run shows its regime: F_r/N is a limit of friction only while the wheel slides.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rigd.analysis.report.palette import FITTED, INK, MEASURED, series
from rigd.analysis.report.plots.axes import SHARED, Margins, grid, label
from rigd_analyses.approach_angle.report.marks import (
    LEFT_OUT,
    OF_REGIME,
    Mark,
    dots,
    legend_handles,
)
from rigd_analyses.approach_angle.report.tables import SOURCES
from rigd_analyses.approach_angle.report.tables import label as set_label
from rigd_analyses.approach_angle.result import CampaignResult, FrictionCurve, SetResult, Trend
from rigd_analyses.approach_angle.run_result import RunResult

SOURCE_COLOURS = {"published": MEASURED, "paper": FITTED, "better": series(0)}
SOURCE_SHAPES = {"published": "D", "paper": "s", "better": "o"}
BLOCK = Mark(".", True, "block means")
FAINT_BLOCK = Mark("o", False, "of little weight")


def friction_over_slip(
    sets: Sequence[SetResult], runs: Sequence[RunResult], colours: Sequence[int]
) -> Figure:
    """Return one axis per set: the paper's friction over its slip, marked by regime (Fig. 11)."""
    columns = min(2, len(sets))
    rows = math.ceil(len(sets) / columns)
    height = SHARED.top + SHARED.bottom + 2.5 * rows
    figure, axes = grid(rows, columns, 5.5 * columns, height, margins=Margins(top=0.62, down=0.7))
    top = _top(runs)
    for ax, item, colour, letter in zip(axes, sets, colours, "abcdefghij", strict=False):
        mine = [run for run in runs if run.run.set_name == item.name]
        scatter(ax, mine, colour)
        rolling = math.cos(item.alpha_rad) - 1.0
        ax.axvline(rolling, color=INK, linewidth=0.7, linestyle=":")
        if item.paper.value is not None:
            ax.axhline(item.paper.value, color=series(colour), linewidth=0.7, linestyle=(0, (4, 2)))
        ax.set_ylim(0.0, top)
        ax.set_title(f"{letter}) {set_label(item)}")
        label(ax, "slip ratio s (paper)", "1", "T/(R N)", "1")
    for ax in axes[len(sets) :]:
        ax.remove()
    _marker_legend(figure)
    return figure


def coated_against_clean(
    sets: Sequence[SetResult], runs: Sequence[RunResult], colours: Sequence[int]
) -> Figure:
    """Return the sets of one angle on one axis (Fig. 12)."""
    figure, (ax,) = grid(1, 1, 9.0, 3.6, margins=Margins(top=0.5, right=1.6))
    for item, colour in zip(sets, colours, strict=True):
        scatter(ax, [run for run in runs if run.run.set_name == item.name], colour)
        ax.plot([], [], "o", color=series(colour), markersize=4.5, label=set_label(item))
    mine = [run for run in runs if run.run.set_name in {item.name for item in sets}]
    ax.set_ylim(0.0, _top(mine))
    label(ax, "slip ratio s (paper)", "1", "T/(R N)", "1")
    ax.legend(loc="center left", bbox_to_anchor=(1.01, 0.5))
    _marker_legend(figure)
    return figure


def scatter(ax: Axes, runs: Sequence[RunResult], colour: int) -> None:
    """Draw runs in the colour of their set, marked by regime; those left out as grey crosses."""
    for regime, mark in OF_REGIME.items():
        used = [run for run in runs if run.paper.regime is regime and not run.excluded]
        _runs(ax, used, series(colour), mark)
    _runs(ax, [run for run in runs if run.excluded], MEASURED, LEFT_OUT)


def _runs(ax: Axes, runs: Sequence[RunResult], colour: str, mark: Mark) -> None:
    known = [run.paper for run in runs if np.isfinite(run.paper.slip + run.paper.mu)]
    dots(ax, [item.slip for item in known], [item.mu for item in known], colour, mark)


def _top(runs: Sequence[RunResult]) -> float:
    values = [run.paper.mu for run in runs if np.isfinite(run.paper.mu)]
    return 1.08 * max(values, default=1.0)


def _marker_legend(figure: Figure) -> None:
    figure.legend(handles=legend_handles(), loc="upper left", ncols=4, bbox_to_anchor=(0.05, 1.0))


def pooled_curves(sets: Sequence[SetResult], colours: Sequence[int]) -> Figure:
    """Return the friction limit of all sets over the sliding speed, each with its band."""
    figure, (ax,) = grid(1, 1, 9.0, 3.7, margins=Margins(right=1.6))
    for item, colour in zip(sets, colours, strict=True):
        if item.curve is not None:
            _curve(ax, item.curve, colour, set_label(item))
    label(ax, "sliding speed", "m/s", "F_r/N", "1")
    ax.set_ylim(bottom=0.0)
    ax.legend(loc="center left", bbox_to_anchor=(1.01, 0.5))
    return figure


def pooled_blocks(result: SetResult, curve: FrictionCurve, colour: int) -> Figure:
    """Return the block means of a set that made its curve; faint ones got little weight."""
    figure, (ax,) = grid(1, 1, 9.0, 3.4, margins=Margins(right=1.6))
    speed, mu = curve.block_speed_m_s, curve.block_mu
    kept = curve.block_weight >= 0.5
    for mark, chosen, size in ((BLOCK, kept, 4.0), (FAINT_BLOCK, ~kept, 2.5)):
        dots(ax, speed[chosen], mu[chosen], MEASURED, mark, size=size, label=mark.label)
    _curve(ax, curve, colour, "pooled")
    if result.published is not None:
        ax.axhline(result.published, color=FITTED, linestyle=(0, (4, 2)), label="published")
    label(ax, "sliding speed", "m/s", "F_r/N", "1")
    ax.legend(loc="center left", bbox_to_anchor=(1.01, 0.5))
    return figure


def _curve(ax: Axes, curve: FrictionCurve, colour: int, name: str) -> None:
    shade = series(colour)
    ax.fill_between(curve.speed_m_s, curve.low, curve.high, color=shade, alpha=0.25, linewidth=0)
    ax.plot(curve.speed_m_s, curve.mu, color=shade, linewidth=1.8, label=name)


def maximum_over_angle(result: CampaignResult) -> Figure:
    """Return the maximum over the angle by every source, its line and the demand form (Fig. 13)."""
    figure, (ax,) = grid(1, 1, 9.0, 4.0, margins=Margins(right=2.6))
    angles = np.linspace(0.0, 50.0, 101)
    for source, trend in result.trends.items():
        colour = SOURCE_COLOURS.get(source, INK)
        error = _expanded(source, trend, result)
        published = source == "published"
        ax.errorbar(
            trend.angle_deg,
            trend.mu,
            yerr=error,
            linestyle="none",
            marker=SOURCE_SHAPES.get(source, "o"),
            markersize=8.0 if published else 4.5,
            markerfacecolor="none" if published else colour,
            color=colour,
            capsize=2.5,
            label=SOURCES.get(source, source),
        )
        line = trend.line
        ax.plot(angles, line.intercept + line.slope_per_deg * angles, color=colour, linewidth=1.1)
        alpha = np.radians(angles)
        demand = (trend.demand.a + trend.demand.b * np.sin(alpha)) / np.cos(alpha)
        ax.plot(angles, demand, color=colour, linewidth=0.9, linestyle=(0, (2, 2)))
    usable = [
        (item.angle_deg, item.usable)
        for item in result.sets
        if item.usable is not None and _in_trend(item, result)
    ]
    if usable:
        ax.errorbar(
            [angle for angle, _ in usable],
            [found.value for _, found in usable],
            yerr=[found.expanded for _, found in usable],
            linestyle="none",
            marker="o",
            markersize=5.0,
            markerfacecolor="none",
            color=series(2),
            capsize=2.5,
            label="corrected method, usable push",
        )
    ax.plot([], [], color=INK, linewidth=1.1, label="straight line")
    ax.plot([], [], color=INK, linewidth=0.9, linestyle=(0, (2, 2)), label="demand of rolling")
    ax.set_ylim(bottom=0.0)
    label(ax, "approach angle α", "°", "maximum coefficient", "1")
    ax.legend(loc="center left", bbox_to_anchor=(1.01, 0.5))
    return figure


def _expanded(source: str, trend: Trend, result: CampaignResult) -> NDArray[np.float64] | None:
    """Return U (k = 2) of each point of a trend, NaN where it is not known; None for all."""
    if source != "paper":
        return None if trend.u is None else 2.0 * trend.u
    known = {item.name: item.paper_expanded for item in result.sets}
    return np.array([np.nan if (u := known.get(name)) is None else u for name in trend.sets])


def slip_over_angle(result: CampaignResult) -> Figure:
    """Return the corrected slip over the angle: a line for each voltage through one wheel."""
    figure, (ax,) = grid(1, 1, 9.0, 3.7, margins=Margins(right=1.6))
    wheels = [point.wheel for point in result.slips]
    main = max(
        dict.fromkeys(wheels),
        key=lambda w: len({point.alpha_rad for point in result.slips if point.wheel == w}),
    )
    for index, volts in enumerate(sorted({point.voltage_v for point in result.slips})):
        of_voltage = [point for point in result.slips if point.voltage_v == volts]
        for mine in (True, False):
            points = sorted(
                (point for point in of_voltage if (point.wheel == main) is mine),
                key=lambda point: point.alpha_rad,
            )
            if not points:
                continue
            ax.errorbar(
                [math.degrees(point.alpha_rad) for point in points],
                [point.slip for point in points],
                yerr=[point.expanded if math.isfinite(point.expanded) else 0.0 for point in points],
                linestyle="-" if mine else "none",
                marker="o",
                markersize=4.5,
                markerfacecolor=None if mine else "none",
                color=series(index),
                capsize=2.5,
                label=f"{volts:g} V" if mine else None,
            )
    ax.axhline(0.0, color=INK, linewidth=0.7, linestyle=":")
    label(ax, "approach angle α", "°", "corrected slip", "1")
    ax.legend(loc="center left", bbox_to_anchor=(1.01, 0.5))
    return figure


def _in_trend(set_result: SetResult, result: CampaignResult) -> bool:
    return any(set_result.name in trend.sets for trend in result.trends.values())
