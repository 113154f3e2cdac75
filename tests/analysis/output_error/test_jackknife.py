"""What a fit becomes without each trial, against fits without it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rigd.analysis.output_error.jackknife import jackknife_sd, without_each_trial

from .lines import NOISE, Lines, fitted

ENDS = (3.0, 5.0, 2.0, 4.0)
OWN = 0


def lines(offset: float = 0.0) -> Lines:
    """Return four trials of one group; the readings of the last are off by ``offset``."""
    trials = tuple((OWN, end) for end in ENDS)
    made = Lines(trials, (1.0,))
    measured = (*made.measured[:-1], made.measured[-1] + offset)
    return Lines(trials, (1.0,), measured=measured)


def test_step_without_trial_is_that_of_refit() -> None:
    system = lines()
    whole = fitted(system)
    steps = without_each_trial(whole)
    for left_out, step in enumerate(steps):
        kept = [k for k in range(len(ENDS)) if k != left_out]
        again = fitted(
            Lines(
                tuple(system.trials[k] for k in kept), (1.0,),
                measured=tuple(system.measured[k] for k in kept),
            )
        )  # fmt: skip
        np.testing.assert_allclose(step, again.fit.theta - whole.fit.theta, atol=0.05 * NOISE)


def test_error_of_one_trial_shows_in_jackknife() -> None:
    for offset, wider in ((0.0, False), (5.0 * NOISE, True)):
        whole = fitted(lines(offset))
        spread = jackknife_sd(without_each_trial(whole)[:, OWN])
        assert (spread > 4.0 * math.sqrt(whole.inverse[OWN, OWN])) is wider


def test_jackknife_of_mean_is_its_standard_error() -> None:
    values = np.array([1.0, 2.0, 4.0, 7.0])
    without = (values.sum() - values) / 3.0 - values.mean()
    error = float(np.std(values, ddof=1)) / 2.0
    assert jackknife_sd(without) == pytest.approx(error * 3.182446 / 1.959964)


def test_single_trial_has_no_jackknife() -> None:
    assert jackknife_sd(np.zeros(1)) == 0.0
