"""Recordings of `scale-calibration`: known weights on the scale."""

from __future__ import annotations

import numpy as np

from rigd.evaluate.calibration.reading import Steps
from rigd.identify.calibration.result import CalibrationResult
from rigd.identify.calibration.scale import calibrate_scale

#: The step over which the scale, at rest, is averaged, and what the prompt for the weight changes.
STEP = "measure"
WEIGHT = "scale_weight"


def scale_result(steps: Steps) -> CalibrationResult:
    """Return the load scale that the recording gives.

    Raises:
        DataError: a step, signal or constant is missing.
    """
    trials = sorted(steps.sweep.trials, key=lambda trial: trial.start_ns)
    return calibrate_scale(
        np.array([steps.announced(trial, WEIGHT, "weight") for trial in trials]),
        np.array(
            [float(np.mean(steps.signal("load", steps.span(one, STEP))[1])) for one in trials]
        ),
        u_weight=steps.constant("weight_uncertainty"),
        division_kg=steps.constant("division"),
    )
