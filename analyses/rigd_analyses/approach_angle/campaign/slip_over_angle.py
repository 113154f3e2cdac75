"""Computes the slip of each set at each voltage: the slip over the approach angle.

The slip is the corrected one, w R_eff/(V cos(alpha)) - 1, which is 0 for a wheel that rolls at any
angle. It depends on the load and on the voltage of the motor. Points of one voltage are therefore
compared over the angle: each is the mean over the loads of that voltage, each load counting once.

The uncertainty joins the spread between equal runs (same set, load and voltage; Student's t for
so few) with that which all runs share: radius, both potentiometers, and the angle.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.stats import t as student

from rigd_analyses.approach_angle.result import SlipPoint
from rigd_analyses.approach_angle.run_result import RunResult


def slip_over_angle(runs: Sequence[RunResult]) -> tuple[SlipPoint, ...]:
    """Return a point for each set and voltage of the used ``runs``, in their order."""
    cells: dict[tuple[str, float], list[RunResult]] = {}
    for run in runs:
        if not run.excluded and math.isfinite(run.better.slip_corrected):
            cells.setdefault((run.run.set_name, run.run.voltage_v), []).append(run)
    return tuple(_point(of_cell) for of_cell in cells.values())


def _point(runs: Sequence[RunResult]) -> SlipPoint:
    by_load: dict[float, list[float]] = {}
    for run in runs:
        by_load.setdefault(run.run.cell[1], []).append(run.better.slip_corrected)
    means = [float(np.mean(slips)) for slips in by_load.values()]
    first = runs[0].run
    shared = float(np.median([run.better.slip_corrected_u for run in runs]))
    return SlipPoint(
        set_name=first.set_name,
        wheel=first.wheel,
        alpha_rad=first.alpha_rad,
        voltage_v=first.voltage_v,
        slip=float(np.mean(means)),
        expanded=math.hypot(_expanded_between_runs(tuple(by_load.values())), 2.0 * shared),
        lowest_load=min(means),
        highest_load=max(means),
        loads_kg=tuple(sorted(by_load)),
        runs=len(runs),
        regimes=tuple(dict.fromkeys(r.better.regime for r in runs if r.better.regime)),
    )


def _expanded_between_runs(groups: Sequence[Sequence[float]]) -> float:
    """Return the half width of the 95 % interval of the mean of means; NaN without a repeat."""
    count = sum(len(slips) for slips in groups)
    freedom = count - len(groups)
    if not freedom:
        return math.nan
    squares = math.fsum(float(np.var(slips)) * len(slips) for slips in groups)
    weights = math.fsum(1.0 / len(slips) for slips in groups) / len(groups) ** 2
    return float(student.ppf(0.975, freedom)) * math.sqrt(squares / freedom * weights)
