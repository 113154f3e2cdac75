"""Recordings of `torque-calibration`: weights on the arm of the clamped shaft."""

from __future__ import annotations

import numpy as np

from rigd.evaluate.calibration.reading import Steps
from rigd.identify.calibration.result import CalibrationResult
from rigd.identify.calibration.torque import ArmBench, calibrate_torque

#: The step over which the gauges are averaged, and what the prompt for the weight changes.
STEP = "measure"
MASS = "arm_mass"


def torque_result(steps: Steps) -> CalibrationResult:
    """Return the torque scale that the recording gives.

    Raises:
        DataError: a step, signal or constant is missing.
    """
    trials = sorted(steps.sweep.trials, key=lambda trial: trial.start_ns)
    spans = [steps.span(trial, STEP) for trial in trials]
    return calibrate_torque(
        np.array([steps.announced(trial, MASS, "mass") for trial in trials]),
        np.array([steps.mean("gauge_a", span) for span in spans]),
        np.array([steps.mean("gauge_b", span) for span in spans]),
        ArmBench(
            arm_m=steps.constant("arm"),
            u_arm_m=steps.constant("arm_uncertainty"),
            u_mass=steps.constant("mass_uncertainty"),
            gravity=steps.constant("gravity"),
            u_gravity=steps.constant("gravity_uncertainty"),
            u_alignment_rad=steps.constant("alignment_uncertainty"),
            poisson=steps.constant("poisson"),
        ),
    )
