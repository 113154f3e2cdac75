"""Plots the ways of bodies in the plane, measured and fitted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rigd.analysis.report.palette import FITTED, MEASURED
from rigd.analysis.report.plots.axes import Margins, few_ticks, grid
from rigd.analysis.report.plots.trial import clipped
from rigd.analysis.result import FloatArray, Track

COLUMNS: Final = 4
WIDTH, PLANE = 11.0, 2.1  #: inches: of the figure, and the height of a plane
#: Points of a line: as many as a plane of this size can show.
POINTS: Final = 600
ROOM: Final = 1.1  #: of a plane to what is drawn in it
BEND: Final = 0.1  #: of the length of a way that is not straight
MARGINS: Final = Margins(across=0.55, down=0.5, bottom=0.5, top=0.42)


def tracks(found: Sequence[tuple[str, Track]]) -> Figure:
    """Return a plane for each trial, with its label; x and y of a plane have one scale."""
    columns = min(COLUMNS, len(found))
    rows = math.ceil(len(found) / columns)
    height = MARGINS.top + MARGINS.bottom + rows * PLANE + (rows - 1) * MARGINS.down
    figure, axes = grid(rows, columns, WIDTH, height, margins=MARGINS)
    for ax, (label, track) in zip(axes, found, strict=False):
        _way(ax, track)
        box = ax.get_position()
        _fill(ax, track, np.array([box.width * WIDTH, box.height * height]))
        ax.set_title(clipped(label), fontsize=7.5)
    for ax in axes[len(found) :]:
        ax.remove()
    few_ticks(axes[: len(found)], x=4)
    figure.supxlabel("x [m]", fontsize=8.0, y=0.01)
    figure.supylabel("y [m]", fontsize=8.0, x=0.008)
    handles, names = axes[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="upper right", ncols=len(names))
    return figure


def _fill(ax: Axes, track: Track, sides: FloatArray) -> None:
    """Let axes with ``sides`` (2,) in inches hold a track at one scale."""
    places = np.concatenate([track.measured, track.fitted])
    low, high = np.nanmin(places, axis=0), np.nanmax(places, axis=0)
    per_inch = max(ROOM * float(np.max((high - low) / sides)), 1e-9)
    middle, half = (low + high) / 2, per_inch * sides / 2
    ax.set_xlim(middle[0] - half[0], middle[0] + half[0])
    ax.set_ylim(middle[1] - half[1], middle[1] + half[1])


def bends(track: Track) -> bool:
    """Return whether a way is not straight: x over time shows what there is of a straight one."""
    across, along = sorted(np.ptp(track.fitted, axis=0))
    return bool(across > BEND * along)


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
