"""Plots residuals of a fit: over time, their distribution, and their autocorrelation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rigd.analysis.report.palette import FITTED, INK, MEASURED, MUTED, series
from rigd.analysis.report.plots.axes import grid, label
from rigd.analysis.report.residuals import end_to_end, normal_quantiles, pooled
from rigd.analysis.report.trace import COLUMNS, thin
from rigd.analysis.result import Autocorrelation, FloatArray, TrialFit

BINS = 60


def over_time(trials: Sequence[TrialFit]) -> Figure:
    """Return the residuals of all trials, laid end to end with a line between them."""
    figure, (ax,) = grid(1, 1, 11.0, 2.2)
    time, values, starts = end_to_end(trials)
    ax.axhline(0.0, color=INK, linewidth=0.6)
    ax.plot(*thin(time, values, 3 * COLUMNS), color=MEASURED, linewidth=0.7)
    for start in starts[1:-1]:
        ax.axvline(start, color=MUTED, linewidth=0.6, linestyle=":")
    ax.grid(visible=False, axis="x")
    label(ax, "time, trials end to end", "s", "residual", trials[0].unit)
    return figure


def distribution(trials: Sequence[TrialFit], memory: Autocorrelation) -> Figure:
    """Return histogram, normal quantile plot and autocorrelation side by side."""
    figure, axes = grid(1, 3, 11.0, 2.7)
    values = pooled(trials)
    _histogram(axes[0], values, trials[0].unit if trials else "")
    _quantiles(axes[1], values)
    _autocorrelation(axes[2], memory)
    return figure


def _histogram(ax: Axes, values: FloatArray, unit: str) -> None:
    ax.set_title("Histogram, with the normal density")
    label(ax, "residual", unit, "density", _inverse(unit))
    if values.size == 0:
        return
    density, edges = np.histogram(values, bins=BINS, density=True)
    ax.stairs(density, edges, fill=True, color=MEASURED, alpha=0.55, linewidth=0)
    scale = float(np.std(values))
    if scale > 0.0:
        x = np.linspace(edges[0], edges[-1], 200)
        z = (x - values.mean()) / scale
        ax.plot(x, np.exp(-0.5 * z * z) / (scale * np.sqrt(2.0 * np.pi)), color=FITTED)


def _inverse(unit: str) -> str:
    if unit in ("", "1"):
        return "1"
    return f"1/{unit}" if unit.isalpha() else f"1/({unit})"


def _quantiles(ax: Axes, values: FloatArray) -> None:
    ax.set_title("Quantiles against the normal")
    label(ax, "normal quantile", "σ", "residual quantile", "σ")
    expected, found = normal_quantiles(values)
    if expected.size == 0:
        return
    ends = [expected[0], expected[-1]]
    ax.plot(ends, ends, color=INK, linewidth=0.8)
    ax.plot(expected, found, ".", color=series(0), markersize=3.0)


def _autocorrelation(ax: Axes, memory: Autocorrelation) -> None:
    ax.set_title("Autocorrelation, band of white noise")
    label(ax, "lag", "s", "autocorrelation", "1")
    ax.axhspan(-memory.band, memory.band, color=series(2), alpha=0.25, linewidth=0)
    ax.axhline(0.0, color=INK, linewidth=0.6)
    ax.plot(*thin(memory.lag_s, memory.value), color=series(0))
    ax.set_ylim(min(-0.3, float(np.min(memory.value, initial=0.0)) - 0.05), 1.05)
