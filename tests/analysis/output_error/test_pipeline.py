"""The order of steps, on a small family: what each of them makes of right and of wrong trials."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest

from rigd.analysis.fitting.identifiability import Z_95
from rigd.analysis.fitting.model import FitParameter, Scaling
from rigd.analysis.output_error.estimator import OutputErrorFit
from rigd.analysis.output_error.pipeline import Family, concluded, diagnosed, fitted, identify
from rigd.analysis.output_error.structure import Suspect
from rigd.analysis.output_error.system import Diverged, Unknown
from rigd.analysis.result import FitOutcome, FloatArray, Gate, ResidualTest

from .lines import BLOCK, ROWS, Lines

ENDS = (6.0, 5.0, 4.0)
WAVE = np.sin(9.0 * np.linspace(0.0, 1.0, ROWS))
OWN, GAIN = 0, 1


@dataclass(frozen=True, eq=False, kw_only=True)
class LineFamily(Family[Lines]):
    """Lines with a wave as their only suspect; ``others`` are their variants."""

    others: tuple[Lines, ...] = ()
    refused: bool = False

    def suspects(self, theta: FloatArray) -> Iterator[Suspect]:
        columns = [WAVE[:, None, None] for _ in self.system.trials]
        yield Suspect("a wave", "1", lambda: columns, special=True)

    def agreement(self, whole: OutputErrorFit, gate: Gate) -> tuple[ResidualTest, ...]:
        return (ResidualTest("agreement", 9.0, 1e-5, not self.refused, "They disagree."),)

    def findings(self, whole: OutputErrorFit, gate: Gate, tests: tuple[ResidualTest, ...]) -> Gate:
        failed = [test.sentence for test in tests if not test.passed]
        return Gate(FitOutcome.MISFIT, failed[0]) if failed else gate

    def variants(self) -> Sequence[Lines]:
        return self.others


def family(wave: float = 0.0) -> LineFamily:
    lines = Lines(tuple((0, end) for end in ENDS), (0.7,))
    # No trial has quite the same wave: what is added stands for something else.
    sizes = wave * np.array([1.08, 1.0, 0.92])
    measured = tuple(
        y + size * WAVE[:, None] for y, size in zip(lines.measured, sizes, strict=True)
    )
    return LineFamily(
        system=replace(lines, measured=measured), labels=("a", "b", "c"), period_s=1e-3,
        block=BLOCK, starts=(np.zeros(len(lines.shared)),),
    )  # fmt: skip


def test_right_trials_fit_with_nothing_added() -> None:
    found = identify(family())
    assert found.gate.outcome is FitOutcome.FITS
    sds = np.sqrt(np.diag(found.whole.covariance))
    assert np.all(np.abs(found.theta - [0.7, 0.4, -0.3]) < 2.0 * Z_95 * sds)
    assert found.shifts == ()
    assert found.by_trials(np.eye(len(sds))[OWN]) == 0.0


def test_added_explanation_widens_by_single_trials() -> None:
    found = identify(family(wave=0.4))
    assert found.gate.outcome is FitOutcome.CORRECTED
    assert "a wave" in found.gate.sentence
    assert len(found.without) == len(ENDS)
    gradient = np.zeros(len(found.theta))
    gradient[-1] = 1.0  # of the wave, whose size differs from trial to trial
    assert found.by_trials(gradient) > np.sqrt(found.whole.covariance[-1, -1])


def test_disagreement_of_trials_ends_without_numbers() -> None:
    refused = replace(family(), refused=True, others=(family().system,))
    found = identify(refused)
    assert found.gate.sentence == "They disagree."
    assert not found.fits
    assert found.variants == ()


def test_fit_without_an_end_gives_advice() -> None:
    class Advised(LineFamily):
        @property
        def advice(self) -> str:
            return "Record more."

    begun = family()
    advised = Advised(
        system=begun.system, labels=begun.labels, period_s=1e-3, block=BLOCK, starts=begun.starts
    )
    diagnosis = diagnosed(advised, fitted(advised))
    far = replace(diagnosis, whole=replace(diagnosis.whole, left=np.array([0.0, 2.0, 0.0])))
    gate = concluded(far).gate
    assert gate.outcome is FitOutcome.MISFIT
    assert gate.sentence == (
        "No number is given: the fit has not converged: gain has 2 standard errors to go. "
        "Record more."
    )


def test_variants_move_a_quantity() -> None:
    right = family()
    louder = replace(right.system, measured=tuple(1.01 * y for y in right.system.measured))
    found = identify(replace(right, others=(louder, right.system)))
    assert found.by_method(lambda theta: float(theta[OWN] - found.theta[OWN])) == pytest.approx(
        0.01 * 0.75 / np.sqrt(2.0), rel=0.1
    )


class Endless(Lines):
    """The last trial cannot be simulated."""

    def linearise(
        self, trial: int, shared: FloatArray, local: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        outputs, by = super().linearise(trial, shared, local)
        return (np.full_like(outputs, np.inf), by) if trial == 2 else (outputs, by)


def test_trial_that_leaves_the_numbers_is_named() -> None:
    right = family()
    endless = Endless(right.system.trials, right.system.own, measured=right.system.measured)
    with pytest.raises(Diverged, match="c: its simulation leaves the numbers"):
        identify(replace(right, system=endless))


def test_doubts_count_for_what_they_move() -> None:
    found = replace(diagnosed(family(), fitted(family())), shifts=(np.array([0.1, -0.3]),))
    gradient = np.zeros(3)
    assert found.by_unexplained(gradient) == 0.0
    gradient[GAIN] = 2.0
    assert found.by_unexplained(gradient) == pytest.approx(0.6)


def test_right_trials_are_seldom_named_or_refused() -> None:
    """The sum of all levels bounds how often: 1.0 % and that of the test of agreement."""
    right = family()
    alarms = identify(right).alarms
    assert sum(alarms.values()) == pytest.approx(0.0101)
    lines = [replace(right.system, seed=seed, measured=()) for seed in range(2, 62)]
    named = [
        identify(replace(right, system=system)).gate.outcome is not FitOutcome.FITS
        for system in lines
    ]
    assert sum(named) <= 4  # of 60; more come by chance in 1 of 1000 such studies


@dataclass(frozen=True, eq=False)
class Waves(Lines):
    """y = sin(value t) + gain cos(t/2) + offset: where waves do not meet, no slope leads home."""

    highest: float = 50.0

    @property
    def shared(self) -> tuple[Unknown, ...]:
        frequency = FitParameter("own 0", "1", 0.5, self.highest, 3.0, Scaling.LOG)
        return (Unknown(frequency), *super().shared[1:])

    def linearise(
        self, trial: int, shared: FloatArray, local: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        t = np.linspace(0.0, self.trials[trial][1], ROWS)
        by = np.ones((ROWS, 1, len(shared)))
        by[:, 0, OWN], by[:, 0, GAIN] = t * np.cos(shared[OWN] * t), np.cos(0.5 * t)
        y = np.sin(shared[OWN] * t) + shared[GAIN] * by[:, 0, GAIN] + shared[-1]
        return y[:, None], by


@pytest.mark.parametrize(
    ("start", "highest"),
    [
        (6.0, 50.0),  # ends far off
        (5.0, 5.0),  # stays on its bound
    ],
)
def test_wrong_end_is_sought_elsewhere(start: float, highest: float) -> None:
    waves = Waves(tuple((0, end) for end in ENDS), (2.6,), highest=highest)
    right = replace(family(), system=waves, starts=(np.array([start, 0.0, 0.0]),))
    end = right.fitted()
    assert abs(end.fit.theta[OWN] - 2.6) > 1.0
    found = identify(right)
    assert found.gate.outcome is FitOutcome.FITS
    assert found.theta[OWN] == pytest.approx(2.6, abs=0.02)
    assert any(np.array_equal(end.fit.theta, other) for other in found.whole.others)
