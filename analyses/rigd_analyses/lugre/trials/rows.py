"""Finds rows that are missing, repeated or late in a trial although its times are regular.

Both encoders then jump at one moment, by the way of one number of rows: no carriage and no wheel
does that. A sensor that fails jumps alone.
"""

from __future__ import annotations

import math

import numpy as np

from rigd.analysis.result import BoolArray, FloatArray
from rigd_analyses.lugre.trials.resolution import Rounding
from rigd_analyses.lugre.trials.trial import LugreTrial

AROUND = 10  #: rows on either side of a step that show how long it should be
CLEAR = 8.0  #: standard deviations beyond which a step is a jump
BY_FORCE = 2.0  #: and times what the largest acceleration makes of it, if it turns its sign
AGREE = 4.0  #: standard deviations within which both encoders jump by one number of rows
SLIPS = 0.1  #: share by which the numbers may differ, as slip changes over the rows
LEAST_ROWS = 0.7
BY_DEVIATION = 1.4826  #: standard deviation over the median absolute deviation, of a normal one
BY_COUNTS = math.sqrt(5.0 / 12.0)  #: of a step less the mean of its neighbours, for each count


def jump(trial: LugreTrial, part: slice) -> str:
    """Return what is wrong with the rows of ``part``, for a person; empty if nothing is."""
    if part.stop - part.start <= 2 * AROUND + 1:
        return ""
    period_s = float(np.median(np.diff(trial.t_s)))
    driven = BY_FORCE * float(np.max(np.abs(trial.acceleration_m_s2[part]))) * period_s**2
    wheel, wheel_sd, turned = _rows(trial.wheel_angle_rad[part], trial.angle_rounding, 0.0)
    guide, guide_sd, moved = _rows(trial.carriage_position_m[part], trial.position_rounding, driven)
    same = np.abs(wheel - guide) < np.maximum(
        AGREE * np.hypot(wheel_sd, guide_sd), SLIPS * np.abs(guide)
    )
    found = np.flatnonzero(turned & moved & same)
    if not found.size:
        return ""
    worst = found[np.argmax(np.abs(guide[found]))]
    row = part.start + AROUND + int(worst) + 1
    begin = 1e3 * (trial.t_s[row] - trial.t_s[0])
    return (
        f"both encoders jump by the way of {guide[worst]:+.1f} rows {begin:.0f} ms from its begin: "
        "rows are missing, repeated or late there, though their times are regular"
    )


def _rows(
    values: FloatArray, rounding: Rounding, least: float
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return by the way of how many rows each step of ``values`` (n,) is too long.

    With the standard deviation of that, and whether it is a jump: of more than ``least``. All are
    (n - 1 - 2 AROUND,). The way of a row is the mean over those around a step; its neighbours show
    what the step should be.
    """
    steps = np.diff(values)
    sums = np.concatenate([[0.0], np.cumsum(steps)])
    middle = slice(AROUND, len(steps) - AROUND)
    over_all = sums[2 * AROUND + 1 :] - sums[: -2 * AROUND - 1]
    way = (over_all - steps[middle]) / (2 * AROUND)
    excess = (steps[1:-1] - 0.5 * (steps[:-2] + steps[2:]))[AROUND - 1 : len(steps) - AROUND - 1]
    spread = BY_DEVIATION * float(np.median(np.abs(excess - np.median(excess))))
    sd = max(BY_COUNTS * rounding.of_reading, spread)
    way = np.where(way == 0.0, np.inf, way)  # at rest no way is that of a row
    rows = excess / way
    jumps = (np.abs(excess) > max(CLEAR * sd, least)) & (np.abs(rows) > LEAST_ROWS)
    return rows, sd / np.abs(way), jumps
