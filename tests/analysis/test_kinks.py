"""A fit that ends at a kink of its cost has converged if nothing is left to go within the kink."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from rigd.analysis.fit import fit
from rigd.analysis.kinks import along_kinks
from rigd.analysis.output_error import OutputErrorFit, conclude
from rigd.analysis.result import FloatArray

from .lines import BLOCK, Lines, fitted

KINK, BACK = 0.45, -20.0


@dataclass(frozen=True, eq=False)
class Turning(Lines):
    """Lines whose gain acts in reverse, and more, beyond a value that the data ask to exceed."""

    def linearise(
        self, trial: int, shared: FloatArray, local: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        bent, beyond = shared.copy(), shared[-2] > KINK
        if beyond:
            bent[-2] = KINK + BACK * (shared[-2] - KINK)
        y, by = super().linearise(trial, bent, local)
        if beyond:
            by[:, :, -2] *= BACK
        return y, by


def at_kink() -> OutputErrorFit:
    data = Lines(((0, 6.0), (0, 5.0), (0, 4.0)), (0.7,), gain=0.6)
    return fitted(Turning(data.trials, data.own, measured=data.measured))


def test_minimum_at_a_kink_has_converged() -> None:
    ended = at_kink()
    assert not ended.converged
    found = along_kinks(ended, BLOCK)
    assert found.converged, found.left
    assert found.fit.theta[1] == pytest.approx(KINK, abs=1e-3)


def test_fit_stuck_at_a_kink_goes_on_within() -> None:
    ended = at_kink()
    found = along_kinks(ended, BLOCK)
    assert found.fit.cost < ended.fit.cost - 100.0
    for place in (0, 2):
        for step in (-0.02, 0.02):
            beside = found.fit.theta.copy()
            beside[place] += step
            assert found.model.cost(beside) > found.fit.cost


def test_unfinished_fit_without_a_kink_is_ended() -> None:
    ended = fitted(Lines(((0, 6.0), (0, 5.0)), (0.7,)))
    begun = conclude(ended.model, fit(ended.model, np.zeros(3), max_iterations=0), BLOCK)
    assert not begun.converged
    found = along_kinks(begun, BLOCK)
    assert found.converged
    assert found.fit.theta == pytest.approx(ended.fit.theta, abs=1e-3)
