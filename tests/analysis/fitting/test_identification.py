"""Intervals join chance and method; a model that does not fit, or loses by far, gives no number."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import t

from rigd.analysis import Options
from rigd.analysis.fitting.fit import Fit
from rigd.analysis.fitting.identification import FittedSubject, Rival, identify_model
from rigd.analysis.fitting.response import (
    Axis,
    ResponseModel,
    ResponseQuantity,
    Wording,
    identify_response,
)
from rigd.analysis.result import (
    Curve,
    FitOutcome,
    IdentificationResult,
    ParameterEstimate,
    Preprocessing,
    Verdict,
)

from .polynomials import SAMPLES, polynomial, smoothed, white

FloatArray = NDArray[np.float64]
Z_95 = 1.959964


def subject(model: ResponseModel) -> FittedSubject:
    x = np.linspace(-1.0, 1.0, 5)
    return FittedSubject(
        model=model,
        name="polynomial",
        method="sample by sample",
        title="A polynomial",
        words=[ResponseQuantity(p.name, "a coefficient", "more x") for p in model.parameters],
        account=Preprocessing((), {}, {}),
        period_s=1e-3,
        visited="",
        curve=lambda spread: Curve("y", "x", "1", "y", "1", x, x, x, x),
        trials=lambda theta: (),
    )


def identified(found: FittedSubject) -> IdentificationResult:
    return identify_model(found, Options(starts=1))


def half_width(estimate: ParameterEstimate) -> float:
    assert estimate.low is not None
    assert estimate.high is not None
    return 0.5 * (estimate.high - estimate.low)


def test_other_processing_widens_an_interval_in_quadrature() -> None:
    plain = subject(polynomial(0, 10, white(1)))
    alone = half_width(identified(plain).parameters[0])

    def moved(best: Fit) -> tuple[FloatArray, ...]:
        return best.theta + 0.01, best.theta - 0.01

    both = half_width(identified(replace(plain, others=moved)).parameters[0])
    assert both == pytest.approx(math.hypot(alone, Z_95 * 0.01), rel=0.01)


def test_trials_that_differ_widen_an_interval() -> None:
    """Each trial has an offset of its own, which no sample of it shows."""

    def offset(k: int) -> FloatArray:
        return white(1, sd=0.01)(k) + 0.2 * np.random.default_rng([5, k]).standard_normal()

    plain = subject(polynomial(0, 10, offset))
    offsets = [float(np.mean(trial.measured)) for trial in polynomial(0, 10, offset).trials]
    known = float(t.ppf(0.975, 9)) * float(np.std(offsets, ddof=1)) / math.sqrt(10.0)
    found = half_width(identified(replace(plain, jackknife=True, block_s=5e-3)).parameters[0])
    assert found == pytest.approx(known, rel=0.02)


def test_parameter_below_a_vibration_has_an_interval() -> None:
    """Swings of 20 ms cancel in blocks of 100 ms, so that the standard error is far too small."""

    def vibration(k: int) -> FloatArray:
        swing = 0.3 * np.sin(2.0 * np.pi * np.arange(SAMPLES) / 20.0)
        return np.asarray(white(1, sd=0.001)(k) + swing)

    (found,) = identified(subject(polynomial(0, 10, vibration))).parameters
    assert found.verdict is Verdict.IDENTIFIABLE
    assert found.low is not None and found.high is not None
    assert found.low < 1.0 < found.high


@pytest.mark.parametrize("period", [20, 37])
def test_vibration_leaves_curve_as_wide_as_interval(period: int) -> None:
    """The curve of the model of one constant is that constant: so is its band."""

    def vibration(k: int) -> FloatArray:
        swing = 0.3 * np.sin(2.0 * np.pi * np.arange(SAMPLES) / period)
        return np.asarray(white(1, sd=0.001)(k) + swing)

    y = Axis("y", "1")
    words = Wording("m", "", "", Axis("x", "1"), y, (ResponseQuantity("c0", "a constant", ""),))
    found = identify_response(
        polynomial(0, 10, vibration), words, Options(starts=1), Preprocessing((), {}, {})
    )
    (estimate,), curve = found.parameters, found.curve
    band = 0.5 * float(np.median(curve.high - curve.low))
    assert band == pytest.approx(half_width(estimate), rel=0.1)
    assert estimate.standard_error == pytest.approx(half_width(estimate) / Z_95, rel=0.1)


def test_a_bias_of_the_method_withholds_the_number() -> None:
    plain = subject(polynomial(1, 10, white(1), slope=0.5))
    found = identified(replace(plain, biases={"c1": "The filter bends it."})).parameters
    assert found[1].verdict is Verdict.BIASED
    assert found[1].sentence == "The filter bends it."
    assert found[1].quoted is None
    assert found[0].verdict is Verdict.IDENTIFIABLE


@dataclass(frozen=True)
class Told:
    """A model and its rival, and the reason for which the model is refused."""

    noise: Callable[[int], FloatArray]
    slope: float
    memory_s: float
    reason: str


@pytest.mark.parametrize(
    "case",
    [
        Told(white(1), 0.3, 60e-3, "a line fits them far better, ΔBIC"),
        Told(lambda k: np.sin(np.linspace(0.0, 9.0, SAMPLES)), 0.0, 5e-3, "its residuals remember"),
    ],
)
def test_model_that_does_not_fit_gives_no_number(case: Told) -> None:
    model = polynomial(0, 10, case.noise, case.slope)
    rival = polynomial(1, 10, case.noise, case.slope)
    found = identified(
        replace(subject(model), memory_s=case.memory_s, rivals={"a line": Rival(rival)})
    )
    assert found.gate is not None
    assert found.gate.outcome is FitOutcome.MISFIT
    assert case.reason in found.gate.sentence
    assert found.gate.sentence in found.warnings
    assert [p.quoted for p in found.parameters] == [None]
    assert found.parameters[0].verdict is Verdict.MISFIT
    assert found.curve.x.size == 0
    assert found.profiles == ()


@pytest.mark.parametrize("robust", [False, True])
def test_loss_does_not_decide_which_model_wins(robust: bool) -> None:
    slope = 0.04
    rival = polynomial(1, 10, white(1), slope)
    told = replace(
        subject(polynomial(0, 10, white(1), slope)),
        memory_s=2e-3,
        rivals={"a line": Rival(rival)},
    )
    found = identify_model(told, Options(starts=1, robust=robust))
    assert found.gate is not None
    assert found.gate.outcome is FitOutcome.MISFIT
    assert "a line fits them far better" in found.gate.sentence


def test_rival_without_better_fit_is_ignored() -> None:
    noise = smoothed(1, 5)
    rival = polynomial(2, 10, noise)
    found = identified(
        replace(
            subject(polynomial(0, 10, noise)), memory_s=10e-3, rivals={"a parabola": Rival(rival)}
        )
    )
    assert found.gate is not None
    assert found.gate.outcome is FitOutcome.FITS
    assert found.parameters[0].quoted == pytest.approx(1.0, abs=0.05)
