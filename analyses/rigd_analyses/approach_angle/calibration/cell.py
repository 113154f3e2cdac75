"""Calibrates the fast load cell: normal force per volt, and its zero, against the scale.

The wheel stands on the platform, the bolts set one load after the other, up and down. At rest the
scale shows the same force as the load cell, with the span that its own calibration gives. Gravity
turns the scale's kilograms into newtons here as in the evaluation of runs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rigd.analysis.calibration.line import returns, straight_line
from rigd.analysis.calibration.result import CalibrationResult, Contribution, Measured, Series
from rigd.analysis.result import FloatArray

#: Different loads, and how far they must reach: the largest over the smallest.
LEAST_LOADS = 4
LEAST_RATIO = 2.0
#: What the scale may show beside the announced load, as a share of it: the rule of the prompt.
MOST_LOAD_ERROR = 0.1
#: Share of the span that a point may lie off the line. A cell is linear to 0.1 %.
WORST_RESIDUAL = 0.01
#: Volts over the whole span of loads below which the cell does not answer.
LEAST_ANSWER_V = 0.01


@dataclass(frozen=True)
class CellBench:
    """The scale that shows the loads; ``u_load_scale`` is the standard uncertainty of its ratio."""

    load_scale: float  #: true over shown load
    u_load_scale: float
    division_kg: float
    gravity: float  #: m/s^2


def calibrate_cell(
    announced_kg: FloatArray, shown_kg: FloatArray, volts: FloatArray, bench: CellBench
) -> CalibrationResult:
    """Return scale and zero of the load cell.

    The arguments have shape (n,): the loads as announced and as the scale shows them, in kg, and
    the mean voltages of the cell, in the order in which the loads were set.
    """
    title = "Fast load cell"
    refusals = _bad_loads(announced_kg, shown_kg)
    if refusals:
        return CalibrationResult(title, {}, refusals=refusals)
    force = bench.load_scale * bench.gravity * shown_kg
    line = straight_line(force, volts)
    span_n = float(np.ptp(force))
    series = Series(
        "Load cell against the scale", "normal force, N", "load cell, V", force, volts, line.fitted
    )
    refusals = _bad_line(line.slope, line.worst, span_n)
    if refusals:
        return CalibrationResult(title, {}, series=(series,), refusals=refusals)
    scale = 1.0 / line.slope
    # Readings are rounded to divisions (JCGM 100:2008, F.2.2.1). Noise below half a division does
    # not spread the rounding, so that of both ends of the span counts in full.
    rounding_n = bench.gravity * bench.division_kg / math.sqrt(12.0)
    share = bench.u_load_scale / bench.load_scale
    measured = {
        "normal_force_scale": Measured(
            scale,
            "N/V",
            (
                Contribution("span of the scale", scale * share),
                Contribution("rounding to divisions", scale * math.sqrt(2.0) * rounding_n / span_n),
                Contribution("scatter about the line", scale * line.u_slope / line.slope),
            ),
        ),
        "normal_force_zero": Measured(
            line.offset,
            "V",
            (
                Contribution("tare and rounding of the scale", line.slope * rounding_n),
                Contribution("scatter about the line", line.u_offset),
            ),
        ),
    }
    left = volts - line.slope * (force - np.mean(force))
    facts = (
        f"{len(force)} loads from {np.min(force):.1f} to {np.max(force):.1f} N; linearity: worst "
        f"{scale * line.worst:.2f} N off the line; {returns(announced_kg, left, scale, 'N')}",
        "the zero is that of the straight line: it carries the tare of the scale. In an "
        "evaluation it drops out: each run starts from what the scale shows",
    )
    return CalibrationResult(title, measured, facts, series=(series,))


def _bad_loads(announced_kg: FloatArray, shown_kg: FloatArray) -> tuple[str, ...]:
    """Return why the loads give no line."""
    loads = np.unique(announced_kg)
    if len(loads) < LEAST_LOADS or loads[0] <= 0.0 or loads[-1] < LEAST_RATIO * loads[0]:
        found = ", ".join(f"{item:g} kg" for item in loads)
        return (
            f"{LEAST_LOADS} different loads above 0 are needed, the largest at least "
            f"{LEAST_RATIO:g} times the smallest; there are {found or 'none'}",
        )
    return tuple(
        f"load {number}: the scale shows {shown:.2f} kg while {announced:g} kg were announced: is "
        "the wheel on the surface, was the scale tared without it?"
        for number, (announced, shown) in enumerate(zip(announced_kg, shown_kg, strict=True), 1)
        if not abs(shown - announced) <= MOST_LOAD_ERROR * announced
    )


def _bad_line(slope: float, worst: float, span_n: float) -> tuple[str, ...]:
    """Return why the line is no calibration."""
    if abs(slope) * span_n < LEAST_ANSWER_V:
        return ("the load cell does not answer to the load: is its amplifier on, is it mounted?",)
    found = []
    if slope < 0.0:
        found.append("the load cell shows less as the load grows: its two signal wires are swapped")
    if worst > WORST_RESIDUAL * abs(slope) * span_n:
        found.append(
            f"a point lies {worst / abs(slope):.1f} N off the straight line, more than "
            f"{WORST_RESIDUAL:.0%} of the span: something touched the platform, the scale had not "
            "come to rest, or the cell is at an end of its range"
        )
    return tuple(found)
