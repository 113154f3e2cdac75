"""Groups that share constants: fitted each for itself, they end where one large fit does."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest

from rigd.analysis.innovations import Deviations
from rigd.analysis.joint import Joint, join, left_by
from rigd.analysis.model import FitParameter, Scaling
from rigd.analysis.output_error import OutputErrorFit, estimate
from rigd.analysis.result import FloatArray
from rigd.analysis.system import Output, Unknown

ROWS, BLOCK = 60, 10
NOISE = 0.05


def unknown(name: str, u: float = math.inf) -> Unknown:
    return Unknown(FitParameter(name, "1", -50.0, 50.0, 0.0, Scaling.LINEAR), u, f"the {name}")


@dataclass(frozen=True, eq=False)
class Lines:
    """Trials y = sin(t) f(own) + gain cos(t/2) + offset, f not linear; a value ``own`` per group.

    ``trials`` has (group, end of t) of each. Gain and offset are shared, stated to be 0 with the
    uncertainty 1. Without ``measured`` the trials are made with noise.
    """

    trials: tuple[tuple[int, float], ...]
    own: tuple[float, ...]
    gain: float = 0.4
    seed: int = 1
    measured: tuple[FloatArray, ...] = ()
    local: tuple[Unknown, ...] = ()
    outputs: tuple[Output, ...] = (Output("y", "1"),)

    def __post_init__(self) -> None:
        if self.measured:
            return
        rng, truth = np.random.default_rng(self.seed), np.array([*self.own, self.gain, -0.3])
        made = [self.simulate(k, truth, truth[:0]) for k in range(len(self.trials))]
        noisy = tuple(y + NOISE * rng.standard_normal(y.shape) for y in made)
        object.__setattr__(self, "measured", noisy)

    @property
    def shared(self) -> tuple[Unknown, ...]:
        own = [unknown(f"own {k}") for k in range(len(self.own))]
        return (*own, unknown("gain", 1.0), unknown("offset", 1.0))

    def linearise(
        self, trial: int, shared: FloatArray, local: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        group, end = self.trials[trial]
        t, value = np.linspace(0.0, end, ROWS), shared[group]
        by = np.zeros((ROWS, 1, len(shared)))
        by[:, 0, group] = np.sin(t) * (1.0 + 0.1 * np.cos(value))
        by[:, 0, -2], by[:, 0, -1] = np.cos(0.5 * t), 1.0
        y = np.sin(t) * (value + 0.1 * np.sin(value)) + shared[-2] * by[:, 0, -2] + shared[-1]
        return y[:, None], by

    def simulate(self, trial: int, shared: FloatArray, local: FloatArray) -> FloatArray:
        return self.linearise(trial, shared, local)[0]

    def deviations(self, trial: int, shared: FloatArray, local: FloatArray) -> Deviations:
        blank = np.zeros((ROWS, 1, 1))
        return Deviations(
            blank, blank[:, 0], blank, np.full((ROWS, 1), NOISE**2), np.zeros(1), np.eye(1)
        )


ENDS = ((3.0,), (3.0, 5.0), (2.0,))
OWN = (1.0, 2.0, 0.5)


def fitted(system: Lines) -> OutputErrorFit:
    return estimate(system, [np.zeros(len(system.shared))], BLOCK)


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
