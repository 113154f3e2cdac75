"""Recordings of `rise-calibration`: the loaded platform is pushed to its end and back."""

from __future__ import annotations

import numpy as np

from rigd.evaluate.calibration.reading import Steps
from rigd.identify.calibration.result import CalibrationResult
from rigd.identify.calibration.rise import Push, calibrate_rise
from rigd.record import TrialInfo

#: The steps over which scale and potentiometer are averaged, at rest, and what the prompt for the
#: load changes.
STEPS = ("start", "end", "back")
LOAD = "load"


def rise_result(steps: Steps) -> CalibrationResult:
    """Return the rise of the load that the recording gives.

    Raises:
        DataError: a step, signal, constant or an earlier calibrated value is missing.
    """
    trials = sorted(steps.sweep.trials, key=lambda trial: trial.start_ns)
    travel = steps.known("platform_scale")
    return calibrate_rise(
        [_push(steps, trial, travel.value) for trial in trials],
        u_travel=travel.u / travel.value,
        division_kg=steps.constant("division"),
    )


def _push(steps: Steps, trial: TrialInfo, metres_per_volt: float) -> Push:
    spans = [steps.span(trial, name) for name in STEPS]
    return Push(
        steps.announced(trial, LOAD, "load"),
        np.array([float(np.mean(steps.signal("load", span)[1])) for span in spans]),
        metres_per_volt * np.array([steps.mean("platform_position", span) for span in spans]),
    )
