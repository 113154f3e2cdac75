"""Tests whether the residuals are as the fit assumed: white, Gaussian, without outliers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats import chi2

from rigd.analysis.result import Autocorrelation, FloatArray, ResidualTest

LEVEL = 0.05
OUTLIER_SD = 5.0
OUTLIER_SHARE = 1e-3  #: a Gaussian has 6e-7 beyond five standard deviations
MAX_EXCESS_KURTOSIS = 1.0


def autocorrelation(trials: Sequence[FloatArray], lags: int, period_s: float) -> Autocorrelation:
    """Return the autocorrelation pooled over ``trials`` up to ``lags``, with its 95 % white band.

    Every trial is centred by itself, so that a constant offset of one is not read as memory.
    """
    products = np.zeros(lags + 1)
    count = 0
    for residuals in trials:
        centred = residuals - np.mean(residuals)
        count += len(centred)
        for lag in range(min(lags, len(centred) - 1) + 1):
            products[lag] += float(np.dot(centred[: len(centred) - lag], centred[lag:]))
    value = products / products[0] if products[0] > 0.0 else np.zeros(lags + 1)
    return Autocorrelation(
        lag_s=np.arange(1, lags + 1, dtype=np.float64) * period_s,
        value=value[1:],
        band=1.959964 / float(np.sqrt(count)),
    )


def ljung_box(trials: Sequence[FloatArray], lags: int) -> ResidualTest:
    """Return the portmanteau test of whiteness (Ljung and Box 1978), pooled over trials.

    Each trial's Q is chi-square with ``lags`` degrees of freedom under whiteness; they add. There
    are no more lags than a quarter of the shortest trial.
    """
    lags = min(lags, max(1, min(map(len, trials)) // 4))
    statistic = 0.0
    for residuals in trials:
        n = len(residuals)
        rho = autocorrelation([residuals], lags, 1.0).value
        statistic += n * (n + 2) * float(np.sum(rho**2 / (n - np.arange(1, lags + 1))))
    p_value = float(chi2.sf(statistic, lags * len(trials)))
    passed = p_value > LEVEL
    return ResidualTest(
        "whiteness (Ljung-Box)",
        statistic,
        p_value,
        passed,
        "The residuals are white."
        if passed
        else "The residuals are coloured (smoothing, vibration, model error); standard errors that "
        "assume white noise would be too small, those given here do not assume it.",
    )


def normality(residuals: FloatArray, effective_share: float) -> ResidualTest:
    """Return the Jarque-Bera test on ``effective_share`` of the samples as independent ones."""
    z = (residuals - np.mean(residuals)) / max(float(np.std(residuals)), np.finfo(float).tiny)
    skewness, excess = float(np.mean(z**3)), float(np.mean(z**4)) - 3.0
    statistic = effective_share * len(z) / 6.0 * (skewness**2 + excess**2 / 4.0)
    p_value = float(chi2.sf(statistic, 2))
    return ResidualTest(
        "normality (Jarque-Bera)",
        statistic,
        p_value,
        p_value > LEVEL,
        f"Skewness {skewness:+.2f}, excess kurtosis {excess:+.2f}"
        + ("." if excess < MAX_EXCESS_KURTOSIS else ": heavy tails; try the robust loss."),
    )


def outliers(residuals: FloatArray) -> ResidualTest:
    """Return the share of residuals beyond five robust standard deviations."""
    centre = float(np.median(residuals))
    sd = 1.4826 * float(np.median(np.abs(residuals - centre)))
    share = float(np.mean(np.abs(residuals - centre) > OUTLIER_SD * sd)) if sd > 0.0 else 0.0
    passed = share <= OUTLIER_SHARE
    return ResidualTest(
        "outliers",
        share,
        None,
        passed,
        f"{100 * share:.3g} % of the samples lie beyond {OUTLIER_SD:.0f} robust standard deviations"
        + ("." if passed else "; look at the trials, or fit with the robust loss."),
    )


def goodness(measured: FloatArray, fitted: FloatArray) -> tuple[float, float]:
    """Return RMS of the residual (unit of the inputs) and R squared; R squared is 0 if constant."""
    error = fitted - measured
    total = float(np.sum((measured - np.mean(measured)) ** 2))
    rms = float(np.sqrt(np.mean(error**2)))
    return rms, 1.0 - float(np.sum(error**2)) / total if total > 0.0 else 0.0
