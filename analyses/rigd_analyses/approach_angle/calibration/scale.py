"""Calibrates a scale: the ratio of true to indicated load, from known weights.

The weights are put on and taken off, so that the result shows the hysteresis, too.
"""

from __future__ import annotations

import math

import numpy as np

from rigd.analysis.calibration.line import returns, straight_line
from rigd.analysis.calibration.result import CalibrationResult, Contribution, Measured, Series
from rigd.analysis.result import FloatArray

#: Different weights, none among them.
LEAST_WEIGHTS = 4
#: Share of the span that a reading may lie off the line.
WORST_RESIDUAL = 0.01
#: How far from 1 the span of a scale may be; beyond, the unit or the weights are wrong.
MOST_SPAN_ERROR = 0.05


def calibrate_scale(
    weight_kg: FloatArray, shown_kg: FloatArray, *, u_weight: float, division_kg: float
) -> CalibrationResult:
    """Return the load scale from (n,) weights in the order they lay, and (n,) mean readings.

    ``u_weight`` is the relative standard uncertainty of a weight, ``division_kg`` the scale's.
    """
    title = "Span of the scale"
    if len(np.unique(weight_kg)) < LEAST_WEIGHTS:
        found = ", ".join(f"{item:g} kg" for item in np.unique(weight_kg))
        reason = f"{LEAST_WEIGHTS} different weights are needed, none among them; there are {found}"
        return CalibrationResult(title, {}, refusals=(reason,))
    line = straight_line(weight_kg, shown_kg)
    span = float(np.ptp(weight_kg))
    series = Series(
        "What the scale shows of known weights", "weight, kg", "shown, kg",
        weight_kg, shown_kg, line.fitted,
    )  # fmt: skip
    refusals = _refusals(line.slope, line.worst, span)
    if refusals:
        return CalibrationResult(title, {}, series=(series,), refusals=refusals)
    scale = 1.0 / line.slope
    # A reading is a mean of some, rounded to divisions (JCGM 100:2008, F.2.2.1): noise below half
    # a division does not spread the rounding, so that of both ends of the span counts in full.
    rounding = math.sqrt(2.0) * division_kg / math.sqrt(12.0) / span
    budget = (
        Contribution("weights", scale * u_weight),
        Contribution("rounding to divisions", scale * rounding),
        Contribution("scatter about the line", scale * line.u_slope / line.slope),
    )
    facts = (
        f"{len(weight_kg)} readings up to {np.max(weight_kg):g} kg; empty it shows "
        f"{1e3 * line.offset:+.1f} g",
        f"linearity: worst {1e3 * line.worst:.1f} g off the line; "
        f"{returns(weight_kg, shown_kg, 1e3, 'g', 1)}",
    )
    return CalibrationResult(
        title, {"load_scale": Measured(scale, "1", budget)}, facts, series=(series,)
    )


def _refusals(slope: float, worst: float, span: float) -> tuple[str, ...]:
    """Return why the line is no calibration."""
    found = []
    if abs(slope - 1.0) > MOST_SPAN_ERROR:
        found.append(
            f"the scale shows {slope:.3f} kg for each kg laid on it: it is set to another unit, or "
            "the weights are not what was announced"
        )
    if worst > WORST_RESIDUAL * span:
        found.append(
            f"a reading lies {1e3 * worst:.0f} g off the straight line, more than "
            f"{WORST_RESIDUAL:.0%} of the span: a weight that touched something, or a scale that "
            "had not come to rest"
        )
    return tuple(found)
