"""Plots the characteristics of compared models on one axis."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from rigd.analysis.report.palette import MEASURED, SERIES, series
from rigd.analysis.report.plots.axes import Margins, grid, label, plain_log
from rigd.analysis.result import ModelComparison

#: A curve is cut at the point at which it leaves the curves of models that fit by so much of their
#: size.
ROOM = 0.5


def models(comparison: ModelComparison) -> Figure:
    """Return the curve of each model; the best is thick, those that do not fit are dotted."""
    figure, (ax,) = grid(1, 1, 9.0, 3.7, margins=Margins(right=2.6))
    for index, score in enumerate(comparison.scores):
        ax.plot(
            comparison.x,
            score.curve,
            color=series(index) if index < len(SERIES) else MEASURED,
            linewidth=2.4 if index == 0 else 1.2,
            linestyle="-" if score.fits else ":",
            label=score.name,
        )
    fitting = [score.curve for score in comparison.scores if score.fits]
    shown = np.concatenate(fitting or [score.curve for score in comparison.scores])
    low, high = float(np.min(shown)), float(np.max(shown))
    room = ROOM * max(high - low, 1e-3 * abs(high))
    ax.set_ylim(low - room, high + room)
    label(ax, comparison.x_name, comparison.x_unit, comparison.y_name, "1")
    plain_log(ax, "x")
    ax.legend(loc="center left", bbox_to_anchor=(1.01, 0.5))
    return figure
