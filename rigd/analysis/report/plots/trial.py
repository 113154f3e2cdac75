"""Plots signals, fit and residual over time: one trial, or small plots of all trials."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import islice
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rigd.analysis.report.layout import Panel
from rigd.analysis.report.palette import FITTED, INK, MEASURED, series
from rigd.analysis.report.plots.axes import (
    SHARED,
    few_ticks,
    grid,
    label,
    shade_unused,
    unit_text,
    wipe,
    words,
)
from rigd.analysis.report.residuals import residual
from rigd.analysis.report.section import ReportSection
from rigd.analysis.report.trace import COLUMNS, thin
from rigd.analysis.result import TrialFit

TIME = ("time", "s")
SMALL_COLUMNS = 5
#: Letters that fit above a small axis; the whole label stands above the large figure.
SMALL_TITLE = 30
DASHES: Final = ("solid", (0, (4, 2)), (0, (1, 1.5)))
#: A small multiple is a fifth as wide as a page: it needs a fifth of the points, and some spare.
SMALL_TRACE = COLUMNS // 3
#: Share of the range: residuals below it leave the fit on the measured line, which is then wider.
HIDDEN = 0.01


def one_trial(trial: TrialFit, panels: Sequence[Panel], used: Figure | None = None) -> Figure:
    """Return the trial's signals, its measured and fitted output, and the residual.

    ``used`` is the figure of another trial with the same panels, which is drawn over: to make axes
    takes a third of the time of a figure.
    """
    if used is None:
        figure = _empty(len(panels))
    else:
        figure = used
        for ax in figure.axes:
            wipe(ax)
    *signals, fit, residuals = figure.axes
    if len(panels) % 2:
        fit, residuals = residuals, fit
    for ax, panel in zip(signals, panels, strict=True):
        draw_signals(ax, trial, panel)
    draw_fit(fit, trial)
    draw_residual(residuals, trial)
    return figure


def _empty(panels: int) -> Figure:
    """Return the axes of ``panels``, then those of fit and residual.

    An odd number leaves a hole: the residual fills it, and the fit, the last, has a row to itself.
    """
    rows = math.ceil((panels + 2) / 2)
    figure, axes = grid(rows, 2, 11.0, 2.15 * rows)
    if panels % 2:
        fit = axes[-2]
        left, right = fit.get_position(), axes[-1].get_position()
        axes[-1].remove()
        fit.set_position((left.x0, left.y0, right.x1 - left.x0, left.height))
    return figure


def small_multiples(trials: Sequence[TrialFit], fitted: str = "fitted") -> Figure:
    """Return measured and fitted output of all trials on common axes; the latter called so."""
    columns = min(SMALL_COLUMNS, len(trials))
    rows = math.ceil(len(trials) / columns)
    figure, axes = grid(rows, columns, 11.0, SHARED.top + 1.5 * rows, margins=SHARED, share=True)
    for ax, trial in zip(axes, trials, strict=False):
        _traces(ax, trial, SMALL_TRACE, fitted)
        ax.set_title(clipped(trial.label), fontsize=7.5)
    for ax in axes[len(trials) :]:
        ax.remove()
    few_ticks(axes[: len(trials)], x=4)
    figure.supxlabel("time [s]", fontsize=8.0, y=0.01)
    first = trials[0]
    figure.supylabel(f"{words(first.output)} [{unit_text(first.unit)}]", fontsize=8.0, x=0.008)
    handles, names = axes[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="upper right", ncols=len(names))
    return figure


def signal_overlay(
    chosen: Sequence[tuple[ReportSection, TrialFit]], colours: Sequence[int], panel: Panel
) -> Figure:
    """Return one panel with a trial of each section: a colour per section, a dash per signal.

    Raises:
        ValueError: there are more signals than dashes.
    """
    figure, (ax,) = grid(1, 1, 5.4, 2.8)
    single = len(panel.names) == 1
    for (section, trial), index in zip(chosen, colours, strict=True):
        for name, dash in zip(panel.names, islice(DASHES, len(panel.names)), strict=True):
            ax.plot(
                *thin(trial.t_s, trial.signals[name].values),
                color=series(index),
                linestyle=dash,
                label=_titled(section, trial.condition if single else words(name)),
            )
    label(ax, *TIME, panel.names[0] if single else _common(panel.names), panel.unit)
    ax.legend(loc="best")
    return figure


def fits_side_by_side(chosen: Sequence[tuple[ReportSection, TrialFit]]) -> Figure:
    """Return measured and fitted output of one trial of each section, on common axes."""
    figure, axes = grid(1, len(chosen), 11.0, 2.7, margins=SHARED, share=True)
    for ax, (section, trial) in zip(axes, chosen, strict=True):
        draw_fit(ax, trial, legend=ax is axes[0])
        ax.set_title(_titled(section, trial.condition))
        if ax is not axes[0]:
            ax.set_ylabel("")
    few_ticks(axes)
    return figure


def _titled(section: ReportSection, what: str) -> str:
    """Return the name of a line: its group, and ``what`` unless that is empty."""
    return f"{section.label}, {what}" if what else section.label


def draw_signals(ax: Axes, trial: TrialFit, panel: Panel) -> None:
    """Draw the signals of one panel over time."""
    for index, name in enumerate(name for name in panel.names if name in trial.signals):
        signal = trial.signals[name]
        ax.plot(*thin(trial.t_s, signal.values), color=series(index), label=words(name))
    shade_unused(ax, trial.t_s, trial.used)
    single = len(panel.names) == 1
    label(ax, *TIME, panel.names[0] if single else _common(panel.names), panel.unit)
    if not single:
        ax.legend(loc="best")


def draw_fit(ax: Axes, trial: TrialFit, *, legend: bool = True, fitted: str = "fitted") -> None:
    """Draw measured and fitted output over time; samples that were not used are shaded."""
    _traces(ax, trial, COLUMNS, fitted)
    label(ax, *TIME, trial.output, trial.unit)
    if legend:
        ax.legend(loc="best", ncols=2)


def draw_residual(ax: Axes, trial: TrialFit) -> None:
    """Draw measured minus fitted over time."""
    ax.axhline(0.0, color=INK, linewidth=0.6)
    ax.plot(*thin(trial.t_s, residual(trial)), color=MEASURED, linewidth=0.8)
    shade_unused(ax, trial.t_s, trial.used)
    label(ax, *TIME, "residual", trial.unit)


def _traces(ax: Axes, trial: TrialFit, columns: int, fitted: str) -> None:
    measured = thin(trial.t_s, trial.measured, columns)
    hidden = trial.rms < HIDDEN * float(np.ptp(trial.measured))
    width = 3.6 if hidden else 0.8
    ax.plot(*measured, color=MEASURED, linewidth=width, label="measured")
    ax.plot(*thin(trial.t_s, trial.fitted, columns), color=FITTED, linewidth=1.4, label=fitted)
    shade_unused(ax, trial.t_s, trial.used)


def clipped(text: str) -> str:
    """Return a label that fits above a small axis."""
    return text if len(text) <= SMALL_TITLE else f"{text[: SMALL_TITLE - 1]}…"


def _common(names: Sequence[str]) -> str:
    """Return the last word that all names share, such as ``speed``; else ``signals``."""
    last = {words(name).split()[-1] if words(name).split() else "" for name in names}
    return last.pop() if len(last) == 1 else "signals"
