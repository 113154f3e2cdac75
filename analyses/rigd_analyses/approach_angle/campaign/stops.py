"""Sums up the automatic stops of a campaign: overshoot at the command, and the final travel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rigd_analyses.approach_angle.raw.run_data import FloatArray, RunOn


@dataclass(frozen=True, eq=False)
class Stops:
    """What the runs of a campaign show of their stops; arrays of shape (n,), maybe empty."""

    overshoot_m: FloatArray  #: of the runs that the travel stopped
    overshoot_s: FloatArray
    final_travel_m: FloatArray
    final_turning_rad: FloatArray
    beyond: tuple[float, ...]  #: final turnings in rad beyond their limit
    limit_rad: float  #: the limit of these; NaN without any
    unrested: int  #: runs in which something still moved at the end of what was recorded


def stops_of(runs: Sequence[RunOn]) -> Stops:
    """Return what ``runs`` show."""

    def finite(values: Sequence[float]) -> FloatArray:
        array = np.array(values, dtype=np.float64)
        return np.asarray(array[np.isfinite(array)])

    beyond = [run for run in runs if run.final_turning_rad > run.turning_limit_rad]
    seen = [run for run in runs if np.isfinite(run.final_travel_m + run.final_turning_rad)]
    return Stops(
        overshoot_m=finite([run.overshoot_m for run in runs]),
        overshoot_s=finite([run.overshoot_s for run in runs]),
        final_travel_m=finite([run.final_travel_m for run in runs]),
        final_turning_rad=finite([run.final_turning_rad for run in runs]),
        beyond=tuple(run.final_turning_rad for run in beyond),
        limit_rad=beyond[0].turning_limit_rad if beyond else float("nan"),
        unrested=sum(not run.at_rest for run in seen),
    )
