"""Flags faults in the load of a run; the table of ``flags.py`` lists the codes."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from rigd_analyses.approach_angle.raw.good_run_limits import Limits
from rigd_analyses.approach_angle.raw.run_data import (
    AngleCalibration,
    AngleRig,
    AngleRun,
    Flag,
    FloatArray,
    Known,
)
from rigd_analyses.approach_angle.raw.samples import readable

#: The load cell is judged by means over so long, one period of the mains, s.
MEAN_S = 0.020


def load_flags(
    run: AngleRun, calibration: AngleCalibration, rig: AngleRig, limits: Limits
) -> Iterator[Flag]:
    """Find what is wrong with the load of ``run``, by the scale and by the load cell if any."""
    if not run.load_stable:
        yield Flag("scale_unsteady", "The scale had not come to rest before the start.")
    elif not 0.0 < run.load_n < math.inf:
        yield Flag("load_missing", "The scale gave no load before the start.")
        return
    # As shown, not as calibrated: what the prompt accepted is not left out.
    shown, announced = run.load_n, run.announced_load_kg * rig.gravity
    if math.isfinite(shown) and not abs(shown - announced) <= limits.load * announced:
        yield Flag(
            "load_disagrees",
            f"The scale showed {shown:.1f} N, announced were {run.announced_load_kg:g} kg "
            f"({announced:.1f} N): other weights, a wrong tare, or kg taken for N.",
        )
    cell = calibration.normal_force
    if run.normal_force_v is not None and cell is not None:
        load = calibration.load.value * run.load_n
        yield from _load_cell(run, run.normal_force_v, load, calibration, cell, limits)


def _load_cell(
    run: AngleRun,
    volts: FloatArray,
    scale_n: float,
    calibration: AngleCalibration,
    cell: Known,
    limits: Limits,
) -> Iterator[Flag]:
    """Report a load cell that is dead, or does not show what the scale shows."""
    used = run.t_s <= run.stop_s
    t_s, zero = run.t_s[used], calibration.normal_force_zero
    bad = int(np.count_nonzero(~readable(volts[used])))
    if bad or not t_s.size:
        yield Flag(
            "load_cell_disagrees",
            f"{bad} of {t_s.size} samples of the load cell up to the stop are no numbers.",
        )
        return
    force = cell.value * (volts[used] - zero.value)
    before = float(np.mean(force[: max(1, int(np.searchsorted(t_s, 0.0)))]))
    size = max(1, int(np.searchsorted(t_s, t_s[0] + MEAN_S)))
    blocks = force.size // size
    lowest = float(np.min(force[: blocks * size].reshape(blocks, size).mean(axis=1)))
    unsure = limits.load * scale_n + 2.0 * abs(cell.value * zero.u)
    if abs(before - scale_n) > unsure or lowest <= 0.0:
        yield Flag(
            "load_cell_disagrees",
            f"Before the start the load cell shows {before:.1f} N and the scale {scale_n:.1f} N; "
            f"in the run it shows {lowest:.1f} N at the least: its zero, its calibration, or its "
            "cable is wrong.",
        )
