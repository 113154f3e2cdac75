"""Estimates the friction of the wheel's bearings from the torque that turns the lifted wheel.

With the wheel off the surface, the gauges measure two torques: the friction of the bearings
between gauges and wheel, T_b = bearing_constant + bearing_viscous w, and the torque that
accelerates the wheel, I dw/dt. The gauges drift by more than these torques. The module therefore
measures each torque against the zero just before the start. The share of the friction that the
load causes cannot be measured without load.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rigd.analysis.calibration.line import straight_line
from rigd.analysis.calibration.result import CalibrationResult, Contribution, Measured, Series
from rigd.analysis.recordings.noise import MAD_TO_SIGMA
from rigd.analysis.result import FloatArray

#: Spins, and how far the speeds must lie apart: as much as the slowest of them.
LEAST_SPINS = 6
LEAST_RATIO = 2.0
#: Share of the speed that may be gained or lost over the window; more is no steady turning.
MOST_CHANGE = 0.1
#: Torque that a spin may lie off the line, in standard deviations as the median of all gives them:
#: one spin far off widens those of a mean so much that it passes.
OUTLIER = 6.0
#: A value known to no better than half of itself is not known.
KNOWN_AT = 2.0


@dataclass(frozen=True)
class Spin:
    """One steady turning: mean gauge voltage against the zero before it, and how it turned."""

    difference_v: float  #: mean of V_a - V_b minus its zero before the start
    speed_rad_s: float
    acceleration_rad_s2: float
    window_s: float


@dataclass(frozen=True)
class BearingBench:
    """What is known before the calibration; ``u_torque_scale`` is relative (k = 1)."""

    torque_scale: float  #: N m/V
    u_torque_scale: float
    inertia: float  #: of the wheel with its shaft, kg m^2


def steady_turning(t_s: FloatArray, angle_rad: FloatArray) -> tuple[float, float]:
    """Return mean speed and acceleration of the wheel from its angle (n,) at (n,) times."""
    t = t_s - t_s.mean()
    square, slope, _ = np.polyfit(t, angle_rad, 2)
    return float(slope), float(2.0 * square)


def calibrate_bearings(spins: Sequence[Spin], bench: BearingBench) -> CalibrationResult:
    """Return the bearings' torque that ``spins`` determine."""
    title = "Friction of the wheel's bearings"
    speed = np.array([spin.speed_rad_s for spin in spins])
    torque = np.array(
        [
            bench.torque_scale * spin.difference_v - bench.inertia * spin.acceleration_rad_s2
            for spin in spins
        ]
    )
    refusals = _too_little(spins, speed)
    if refusals:
        return CalibrationResult(title, {}, refusals=refusals)
    line = straight_line(speed, torque)
    series = Series(
        "Torque of the lifted wheel", "speed, rad/s", "torque, N m", speed, torque, line.fitted
    )
    scatter = float(np.sqrt(line.residuals @ line.residuals / (len(spins) - 2)))
    typical = MAD_TO_SIGMA * float(np.median(np.abs(line.residuals)))
    if line.worst > OUTLIER * typical:
        refusals = (
            f"a spin lies {1e3 * line.worst:.1f} mN m off the straight line, more than {OUTLIER:g} "
            "times the scatter of the others: the wheel touched something",
        )
    elif line.offset < KNOWN_AT * line.u_offset:
        refusals = (
            f"the bearings seem to brake with {1e3 * line.offset:.1f} ± "
            f"{1e3 * line.u_offset:.1f} mN m at rest, which is nothing or drives the wheel: is it "
            "lifted, are the gauges swapped, did their zero drift?",
        )
    if refusals:
        return CalibrationResult(title, {}, series=(series,), refusals=refusals)
    measured = {"bearing_constant": _measured(line.offset, line.u_offset, "N m", bench)}
    kept = {"bearing_load": "the lifted wheel carries no load, so that what it adds is not seen"}
    if line.slope > KNOWN_AT * line.u_slope:
        measured["bearing_viscous"] = _measured(line.slope, line.u_slope, "N m s/rad", bench)
    else:
        kept["bearing_viscous"] = (
            f"{1e3 * line.slope:.2f} ± {1e3 * line.u_slope:.2f} mN m s/rad: these spins do not "
            "distinguish it from zero"
        )
    facts = (
        f"{len(spins)} spins from {speed.min():.1f} to {speed.max():.1f} rad/s; they scatter by "
        f"{1e3 * scatter:.2f} mN m about the line",
    )
    return CalibrationResult(title, measured, facts, kept, (series,))


def _measured(value: float, u: float, unit: str, bench: BearingBench) -> Measured:
    scatter = Contribution("scatter about the line", u)
    return Measured(
        value, unit, (scatter, Contribution("torque scale", value * bench.u_torque_scale))
    )


def _too_little(spins: Sequence[Spin], speed: FloatArray) -> tuple[str, ...]:
    """Return why the spins give no line."""
    if len(spins) < LEAST_SPINS:
        return (f"{LEAST_SPINS} spins of the lifted wheel are needed, there are {len(spins)}",)
    if speed.min() <= 0.0:
        return (
            f"the wheel turned at {speed.min():.1f} rad/s: it stood still, or its potentiometer is "
            "wired the wrong way round",
        )
    if speed.max() < LEAST_RATIO * speed.min():
        return (
            f"all spins lie between {speed.min():.1f} and {speed.max():.1f} rad/s: use voltages "
            "further apart",
        )
    unsteady = [
        spin for spin in spins
        if abs(spin.acceleration_rad_s2) * spin.window_s > MOST_CHANGE * spin.speed_rad_s
    ]  # fmt: skip
    if unsteady:
        return (
            f"in {len(unsteady)} of {len(spins)} spins the speed changed by more than "
            f"{MOST_CHANGE:.0%}: wait longer before measuring",
        )
    return ()
