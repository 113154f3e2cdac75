"""Plots campaigns beside one another: differences, curves, trends."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter, date2num
from matplotlib.figure import Figure

from rigd.analysis.compare.campaign import Campaign
from rigd.analysis.compare.comparison import Compared
from rigd.analysis.report.palette import MUTED, series
from rigd.analysis.report.plots.axes import Margins, grid, label, plain_log, with_unit
from rigd.analysis.result import Curve

#: A range of x that spans more than this factor is drawn on a logarithmic axis.
LOG_SPAN = 30.0


def changes(rows: Sequence[tuple[str, tuple[float, float, float], bool]]) -> Figure:
    """Return the relative differences: name, (value, low, high) as shares, whether it differs."""
    figure, (ax,) = grid(1, 1, 7.0, 0.9 + 0.3 * len(rows), margins=Margins(left=1.9))
    for place, (_, (value, low, high), differs) in enumerate(reversed(rows)):
        ends = [100.0 * (end if math.isfinite(end) else value) for end in (low, high)]
        ax.plot(ends, [place, place], color=series(0), linewidth=1.8)
        for end, edge in ((low, 0.0), (high, 1.0)):
            if not math.isfinite(end):
                _open_end(ax, (100.0 * value, place), (edge, place))
        ax.plot(
            [100.0 * value], [place], "o", color=series(0),
            markerfacecolor=series(0) if differs else "white",
        )  # fmt: skip
    ax.axvline(0.0, color=MUTED, linewidth=0.8)
    ax.set_yticks(range(len(rows)), [name for name, _, _ in reversed(rows)])
    ax.set_xlabel("difference [%]")
    return figure


def _open_end(ax: Axes, at: tuple[float, float], edge: tuple[float, float]) -> None:
    """Draw an arrow from the estimate ``at`` to the edge where its interval has no end.

    ``edge`` has one coordinate of the data, as ``at``, and one of the axes: 0 or 1.
    """
    upright = edge[0] == at[0]
    ax.annotate(
        "", xy=at, xytext=edge,
        textcoords=ax.get_xaxis_transform() if upright else ax.get_yaxis_transform(),
        arrowprops={"arrowstyle": "<|-", "color": series(0), "shrinkA": 0.0, "shrinkB": 0.0},
    )  # fmt: skip


def curves(found: Mapping[str, Curve]) -> Figure:
    """Return the curves of campaigns by name, which share their axes, with their bands."""
    figure, (ax,) = grid(1, 1, 9.0, 3.7, margins=Margins(right=2.6))
    for index, (name, curve) in enumerate(found.items()):
        colour = series(index)
        ax.fill_between(curve.x, curve.low, curve.high, color=colour, alpha=0.25, linewidth=0)
        ax.plot(curve.x, curve.y, color=colour, linewidth=1.8, label=name)
    first = next(iter(found.values()))
    label(ax, first.x_name, first.x_unit, first.y_name, first.y_unit)
    x = np.concatenate([curve.x for curve in found.values()])
    if x.min() > 0.0 and x.max() > LOG_SPAN * x.min():
        plain_log(ax, "x")
    ax.legend(loc="center left", bbox_to_anchor=(1.01, 0.5))
    return figure


def trend(item: Compared, campaigns: Sequence[Campaign]) -> Figure:
    """Return a parameter over the dates of ``campaigns``; a line where the calibration changes."""
    figure, (ax,) = grid(1, 1, 9.0, 2.6)
    before: tuple[str, ...] | None = None
    for campaign in sorted(campaigns, key=lambda each: each.dates[0]):
        found = item.estimates[campaign.name]
        middle = campaign.dates[0] + (campaign.dates[-1] - campaign.dates[0]) / 2
        day: float = date2num(middle)  # type: ignore[no-untyped-call]
        if before is not None and campaign.calibrations != before:
            ax.axvline(campaign.dates[0], color=MUTED, linewidth=0.8, linestyle=(0, (4, 2)))  # type: ignore[arg-type]
        before = campaign.calibrations
        if found is None or found.value is None:
            continue
        ends = [found.value if end is None else end for end in (found.low, found.high)]
        ax.plot([day, day], ends, color=series(0), linewidth=1.2)
        ax.plot([day], [found.value], "o", color=series(0), markersize=4.0)
        for end, edge in ((found.low, 0.0), (found.high, 1.0)):
            if end is None:
                _open_end(ax, (day, found.value), (day, edge))
    locator = AutoDateLocator()  # type: ignore[no-untyped-call]
    ax.xaxis.set_major_locator(locator)
    ax.xaxis.set_major_formatter(ConciseDateFormatter(locator))  # type: ignore[no-untyped-call]
    ax.set_ylabel(with_unit(item.name, item.unit))
    return figure
