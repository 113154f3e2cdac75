"""Computes the friction curve g(V_r) with its band, only for the slip range that the data cover."""

from __future__ import annotations

import numpy as np

from rigd.analysis import DataError
from rigd.analysis.fitting.interval_width import Spread
from rigd.analysis.report.rounding import span
from rigd.analysis.result import BoolArray, Curve, FloatArray, Seen
from rigd_analyses.lugre.model import (
    SIGMA_0,
    SIGMA_1,
    SIGMA_2,
    LugreModel,
    friction,
    friction_gradient,
)

POINTS = 60
SLIDING = 0.5  #: share of g at which the bristle counts as sliding
TRIM = 0.01  #: share of the samples that slide, of which the slip is above the visited one
#: Lengths of the bristle, g/sigma_0, that it slides below the visited slip.
FOLLOWED = 0.05
RANGES = 16  #: of slip, in which the data stand beside the curve
LEAST_SEEN = 20  #: samples in one of them
HARDLY = "the bristle slides in no trial, or hardly: nothing is known about friction"
RESOLVED = 10.0  #: slip below this many standard deviations of its noise is not resolved


def slid_range(
    slip_m_s: FloatArray, theta: FloatArray, period_s: float
) -> tuple[float, float] | None:
    """Return the slip in m/s at which samples with a sliding bristle show g; None: at none.

    ``slip_m_s`` (n,) are sizes, one each ``period_s``. The bristle follows g(V) over the distance
    g/sigma_0 (corrected Eq. 5: dz/dx = sigma_0 (1 - z/g) of z times sigma_0). If it slides a share
    of that below a speed, an error of g there moves the traction by that share of it only:
    below ``FOLLOWED`` any curve fits, and a small error of a sensor looks like one.
    """
    slip = np.sort(slip_m_s)
    lengths = period_s * np.cumsum(slip * theta[SIGMA_0] / friction(theta, slip))
    first = int(np.searchsorted(lengths, FOLLOWED))
    if first == len(slip):
        return None
    low, high = float(slip[first]), float(np.quantile(slip, 1.0 - TRIM))
    return (low, high) if low < high else None


def visited_range(model: LugreModel, theta: FloatArray, noise_m_s: float) -> tuple[float, float]:
    """Return the slip range in m/s that the used samples cover while the bristle slides.

    A bristle bent less than half way (|z| < g/2) feels its stiffness, hardly g. The range begins
    in which the slip exceeds ``noise_m_s``, its standard deviation.

    Raises:
        DataError: no trial slides, or none at a slip that the sensors resolve.
    """
    slip = np.concatenate([t.slip_m_s for t in model.trials])
    used = np.abs(slip[_sliding(model, theta, slip)])
    covered = slid_range(used, theta, model.trials[0].period_s)
    if covered is None:
        raise DataError(HARDLY, hint="record trials with more current")
    low, high = covered
    if high <= RESOLVED * noise_m_s:
        raise DataError(
            f"the slip reaches {1e3 * high:.2g} mm/s while the sensors resolve "
            f"{1e3 * RESOLVED * noise_m_s:.2g} mm/s: nothing is known about friction",
            hint="record trials with more current, or encoders with finer counts",
        )
    return max(low, RESOLVED * noise_m_s), high


def _sliding(model: LugreModel, theta: FloatArray, slip: FloatArray) -> BoolArray:
    """Return (n,) whether a sample counts and its bristle is bent half way to sliding."""
    bristle_only = theta.copy()
    bristle_only[[SIGMA_1, SIGMA_2]] = 0.0
    bent = np.abs(model.predict(bristle_only)) >= SLIDING * friction(theta, slip)
    return (model.mask > 0.0) & bent


def seen(model: LugreModel, theta: FloatArray, visited: tuple[float, float]) -> tuple[Seen, ...]:
    """Return what the samples show of g in ranges of slip: component plus residual.

    Of each measured force the fitted parts besides g are taken off (W. A. Larsen and S. J.
    McCleary, Technometrics 14, 1972): what is left is g plus the residual.
    """
    slip = np.concatenate([t.slip_m_s for t in model.trials])
    inside = _sliding(model, theta, slip)
    away = np.sign(slip) * -model.residuals(theta)
    return in_ranges(np.abs(slip[inside]), (friction(theta, np.abs(slip)) + away)[inside], visited)


def in_ranges(
    size: FloatArray, shown: FloatArray, visited: tuple[float, float]
) -> tuple[Seen, ...]:
    """Return what ``shown`` (n,) is of g in ranges of the slip ``size`` (n,), in m/s.

    Ranges with fewer than ``LEAST_SEEN`` samples are left out.
    """
    place = np.digitize(size, np.geomspace(visited[0], visited[1], RANGES + 1)) - 1
    found = []
    for index in range(RANGES):
        part = place == index
        if np.count_nonzero(part) < LEAST_SEEN:
            continue
        low, median, high = (float(q) for q in np.quantile(shown[part], [0.25, 0.5, 0.75]))
        middle = float(np.median(size[part]))
        found.append(Seen(middle, median, low, high, int(np.count_nonzero(part))))
    return tuple(found)


def friction_curve(
    spread: Spread, visited: tuple[float, float], data: tuple[Seen, ...] = ()
) -> Curve:
    """Return g on ``visited`` with its 95 % band (pointwise), and what the ``data`` show of it."""
    slip = np.geomspace(visited[0], visited[1], POINTS)

    def log_g(theta: FloatArray) -> FloatArray:
        return np.asarray(np.log(friction(theta, slip)))

    centre = friction(spread.theta, slip)
    gradient = friction_gradient(spread.theta, slip) / centre[:, None]
    low, high, _ = spread.interval(log_g, gradient)
    return Curve(
        seen=data,
        name="friction_curve",
        x_name="V_r",
        x_unit="m/s",
        y_name="g",
        y_unit="1",
        x=slip,
        y=centre,
        low=np.exp(low),
        high=np.exp(high),
        note=f"Visited slip: {span(*visited, 'm/s')}; beyond it the "
        "curve would be extrapolation and is not drawn. Band: 95 %, pointwise.",
    )
