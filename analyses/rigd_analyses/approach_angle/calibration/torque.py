"""Calibrates the torque per volt of the strain gauges, from known masses on a known arm.

The shaft is clamped. Gauge a is at +45 degrees and gauge b at -45 degrees: V_a - V_b measures the
shear strain, hence the torque, and the bending that a weight on the arm causes cancels in it (Eqs.
4 and 5 of "Omni-wheel friction coefficient measuring methodology for various angles", with the sign
of Eq. 4 corrected). It cancels completely only if both gauges are at exactly 45 degrees. The mean
of V_a and V_b shows how large the bending was. From it the module computes how much bending remains
in V_a - V_b if the gauges are misaligned, and adds that to the uncertainty. Weights on one arm
cannot show more, because torque and bending increase together.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rigd.analysis.calibration.line import returns, straight_line
from rigd.analysis.calibration.result import CalibrationResult, Contribution, Measured, Series
from rigd.analysis.result import FloatArray

#: Different masses, zero among them: with fewer the line contradicts no value.
LEAST_MASSES = 3
#: Share of the span that a point may lie off the line. The gauges are linear to 0.1 %; a weight
#: that touches the frame or hangs on another hole of the arm shows as more.
WORST_RESIDUAL = 0.01
#: What the mean of the gauges may move by, as a share of their difference. The arm bends the shaft
#: by 2 % at most; a gauge that is dead leaves half.
MOST_BENDING = 0.25


@dataclass(frozen=True)
class ArmBench:
    """The arm and the weights, with standard uncertainties (k = 1)."""

    arm_m: float
    u_arm_m: float
    u_mass: float  #: of a mass, relative
    gravity: float  #: m/s^2
    u_gravity: float  #: m/s^2
    u_alignment_rad: float  #: of each gauge from 45 degrees
    poisson: float  #: of the shaft


def calibrate_torque(
    mass_kg: FloatArray, gauge_a_v: FloatArray, gauge_b_v: FloatArray, bench: ArmBench
) -> CalibrationResult:
    """Return the torque scale from (n,) masses in the order they hung, and (n,) mean voltages."""
    title = "Torque of the shaft"
    if len(np.unique(mass_kg)) < LEAST_MASSES:
        found = ", ".join(f"{item:g} kg" for item in np.unique(mass_kg))
        reason = f"{LEAST_MASSES} different masses are needed, zero among them; there are {found}"
        return CalibrationResult(title, {}, refusals=(reason,))
    torque = mass_kg * bench.gravity * bench.arm_m
    difference, mean = gauge_a_v - gauge_b_v, 0.5 * (gauge_a_v + gauge_b_v)
    line, bending = straight_line(torque, difference), straight_line(torque, mean)
    span = abs(line.slope) * float(np.ptp(torque))
    series = Series(
        "V_a - V_b against the torque of the arm", "torque, N m", "V_a - V_b, V",
        torque, difference, line.fitted,
    )  # fmt: skip
    refusals = _refusals(line.slope, line.worst, bending.slope, span)
    if refusals:
        return CalibrationResult(title, {}, series=(series,), refusals=refusals)
    scale = 1.0 / line.slope
    # A gauge off 45 degrees by d lets (1 + nu) d of the bending strain into V_a - V_b, for which
    # the mean shows (1 - nu)/2 of it.
    through = math.sqrt(2.0) * 2.0 * (1.0 + bench.poisson) / (1.0 - bench.poisson)
    u_bending = through * bench.u_alignment_rad * abs(bending.slope / line.slope)
    budget = (
        Contribution("length of the arm", scale * bench.u_arm_m / bench.arm_m),
        Contribution("masses", scale * bench.u_mass),
        Contribution("gravity", scale * bench.u_gravity / bench.gravity),
        Contribution("bending let through by misaligned gauges", scale * u_bending),
        Contribution("scatter about the line", scale * line.u_slope / line.slope),
    )
    facts = (
        f"{len(torque)} points up to {np.max(torque):.3f} N m; worst {1e3 * line.worst:.2f} mV off "
        f"the line, {line.worst / span:.3%} of the span; {returns(torque, difference, 1e3, 'mV')}",
        f"without a weight V_a - V_b is {1e3 * line.offset:.1f} mV",
        f"bending: the mean of the gauges moves by {abs(bending.slope) / line.slope:.2%} of their "
        "difference; it cancels in the difference as far as both stand at 45 degrees",
    )
    return CalibrationResult(
        title, {"torque_scale": Measured(scale, "N m/V", budget)}, facts, series=(series,)
    )


def _refusals(slope: float, worst: float, bending: float, span: float) -> tuple[str, ...]:
    """Return why the line is no calibration."""
    if span == 0.0:
        return ("the gauges do not answer to the weights at all: is the amplifier on?",)
    found = []
    if slope < 0.0:
        found.append(
            "V_a - V_b falls as the torque rises: the gauges are swapped, or the arm points to the "
            "other side"
        )
    if worst > WORST_RESIDUAL * span:
        found.append(
            f"a point lies {worst / span:.1%} of the span off the straight line, more than "
            f"{WORST_RESIDUAL:.0%}: a weight that touched something, or was another one"
        )
    if abs(bending) > MOST_BENDING * abs(slope):
        found.append(
            f"the mean of the gauges moves by {abs(bending / slope):.0%} of their difference: one "
            "of them is dead, or the shaft is not clamped at the wheel"
        )
    return tuple(found)
