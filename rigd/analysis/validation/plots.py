"""Plots what a model predicts beside what was measured: one trial, all trials, their errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rigd.analysis.report.palette import MUTED, series
from rigd.analysis.report.plots.axes import Margins, grid, plain_log
from rigd.analysis.report.plots.trial import draw_fit, draw_residual, small_multiples
from rigd.analysis.report.rounding import FINER
from rigd.analysis.result import FloatArray, TrialFit
from rigd.analysis.validation.result import (
    Deviation,
    GroupValidation,
    OutputTrace,
    ValidatedTrial,
)
from rigd.analysis.validation.tables import differing, unit_of_errors

ROW_INCHES: Final = 2.15
FITTED: Final = "modelled"


def one_trial(trial: ValidatedTrial) -> Figure:
    """Return measured and modelled values of each output, and their difference with its limit."""
    figure, axes = grid(len(trial.traces), 2, 11.0, ROW_INCHES * len(trial.traces))
    for left, right, trace in zip(axes[::2], axes[1::2], trial.traces, strict=True):
        fit = as_fit(trial, trace)
        draw_fit(left, fit, fitted=FITTED)
        draw_residual(right, fit)
        limit = trial.deviation(trace.output).limit
        if limit is not None:
            for side in (-limit, limit):
                right.axhline(side, color=MUTED, linewidth=0.8, linestyle=(0, (4, 2)))
    return figure


def all_trials(trials: Sequence[ValidatedTrial], output: str) -> Figure:
    """Return measured and modelled values of one output, a small plot for each trial."""
    names = differing(trials)
    fits = [replace(as_fit(t, _trace(t, output)), label=t.described(names)) for t in trials]
    return small_multiples(fits, FITTED)


def errors(groups: Sequence[GroupValidation], outputs: Sequence[str], published: str) -> Figure:
    """Return the errors of all trials, an axis for each output; ``published`` names other values.

    Dashes are limits.
    """
    figure, axes = grid(
        1, len(outputs), 11.0, 3.0, margins=Margins(left=0.55, right=2.45, across=0.6)
    )
    for ax, output in zip(axes, outputs, strict=True):
        for index, group in enumerate(groups):
            _errors(ax, group, output, index, published)
        first = groups[0].trials[0].deviation(output)
        plain_log(ax, "y")
        ax.set_xlabel("trial, in the order recorded")
        ax.set_ylabel(f"{output} error, RMS [{unit_of_errors(first)}]")
    axes[-1].legend(loc="center left", bbox_to_anchor=(1.01, 0.5))
    return figure


def _errors(ax: Axes, group: GroupValidation, output: str, index: int, published: str) -> None:
    found = [trial.deviation(output) for trial in group.trials]
    x, colour = np.arange(1, len(found) + 1), series(index)
    ax.plot(x, _shown(found, "rms"), "o", color=colour, markersize=3.5, label=group.label)
    limits = _shown(found, "limit")
    if np.any(np.isfinite(limits)):
        ax.plot(x, limits, "_", color=colour, markersize=7.0, label=f"{group.label}: limit")
    others = _shown(found, "published")
    if np.any(np.isfinite(others)):
        ax.plot(
            x, others, "o", color=colour, markersize=3.5, markerfacecolor="none",
            label=f"{group.label}: {published}",
        )  # fmt: skip


def _shown(found: Sequence[Deviation], name: str) -> FloatArray:
    """Return one number of each deviation in the unit that it is shown in, NaN if none."""
    values = [getattr(item, name) for item in found]
    scale = 1e3 if found[0].unit in FINER else 1.0
    return np.array([np.nan if value is None else scale * value for value in values])


def as_fit(trial: ValidatedTrial, trace: OutputTrace) -> TrialFit:
    """Return one output of a trial as the figures of fits take it."""
    return TrialFit(
        label=trial.described(),
        condition="",
        output=trace.output,
        unit=trace.unit,
        t_s=trial.t_s,
        measured=trace.measured,
        fitted=trace.modelled,
        used=np.ones(len(trial.t_s), dtype=np.bool_),
        rms=trial.deviation(trace.output).rms,
        r_squared=float("nan"),
    )


def _trace(trial: ValidatedTrial, output: str) -> OutputTrace:
    return next(item for item in trial.traces if item.output == output)
