"""Plots profile likelihoods: the rise of the cost when one parameter is held, the rest refitted."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rigd.analysis.report.palette import FITTED, INK, series
from rigd.analysis.report.plots.axes import grid, plain_log, unit_text
from rigd.analysis.result import FloatArray, Profile

COLUMNS = 3
#: The ordinate ends at this multiple of the threshold: above it nothing is decided.
CEILING = 4.0
#: Below a span of one decade a logarithmic axis would have no tick to read.
DECADE = 10.0


def profiles(found: Sequence[Profile], symbols: Mapping[str, str]) -> Figure:
    """Return one axis per profile with its threshold; the interval is shaded.

    ``symbols`` gives the label of a parameter by its name.
    """
    columns = min(COLUMNS, len(found))
    rows = math.ceil(len(found) / columns)
    figure, axes = grid(rows, columns, 11.0 * columns / COLUMNS, 2.4 * rows)
    for ax, profile in zip(axes, found, strict=False):
        _one(ax, profile, symbols.get(profile.name, profile.name))
    for ax in axes[len(found) :]:
        ax.remove()
    return figure


def _one(ax: Axes, profile: Profile, symbol: str) -> None:
    finite = np.isfinite(profile.values) & np.isfinite(profile.cost)
    values, cost = profile.values[finite], profile.cost[finite]
    ax.plot(values, cost, ".-", color=series(0), markersize=3.5, linewidth=1.2)
    ax.axhline(profile.threshold, color=FITTED, linewidth=1.0, linestyle=(0, (4, 2)))
    if values.size:
        begin = profile.low if profile.low is not None else float(values.min())
        end = profile.high if profile.high is not None else float(values.max())
        ax.axvspan(begin, end, color=series(0), alpha=0.10, linewidth=0)
    for bound in (profile.low, profile.high):
        if bound is not None:
            ax.axvline(bound, color=INK, linewidth=0.7, linestyle=":")
    low, high = _window(values, cost, CEILING * profile.threshold)
    ax.set_xlim(low, high)
    ax.set_ylim(-0.05 * profile.threshold, CEILING * profile.threshold)
    if profile.log_axis and 0.0 < DECADE * low < high:
        plain_log(ax, "x")
    ax.set_xlabel(f"{symbol} [{unit_text(profile.unit)}]")
    ax.set_ylabel("rise of −2 ln L [–]")


def _window(values: FloatArray, cost: FloatArray, ceiling: float) -> tuple[float, float]:
    """Return the part of the grid with the profile below the ceiling, and a point each side."""
    low = np.flatnonzero(cost <= ceiling)
    if low.size == 0 or values.size < 2:
        return 0.0, 1.0
    first, last = max(int(low[0]) - 1, 0), min(int(low[-1]) + 1, values.size - 1)
    return float(values[first]), float(values[last])
