"""Builds the content of the report page: converts results to rows, sentences and drawings.

This module imports matplotlib, so it is imported only when a report is requested.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

from matplotlib.figure import Figure

from rigd.analysis.report.comparison import GroupComparison, comparison
from rigd.analysis.report.files import saving
from rigd.analysis.report.layout import Panel, featured, names_condition, panels
from rigd.analysis.report.plots import (
    correlation,
    models,
    profile,
    residual,
    tracks,
    trial,
)
from rigd.analysis.report.plots.axes import words
from rigd.analysis.report.rounding import count, interval, number
from rigd.analysis.report.section import ReportSection
from rigd.analysis.report.svg import Drawing, draw
from rigd.analysis.report.tables.models import HEADS, ModelRow, model_rows
from rigd.analysis.report.tables.starts import StartTable, start_table
from rigd.analysis.report.tables.summary import SummaryRow, summary_rows
from rigd.analysis.report.tables.uncertainty_budget import BudgetTable, budget_table
from rigd.analysis.result import IdentificationResult, Profile, TrialFit
from rigd.analysis.side_by_side import side_by_side


@dataclass(frozen=True)
class TrialView:
    """One trial: a line if it is closed on the page, a drawing if it is open."""

    label: str
    quality: str
    drawing: Drawing


#: Names of trials with what is drawn of each.
Views = dict[str, TrialView]
#: Trials that are drawn one after the other, with their names and the signals of each axis.
Part = list[tuple[str, TrialFit, Sequence[Panel]]]


@dataclass(frozen=True)
class ModelsView:
    """The comparison of models: what the data support, the table, and the curves."""

    sentences: tuple[str, ...]
    heads: tuple[str, ...]
    rows: tuple[ModelRow, ...]
    effective: str
    unit: str
    drawing: Drawing


@dataclass(frozen=True)
class Chapter:
    """The content of one section."""

    anchor: str
    label: str
    reference_label: str
    result: IdentificationResult
    rows: tuple[SummaryRow, ...]
    facts: tuple[tuple[str, str], ...]
    small_multiples: Drawing | None
    tracks: Drawing | None
    featured: TrialView | None
    trials: tuple[TrialView, ...]
    residuals: tuple[Drawing, ...]
    profiles: Drawing | None
    models: ModelsView | None
    correlation: Drawing | None
    budget: BudgetTable | None
    starts: StartTable | None


@dataclass(frozen=True)
class ReportView:
    """The whole report."""

    comparison: GroupComparison
    chapters: tuple[Chapter, ...]


def build_view(sections: Sequence[ReportSection], processes: int = 1) -> ReportView:
    """Return the view of ``sections``, one per group; for :func:`..page.render`.

    At most ``processes`` draw at once; one, if the figures are saved.

    Raises:
        ValueError: no sections, or two with the same label.
    """
    if not sections:
        raise ValueError("a report needs at least one section")
    labels = [section.label for section in sections]
    double = sorted({label for label in labels if labels.count(label) > 1})
    if double:
        raise ValueError(f"sections of a report need labels of their own; twice: {double}")
    processes = 1 if saving() else processes
    anchors = [f"s{i}" for i in range(1, len(sections) + 1)]
    named = list(zip(anchors, sections, strict=True))
    parts = [part for anchor, section in named for part in _parts(anchor, section, processes)]
    work: list[Callable[[], Chapter | GroupComparison | Views]] = [
        *(partial(_chapter, *item) for item in named),
        partial(comparison, sections),
        *(partial(_trial_views, part) for part in parts),
    ]
    drawn = side_by_side(work, processes)
    views = {name: view for item in drawn if isinstance(item, dict) for name, view in item.items()}
    chapters = [item for item in drawn if isinstance(item, Chapter)]
    whole = [_with_trials(*item, views) for item in zip(chapters, sections, strict=True)]
    (compared,) = (item for item in drawn if isinstance(item, GroupComparison))
    return ReportView(compared, tuple(whole))


def _parts(anchor: str, section: ReportSection, count: int) -> list[Part]:
    """Return the trials of ``section`` in up to ``count`` parts, each to be drawn by itself."""
    trials = section.result.trials
    shared = panels(trials)
    length = max(1, math.ceil(len(trials) / count))
    return [
        [
            (_trial_name(anchor, i), trials[i], shared)
            for i in range(k, min(k + length, len(trials)))
        ]
        for k in range(0, len(trials), length)
    ]


def _trial_name(anchor: str, index: int) -> str:
    return f"{anchor}-t{index + 1}"


def _trial_views(part: Part) -> Views:
    views: Views = {}
    figure: Figure | None = None
    for name, item, shared in part:
        figure = trial.one_trial(item, shared, figure)
        views[name] = _trial_view(name, item, shared, figure)
    return views


def _chapter(anchor: str, section: ReportSection) -> Chapter:
    """Return the chapter of ``section`` without its trials."""
    result = section.result
    return Chapter(
        anchor=anchor,
        label=section.label,
        reference_label=section.reference_label,
        result=result,
        rows=summary_rows([section]),
        facts=_facts(result),
        small_multiples=_small_multiples(anchor, result),
        tracks=_tracks(anchor, result),
        featured=None,
        trials=(),
        residuals=_residuals(anchor, result),
        profiles=_profiles(anchor, result.profiles, _symbols(result)),
        models=_models(anchor, result),
        correlation=_correlation(anchor, result),
        budget=budget_table(result),
        starts=start_table(result),
    )


def _with_trials(chapter: Chapter, section: ReportSection, views: Views) -> Chapter:
    """Return ``chapter`` with those of ``views`` that are of its trials, one of them large."""
    trials = section.result.trials
    large = featured(trials) if trials else None
    own = [views[_trial_name(chapter.anchor, i)] for i in range(len(trials))]
    shown = next((view for view, trial in zip(own, trials, strict=True) if trial is large), None)
    others = tuple(view for view in own if view is not shown)
    return replace(chapter, result=section.result, featured=shown, trials=others)


def _facts(result: IdentificationResult) -> tuple[tuple[str, str], ...]:
    return (
        ("Model", result.model),
        ("Method", result.method),
        ("Confidence of all intervals", f"{100 * result.confidence:g} %"),
        ("Samples in the fit", count(result.samples)),
        ("Worth as many independent samples", count(result.effective_samples)),
        ("Widening of errors by coloured residuals", f"× {number(result.inflation)}"),
        ("Cost at the minimum", number(result.cost)),
        ("Range visited", result.visited),
    )


def _trial_view(name: str, fit: TrialFit, shared: Sequence[Panel], figure: Figure) -> TrialView:
    used = int(fit.used.sum())
    condition = "" if names_condition(fit) else f"{fit.condition}: "
    unit = "" if fit.unit == "1" else f" {fit.unit}"
    quality = (
        f"{condition}RMS {number(fit.rms, digits=3)}{unit}, R² {number(fit.r_squared, 3)}, "
        f"{used} of {fit.used.size} samples used"
    )
    signals = ", ".join(words(signal) for panel in shared for signal in panel.names)
    alt = (
        f"Trial {fit.label}: {signals or 'no signals'}; measured and fitted {words(fit.output)} "
        f"and their difference over time; {quality}."
    )
    return TrialView(fit.label, quality, draw(figure, name, alt))


def _symbols(result: IdentificationResult) -> dict[str, str]:
    return {p.name: p.symbol for p in (*result.parameters, *result.derived)}


def _small_multiples(anchor: str, result: IdentificationResult) -> Drawing | None:
    if not result.trials:
        return None
    output = words(result.trials[0].output)
    alt = f"Measured and fitted {output} over time for each of {len(result.trials)} trials."
    caption = "Shaded: samples that did not enter the fit. All axes have the same scale."
    return draw(trial.small_multiples(result.trials), f"{anchor}-all", alt, caption)


def _tracks(anchor: str, result: IdentificationResult) -> Drawing | None:
    """Return the ways of the trials in the plane that bend; None if none does."""
    every = [(trial.label, trial.track) for trial in result.trials if trial.track is not None]
    found = [(label, track) for label, track in every if tracks.bends(track)]
    if not found:
        return None
    bodies = ", ".join(dict.fromkeys(track.body for _, track in found))
    gap = f"{1e3 * tracks.furthest([track for _, track in found]):.1f} mm"
    alt = (
        f"Measured and fitted way of {bodies} in {len(found)} trials that bend, up to {gap} apart."
    )
    caption = (
        f"The way of {bodies}; measured and fitted places are up to {gap} apart. Straight trials "
        "are left out."
    )
    return draw(tracks.tracks(found), f"{anchor}-tracks", alt, caption)


def _residuals(anchor: str, result: IdentificationResult) -> tuple[Drawing, ...]:
    if not result.trials:
        return ()
    failed = [test.name for test in result.residual_tests if not test.passed]
    words_of_tests = f"Tests not passed: {', '.join(failed)}." if failed else "All tests passed."
    return (
        draw(
            residual.over_time(result.trials),
            f"{anchor}-residual",
            f"Residuals of all {len(result.trials)} trials over time, end to end.",
            "Dotted lines separate trials; gaps are samples that did not enter the fit.",
        ),
        draw(
            residual.distribution(result.trials, result.autocorrelation),
            f"{anchor}-distribution",
            f"Histogram, normal quantile plot and autocorrelation of the residuals. "
            f"{words_of_tests}",
        ),
    )


def _profiles(anchor: str, found: Sequence[Profile], symbols: Mapping[str, str]) -> Drawing | None:
    if not found:
        return None
    ranges = "; ".join(f"{p.name} {interval(p.low, p.high)} {p.unit}" for p in found)
    caption = (
        "Each parameter is held while the others are refitted. Dashed: threshold of the "
        "confidence. Shaded: interval; it runs to the end of the grid if the profile never "
        "crosses the threshold, and the data then leave that side open."
    )
    figure = profile.profiles(found, symbols)
    return draw(figure, f"{anchor}-profile", f"Profile likelihoods: {ranges}.", caption)


def _models(anchor: str, result: IdentificationResult) -> ModelsView | None:
    found = result.comparison
    if found is None:
        return None
    names = ", ".join(score.name for score in found.scores)
    alt = f"{words(found.y_name)} over {words(found.x_name)} of {names}."
    caption = "Over the range that the data visited. Dotted: models that do not fit."
    return ModelsView(
        sentences=found.sentences,
        heads=HEADS,
        rows=model_rows(found),
        effective=count(found.effective_samples),
        unit=found.unit,
        drawing=draw(models.models(found), f"{anchor}-models", alt, caption),
    )


def _correlation(anchor: str, result: IdentificationResult) -> Drawing | None:
    symbols = _symbols(result)
    names = [symbols.get(name, name) for name in result.correlation_names]
    if len(names) < 2:
        return None
    strongest = max(
        ((i, j) for i in range(len(names)) for j in range(i)),
        key=lambda pair: abs(result.correlation[pair]),
    )
    alt = (
        f"Correlation matrix of {', '.join(names)}; the strongest is "
        f"{number(float(result.correlation[strongest]), 2)} between {names[strongest[1]]} and "
        f"{names[strongest[0]]}."
    )
    return draw(correlation.correlation(names, result.correlation), f"{anchor}-rho", alt, alt)
