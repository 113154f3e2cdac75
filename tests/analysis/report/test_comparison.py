"""The first page of a report: what is drawn of all groups together."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from rigd.analysis.report import ReportSection
from rigd.analysis.report.comparison import comparison
from rigd.analysis.result import Signal


def test_single_group_is_overlaid_with_nothing(make_section: Callable[..., ReportSection]) -> None:
    single = make_section(trials=2, samples=200)
    assert (comparison([single]).signals, comparison([single]).fits) == ((), ())
    both = comparison([single, replace(single, label="another")])
    assert len(both.signals) == 3
    assert len(both.fits) == 1


def test_lines_without_condition_have_only_their_group(
    make_section: Callable[..., ReportSection],
) -> None:
    section = make_section(trials=1, samples=200)
    trials = tuple(replace(trial, condition="") for trial in section.result.trials)
    bare = replace(section, label="alone", result=replace(section.result, trials=trials))
    found = comparison([bare, replace(bare, label="beside")])
    for drawings in (found.signals, found.fits):
        drawn = "".join(drawing.svg for drawing in drawings)
        assert "<!-- alone -->" in drawn  # letters are drawn; the text stands beside them
    assert "alone, wheel speed" in "".join(drawing.svg for drawing in found.signals)
    assert "alone," not in "".join(drawing.svg for drawing in found.fits)


def test_more_signals_than_dashes_are_not_overlaid(
    make_section: Callable[..., ReportSection],
) -> None:
    section = make_section(trials=1, samples=200)
    (trial,) = section.result.trials
    many = {f"force_{n}": Signal("N", np.ones(len(trial.t_s))) for n in range(8)}
    full = replace(section, result=replace(section.result, trials=(replace(trial, signals=many),)))
    assert comparison([full, replace(full, label="another")]).signals == ()
