"""Groups that share constants: fitted each for itself, they end where one large fit does."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rigd.analysis.joint import Joint, join, left_by
from rigd.analysis.output_error import OutputErrorFit

from .lines import BLOCK, Lines, fitted

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
