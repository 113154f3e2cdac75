"""Plots fitted characteristic curves with their bands: all groups of trials on one axis."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rigd.analysis.report.palette import series
from rigd.analysis.report.plots.axes import Margins, grid, label, plain_log
from rigd.analysis.report.section import ReportSection
from rigd.analysis.result import Curve

#: A range of x that spans more than this factor is drawn on a logarithmic axis.
LOG_SPAN = 30.0
#: A band may reach this multiple of the curves' size beyond them; the rest of it is cut.
BAND_ROOM = 1.0


def curves(sections: Sequence[ReportSection], colours: Sequence[int]) -> Figure:
    """Return the curves of ``sections``, which must share their axes; a reference is dashed.

    The reference is cut to the range that the data of its section visited: beyond it there is
    nothing to compare.
    """
    figure, (ax,) = grid(1, 1, 9.0, 3.7, margins=Margins(right=2.6))
    for section, index in zip(sections, colours, strict=True):
        curve, colour = section.result.curve, series(index)
        _points(ax, curve, colour)  # below curve and band
        ax.fill_between(curve.x, curve.low, curve.high, color=colour, alpha=0.25, linewidth=0)
        ax.plot(curve.x, curve.y, color=colour, linewidth=1.8, label=section.label)
        if section.reference_curve is not None and curve.x.size:
            reference = section.reference_curve
            inside = (reference.x >= curve.x.min()) & (reference.x <= curve.x.max())
            ax.plot(
                reference.x[inside],
                reference.y[inside],
                color=colour,
                linestyle=(0, (4, 2)),
                linewidth=1.1,
                label=f"{section.label}: {reference.label}",
            )
    _limit(ax, sections)
    first = sections[0].result.curve
    label(ax, first.x_name, first.x_unit, first.y_name, first.y_unit)
    if _spans_decades([section.result.curve.x for section in sections]):
        plain_log(ax, "x")
    ax.legend(loc="center left", bbox_to_anchor=(1.01, 0.5))
    return figure


def _points(ax: Axes, curve: Curve, colour: str) -> None:
    """Draw what the data show: medians, with bars over the middle half of the samples."""
    if not curve.seen:
        return
    middle = np.array([item.median for item in curve.seen])
    bars = [middle - [item.low for item in curve.seen], [item.high for item in curve.seen] - middle]
    ax.errorbar(
        [item.x for item in curve.seen], middle, yerr=bars, color=colour, linestyle="none",
        marker="o", markersize=3.0, elinewidth=0.8, alpha=0.55, zorder=1.0, label="_binned",
    )  # fmt: skip


def _limit(ax: Axes, sections: Sequence[ReportSection]) -> None:
    """Cut bands that would flatten every curve, at which the data determine next to nothing."""
    fitted = np.concatenate([section.result.curve.y for section in sections])
    points = [(item.low, item.high) for section in sections for item in section.result.curve.seen]
    low = min(float(np.nanmin(section.result.curve.low)) for section in sections)
    high = max(float(np.nanmax(section.result.curve.high)) for section in sections)
    low, high = min([low, *(low for low, _ in points)]), max([high, *(high for _, high in points)])
    bottom, top = float(np.nanmin(fitted)), float(np.nanmax(fitted))
    room = BAND_ROOM * max(top - bottom, abs(top), abs(bottom))
    low, high = max(low, bottom - room), min(high, top + room)
    spare = 0.05 * (high - low)
    if spare > 0.0:
        ax.set_ylim(low - spare, high + spare)


def _spans_decades(ranges: Sequence[np.ndarray]) -> bool:
    values = np.concatenate(ranges) if ranges else np.empty(0)
    return values.size > 1 and values.min() > 0.0 and values.max() > LOG_SPAN * values.min()
