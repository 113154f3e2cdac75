"""Plots the ways of bodies in the plane, measured and fitted, at one scale."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rigd.analysis.report.palette import FITTED, MEASURED
from rigd.analysis.report.plots.axes import SHARED, few_ticks, grid
from rigd.analysis.result import Track

COLUMNS: Final = 5
PLANE_INCHES: Final = 1.9
#: Points of a line: as many as a plane of this size can show.
POINTS: Final = 600


def tracks(found: Sequence[tuple[str, Track]]) -> Figure:
    """Return a plane for each trial, with its label, all at one scale."""
    columns = min(COLUMNS, len(found))
    rows = math.ceil(len(found) / columns)
    height = SHARED.top + SHARED.bottom + PLANE_INCHES * rows
    figure, axes = grid(rows, columns, 11.0, height, margins=SHARED, share=True)
    for ax, (label, track) in zip(axes, found, strict=False):
        _way(ax, track)
        ax.set_aspect("equal", adjustable="datalim")
        ax.set_title(label, fontsize=7.5)
    for ax in axes[len(found) :]:
        ax.remove()
    few_ticks(axes[: len(found)], x=4)
    figure.supxlabel("x [m]", fontsize=8.0, y=0.01)
    figure.supylabel("y [m]", fontsize=8.0, x=0.008)
    handles, names = axes[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="upper right", ncols=len(names))
    return figure


def furthest(found: Sequence[Track]) -> float:
    """Return the largest distance in m of a measured place from the fitted one."""
    gaps = [np.hypot(*(track.measured - track.fitted).T) for track in found]
    return max(float(np.nanmax(gap)) for gap in gaps)


def _way(ax: Axes, track: Track) -> None:
    every = max(1, math.ceil(len(track.measured) / POINTS))
    x, y = track.measured[::every].T
    ax.plot(x, y, color=MEASURED, linewidth=3.0, label="measured")
    x, y = track.fitted[::every].T
    ax.plot(x, y, color=FITTED, linewidth=1.0, label="fitted")
