"""Finds rows that are missing, repeated or late in a trial although its times are regular.

Both encoders then jump at one moment, by the way of one number of rows: no carriage and no wheel
does that. A sensor that fails jumps alone.
"""

from __future__ import annotations

import math

import numpy as np

from rigd.analysis.result import FloatArray
from rigd_analyses.lugre.counts import Rounding
from rigd_analyses.lugre.trial import LugreTrial

AROUND = 10  #: rows on either side of a step that show how far it should be
CLEAR = 8.0  #: standard deviations beyond which a step is a jump
AGREE = 4.0  #: and within which both encoders jump by one number of rows
SLIPS = 0.1  #: share by which the numbers may differ, as slip changes over the rows
LEAST_ROWS = 0.7
BY_DEVIATION = 1.4826  #: standard deviation over the median absolute deviation, of a normal one


def jump(trial: LugreTrial, part: slice) -> str:
    """Return what is wrong with the rows of ``part``, for a person; empty if nothing is."""
    if part.stop - part.start <= 2 * AROUND + 1:
        return ""
    wheel, wheel_sd = _rows(trial.wheel_angle_rad[part], trial.angle_rounding)
    guide, guide_sd = _rows(trial.carriage_position_m[part], trial.position_rounding)
    clear = (np.abs(wheel) > np.maximum(CLEAR * wheel_sd, LEAST_ROWS)) & (
        np.abs(guide) > np.maximum(CLEAR * guide_sd, LEAST_ROWS)
    )
    same = np.abs(wheel - guide) < np.maximum(
        AGREE * np.hypot(wheel_sd, guide_sd), SLIPS * np.abs(guide)
    )
    found = np.flatnonzero(clear & same)
    if not found.size:
        return ""
    worst = found[np.argmax(np.abs(guide[found]))]
    row = part.start + AROUND + int(worst) + 1
    begin = 1e3 * (trial.t_s[row] - trial.t_s[0])
    return (
        f"both encoders jump by the way of {guide[worst]:+.1f} rows {begin:.0f} ms from its begin: "
        "rows are missing, repeated or late there, though their times are regular"
    )


def _rows(values: FloatArray, rounding: Rounding) -> tuple[FloatArray, FloatArray]:
    """Return by the way of how many rows each step of ``values`` (n,) is too long, with its sd.

    Both (n - 1 - 2 AROUND,). What a step should be is the mean of those around it.
    """
    steps = np.diff(values)
    sums = np.concatenate([[0.0], np.cumsum(steps)])
    middle = slice(AROUND, len(steps) - AROUND)
    all_around = sums[2 * AROUND + 1 :] - sums[: -2 * AROUND - 1]
    usual = (all_around - steps[middle]) / (2 * AROUND)
    excess = steps[middle] - usual
    by_counts = math.sqrt((2.0 + 1.0 / AROUND) / 12.0) * rounding.of_reading
    spread = BY_DEVIATION * float(np.median(np.abs(excess - np.median(excess))))
    moved = np.where(usual == 0.0, np.inf, usual)  # at rest no way is that of a row
    return excess / moved, max(by_counts, spread) / np.abs(moved)
