from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from rigd.analysis.report import ReportSection
from rigd.analysis.report.layout import panels
from rigd.analysis.report.plots.trial import one_trial, small_multiples
from rigd.analysis.report.svg import draw, drawing_style
from rigd.analysis.result import Signal, TrialFit

Maker = Callable[..., ReportSection]


@pytest.fixture(scope="module")
def trials(make_section: Maker) -> tuple[TrialFit, ...]:
    return make_section(trials=7, samples=400).result.trials


@pytest.mark.parametrize("signals", [0, 1, 2, 3, 4])
def test_axes_of_signals_fits_and_residuals_never_overlap(
    trials: tuple[TrialFit, ...], signals: int
) -> None:
    trial = replace(
        trials[0],
        signals={f"x{i}": Signal(f"{i} V", np.ones(400)) for i in range(signals)},
    )
    axes = one_trial(trial, panels([trial])).axes
    labels = [ax.get_ylabel() for ax in axes]
    expected = [f"x{i} [{i} V]" for i in range(signals)]
    assert sorted(labels) == sorted([*expected, "traction force [N]", "residual [N]"])
    boxes = [ax.get_position() for ax in axes]
    for i, box in enumerate(boxes):
        for other in boxes[:i]:
            assert box.x1 <= other.x0 or other.x1 <= box.x0 or box.y1 <= other.y0


def test_figure_drawn_over_is_that_of_its_trial(trials: tuple[TrialFit, ...]) -> None:
    first, second = trials[0], replace(trials[1], t_s=3.0 * trials[1].t_s)
    shared = panels([first, second])
    with drawing_style():
        figure = one_trial(first, shared)
        draw(figure, "first", "")
        again = draw(one_trial(second, shared, figure), "second", "")
        assert again == draw(one_trial(second, shared), "second", "")


def test_each_trial_has_small_axes_on_one_scale(trials: tuple[TrialFit, ...]) -> None:
    long = replace(trials[0], label="a label that goes on and on, run 17 of the second day")
    axes = small_multiples((long, *trials[1:])).axes
    assert [ax.get_title(loc="left") or ax.get_title() for ax in axes] == [
        "a label that goes on and on, …",
        *(trial.label for trial in trials[1:]),
    ]
    assert len({ax.get_ylim() for ax in axes}) == 1
