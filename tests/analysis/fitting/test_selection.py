"""Models compared by BIC and by trials left out: closed forms, and data of a known model."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from rigd.analysis.fitting.fit import fit
from rigd.analysis.fitting.selection import Contender, bic, compare, left_out_squares
from rigd.analysis.result import ModelScore

from .polynomials import SAMPLES, polynomial, smoothed, white

FloatArray = NDArray[np.float64]
Noise = Callable[[int], FloatArray]


def compared(
    noise: Noise, *, slope: float, window: int = 1, degrees: Sequence[int] = (0, 1, 2, 3)
) -> tuple[tuple[ModelScore, ...], str]:
    contenders = [
        Contender(f"degree {k}", "", polynomial(k, 20, noise, slope), lambda theta: theta)
        for k in degrees
    ]
    scores, sentences = compare(contenders, starts=1, seed=1, window=window, max_lag=60)
    return scores, " ".join(sentences)


def test_bic_is_that_of_schwarz() -> None:
    assert bic(cost=50.0, samples=1000, effective=100.0, parameters=3) == pytest.approx(
        100.0 * math.log(0.1) + 3.0 * math.log(100.0)
    )


@pytest.mark.parametrize("seed", range(8))
def test_the_model_that_made_the_data_wins(seed: int) -> None:
    scores, said = compared(white(seed), slope=0.3)
    assert scores[0].name == "degree 1"
    assert scores[0].delta_bic == 0.0
    assert scores[0].estimates == pytest.approx({"c0": 1.0, "c1": 0.3}, abs=0.02)
    assert "The data support 2 parameters: degree 1." in said
    assert "Fewer do not suffice: degree 0 (1) ΔBIC +" in said
    assert "More parameters are not supported: " in said
    assert said.endswith("Cross-validation over trials agrees: degree 1 has the least error.") or (
        "within chance" in said
    )


def test_smoothed_samples_count_for_less() -> None:
    """Counted one by one, smoothed noise seems to support parameters that nothing made."""

    def chosen(window: int) -> list[str]:
        return [
            min(compared(smoothed(seed, 20), slope=0.3, window=window)[0], key=bic_of).name
            for seed in range(12)
        ]

    def bic_of(score: ModelScore) -> float:
        return score.delta_bic

    assert chosen(20).count("degree 1") >= 11
    assert chosen(1).count("degree 1") <= 8


def test_equal_models_are_not_distinguished() -> None:
    scores, said = compared(white(1), slope=0.3, degrees=(1, 1))
    assert [score.delta_bic for score in scores] == [0.0, 0.0]
    assert "The data do not separate degree 1 (2 parameters) and degree 1 (2 parameters)" in said


def test_no_model_is_chosen_if_none_fits() -> None:
    def wave(k: int) -> FloatArray:
        return np.asarray(np.sin(np.linspace(0.0, 20.0, SAMPLES))) + white(1)(k)

    scores, said = compared(wave, slope=0.0)
    assert not any(score.fits for score in scores)
    assert said.startswith("None of the 4 models fits")


def test_cross_validation_that_disagrees_is_reported() -> None:
    """With few effective samples BIC sees no slope; each of 20 trials predicts it."""
    scores, said = compared(white(1, sd=0.1), slope=0.035, window=100, degrees=(0, 1))
    assert scores[0].name == "degree 0"
    assert "Cross-validation over trials disagrees: degree 1 (2 parameters) predicts" in said


def test_error_of_a_mean_left_out_is_known() -> None:
    model = polynomial(0, 5, white(3))
    measured = [trial.measured for trial in model.trials]
    expected = [
        np.sum((own - np.mean([m for m in measured if m is not own])) ** 2) for own in measured
    ]
    np.testing.assert_allclose(left_out_squares(model, fit(model)), expected, rtol=1e-8)
