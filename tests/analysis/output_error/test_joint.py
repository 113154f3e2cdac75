"""Groups that share constants: fitted each for itself, they end where one large fit does."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from rigd.analysis.output_error.estimator import OutputErrorFit, conclude
from rigd.analysis.output_error.homogeneity import TrialParts, differences, homogeneity, trend
from rigd.analysis.output_error.joint_fit import Joint, join, left_by
from rigd.analysis.output_error.score import Scores
from rigd.analysis.output_error.thresholds import THRESHOLDS
from rigd.analysis.result import FloatArray

from .lines import BLOCK, ROWS, Lines, fitted

ENDS = ((3.0,), (3.0, 5.0), (2.0,))
OWN = (1.0, 2.0, 0.5)


def groups(*, wrong: float = 0.0) -> list[OutputErrorFit]:
    """Return the fit of each group by itself; the gain of the last is off by ``wrong``."""
    return [
        fitted(Lines(tuple((0, end) for end in ends), (own,), 0.4 + (wrong if k == 2 else 0.0), k))
        for k, (ends, own) in enumerate(zip(ENDS, OWN, strict=True))
    ]


def joined(fits: list[OutputErrorFit]) -> Joint:
    return join(fits, ("gain", "offset"), [BLOCK] * len(fits))


@pytest.fixture(scope="module")
def whole() -> OutputErrorFit:
    """One large fit of the same trials."""
    trials = tuple((k, end) for k, ends in enumerate(ENDS) for end in ends)
    measured = tuple(part for item in groups() for part in item.model.system.measured)
    return fitted(Lines(trials, OWN, measured=measured))


def test_groups_end_where_one_large_fit_does(whole: OutputErrorFit) -> None:
    joint = joined(groups())
    for k, group in enumerate(joint.fits):
        sd = math.sqrt(whole.inverse[k, k])
        assert group.fit.theta[0] == pytest.approx(whole.fit.theta[k], abs=0.01 * sd)
        assert math.sqrt(group.inverse[0, 0]) == pytest.approx(sd, rel=0.01)
    for place, constant in zip((-2, -1), joint.constants, strict=True):
        sd = math.sqrt(whole.inverse[place, place])
        assert constant.moved == pytest.approx(whole.fit.theta[place], abs=0.01 * sd)


def test_shared_constants_narrow_each_group() -> None:
    alone = groups()
    for before, after in zip(alone, joined(alone).fits, strict=True):
        assert after.covariance[0, 0] < before.covariance[0, 0]


def test_groups_that_disagree_stay_apart() -> None:
    alone = groups(wrong=1.0)
    joint = joined(alone)
    assert joint.differing[0].name == "gain"
    assert joint.differing[0].wording == "the gain"
    assert all(a is b for a, b in zip(joint.fits, alone, strict=True))


class Deaf(Lines):
    """Trials that show nothing of the gain."""

    def linearise(
        self, trial: int, shared: FloatArray, local: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        y, by = super().linearise(trial, shared, local)
        y, by = y - shared[-2] * by[:, :, -2], by.copy()
        by[:, :, -2] = 0.0
        return y, by


def test_group_that_shows_nothing_hides_no_difference() -> None:
    deaf = fitted(Deaf(((0, 3.0), (0, 5.0)), (1.0,), seed=7))
    joint = joined([*groups(wrong=1.0), deaf])
    assert joint.differing[0].name == "gain"


def test_trials_that_show_nothing_hide_no_change() -> None:
    """The last group has a value of its own, for which an offset of its level would stand in."""
    lines = Lines(tuple((k // 12, 3.0 + 0.1 * k) for k in range(18)), (1.0, 1.0))
    raised = [0.5 * np.sin(np.linspace(0.0, end, ROWS))[:, None] for _, end in lines.trials]
    measured = tuple(
        y + more if 6 <= k < 12 else y
        for k, (y, more) in enumerate(zip(lines.measured, raised, strict=True))
    )
    scores = Scores(fitted(replace(lines, measured=measured)), BLOCK)
    assert (
        differences(scores, 0, [k // 6 for k in range(18)]).p_value
        < THRESHOLDS.max_p_value_agreement
    )


def test_fit_before_its_end_shows_no_trend() -> None:
    """Parameters that have some way to go are no change from trial to trial."""
    lines = Lines(tuple((0, 3.0 + 0.1 * k) for k in range(18)), (1.0,))
    end = fitted(lines)
    sds = np.sqrt(np.diag(end.covariance))
    scaled = end.fit.scaled + 2.0 * sds
    short = conclude(end.model, replace(end.fit, theta=scaled, scaled=scaled), BLOCK)
    found = [trend(Scores(item, BLOCK), 0, 18) for item in (end, short)]
    assert found[1].gain == pytest.approx(found[0].gain, abs=0.5)
    assert found[1].p_value > 0.01


@pytest.mark.parametrize(("alternating", "words"), [(0.0, "rises from"), (0.08, "not steadily")])
def test_change_between_trials_is_wear_if_steady(alternating: float, words: str) -> None:
    lines = Lines(tuple((0, 3.0 + 0.1 * k) for k in range(12)), (1.0,))
    more = np.linspace(-0.1, 0.1, 12) + alternating * np.array([1, -1, -1, 1] * 3)
    measured = tuple(
        y + size * np.sin(np.linspace(0.0, end, ROWS))[:, None]
        for y, size, (_, end) in zip(lines.measured, more, lines.trials, strict=True)
    )
    (found,) = homogeneity(fitted(replace(lines, measured=measured)), 0, "slope", (), BLOCK)
    assert not found.passed
    assert words in found.sentence


def test_one_group_stays_as_it_is() -> None:
    alone = groups()[:1]
    joint = joined(alone)
    assert joint.fits == tuple(alone)
    assert joint.constants == ()


def test_what_is_left_leads_back_to_the_group() -> None:
    fit = groups()[1]
    left = left_by(fit, ("gain", "offset"))
    known = np.linalg.solve(left.information + np.eye(2), left.aim)
    np.testing.assert_allclose(known, fit.pulls[1:], atol=1e-6)


def test_single_trial_has_nothing_to_agree_with() -> None:
    parts = TrialParts("recordings", ["a"], "")
    assert homogeneity(fitted(Lines(((0, 6.0),), (0.7,))), 0, "level", [parts], BLOCK) == ()
