"""Plots draws of a posterior: the density of each parameter, and pairs that lie on a ridge."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.figure import Figure

from rigd.analysis.posterior_result import CredibleInterval, Posterior
from rigd.analysis.report.palette import FITTED, INK, series
from rigd.analysis.report.plots.axes import grid, plain_log, unit_text
from rigd.analysis.result import FloatArray, ParameterEstimate

COLUMNS = 3
BINS = 40
MOST_PAIRS = 3
DRAWS = 400  #: of each chain that a scatter shows
DECADE = 10.0


def densities(found: Posterior, beside: dict[str, ParameterEstimate]) -> Figure:
    """Return one axis per parameter: a line for each chain, the credible interval shaded.

    ``beside`` are the estimates of the table by name; the ends of their intervals are dotted.
    """
    columns = min(COLUMNS, len(found.parameters))
    rows = math.ceil(len(found.parameters) / columns)
    figure, axes = grid(rows, columns, 11.0 * columns / COLUMNS, 2.4 * rows)
    for k, (ax, item) in enumerate(zip(axes, found.parameters, strict=False)):
        edges = _edges(found.draws[..., k])
        for chain, values in enumerate(found.draws[..., k]):
            heights, _ = np.histogram(values, edges)
            ax.stairs(heights / len(values), edges, color=series(chain), linewidth=1.0)
        if item.low is not None and item.high is not None:
            ax.axvspan(item.low, item.high, color=series(0), alpha=0.10, linewidth=0)
        estimate = beside[item.name]
        if estimate.quoted is not None:
            for end in (estimate.low, estimate.high):
                if end is not None:
                    ax.axvline(end, color=INK, linewidth=0.9, linestyle=":")
        if len(item.modes) > 1:
            for mode in item.modes:
                ax.axvline(mode.value, color=FITTED, linewidth=1.0, linestyle=(0, (4, 2)))
        if edges[-1] > DECADE * edges[0]:
            plain_log(ax, "x")
        ax.set_xlabel(_label(item))
        ax.set_ylabel("share of the draws [–]")
    for ax in axes[len(found.parameters) :]:
        ax.remove()
    return figure


def ridges(found: Posterior) -> Figure:
    """Return a corner plot of each pair on a ridge: the draws, and the densities at their sides."""
    pairs = found.ridges[:MOST_PAIRS]
    figure, axes = grid(2 * len(pairs), 2, 6.4, 5.2 * len(pairs))
    names = [item.name for item in found.parameters]
    for k, pair in enumerate(pairs):
        across, up = names.index(pair.first), names.index(pair.second)
        over, empty, scatter, side = axes[4 * k : 4 * k + 4]
        empty.remove()
        first, second = found.draws[..., across], found.draws[..., up]
        for chain in range(len(first)):
            step = max(1, first.shape[1] // DRAWS)
            scatter.plot(
                first[chain, ::step], second[chain, ::step], ".", color=series(chain),
                markersize=1.5, alpha=0.6,
            )  # fmt: skip
        bins = _edges(first), _edges(second)
        over.stairs(np.histogram(first, bins[0])[0], bins[0], color=INK)
        side.stairs(np.histogram(second, bins[1])[0], bins[1], color=INK, orientation="horizontal")
        for which, edges, shown in (("x", bins[0], (over, scatter)), ("y", bins[1], ())):
            for ax in shown or (scatter, side):
                (ax.set_xlim if which == "x" else ax.set_ylim)(edges[0], edges[-1])
                if edges[-1] > DECADE * edges[0]:
                    plain_log(ax, which)
        scatter.set_xlabel(_label(found.parameters[across]))
        scatter.set_ylabel(_label(found.parameters[up]))
        over.set_ylabel("draws [–]")
        side.set_xlabel("draws [–]")
    return figure


def _edges(values: FloatArray) -> FloatArray:
    """Return edges of bins; of equal ratio if the values span more than a decade."""
    low, high = float(np.min(values)), float(np.max(values))
    spaced = np.geomspace if high > DECADE * low > 0.0 else np.linspace
    return np.asarray(spaced(low, high, BINS + 1))


def _label(item: CredibleInterval) -> str:
    return f"{item.symbol} [{unit_text(item.unit)}]"
