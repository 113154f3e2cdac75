from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from rigd.analysis.report import ReportSection
from rigd.analysis.report.layout import Panel, featured, names_condition, panels
from rigd.analysis.result import Signal, TrialFit


@pytest.fixture(scope="module")
def trials(make_section: Callable[..., ReportSection]) -> tuple[TrialFit, ...]:
    return make_section(trials=10, samples=200).result.trials


def test_highest_current_is_shown_large(trials: tuple[TrialFit, ...]) -> None:
    assert featured(trials).condition == "1.50 A"
    backwards = replace(trials[0], condition="-1.80 A")
    assert featured((*trials, backwards)) is backwards


def test_featured_trial_compares_conditions_across_units(trials: tuple[TrialFit, ...]) -> None:
    small = replace(trials[9], condition="900 mA")
    assert featured((small, trials[6])).condition == "1.05 A"


def test_words_for_conditions_fall_back_to_the_output(trials: tuple[TrialFit, ...]) -> None:
    worded = tuple(replace(trial, condition="a run") for trial in trials)
    assert featured(worded).label == max(worded, key=lambda t: t.fitted[t.used].max()).label


def test_featured_refuses_an_empty_set() -> None:
    with pytest.raises(ValueError, match="no trial"):
        featured(())


@pytest.mark.parametrize(
    ("label", "condition", "said"),
    [
        ("1.5 A, repeat 2", "1.50 A", True),
        ("run 7 on wet stone", "wet stone", True),
        ("run 7", "1.5 A", False),
        ("run 7", "wet stone", False),
    ],
)
def test_label_may_contain_the_condition(
    trials: tuple[TrialFit, ...], label: str, condition: str, said: bool
) -> None:
    assert names_condition(replace(trials[0], label=label, condition=condition)) is said


def test_small_signals_get_an_axis_of_their_own(trials: tuple[TrialFit, ...]) -> None:
    assert panels(trials) == (
        Panel(("wheel_speed", "carriage_speed"), "m/s"),
        Panel(("relative_speed",), "m/s"),
        Panel(("motor_current",), "A"),
    )


def test_signal_without_numbers_still_gets_a_panel(trials: tuple[TrialFit, ...]) -> None:
    silent = replace(trials[0], signals={"x": Signal("m", np.full(200, np.nan))})
    assert panels([silent]) == (Panel(("x",), "m"),)
