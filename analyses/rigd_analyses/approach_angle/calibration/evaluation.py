"""The recording of a calibration of the approach-angle rig to its values."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Final

from rigd.analysis.calibration.evaluation import CalibrationEvaluation, evaluated
from rigd.analysis.calibration.reading import Steps, steps_of
from rigd.analysis.calibration.result import CalibrationResult
from rigd.analysis.evaluation import Options
from rigd.analysis.source import RecordedSweep
from rigd_analyses.approach_angle.calibration.reading import (
    friction_result,
    rise_result,
    scale_result,
    torque_result,
)

_METHODS: Final[Mapping[str, Callable[[Steps], CalibrationResult]]] = {
    "torque-calibration": torque_result,
    "scale-calibration": scale_result,
    "friction-calibration": friction_result,
    "rise-calibration": rise_result,
}


def evaluate(
    sweeps: Sequence[RecordedSweep], options: Options, tell: Callable[[str], None]
) -> CalibrationEvaluation:
    """Return what the recording of a calibration gives; refused results say why.

    Raises:
        RecordingError: the recording is damaged.
        ConfigError: a calibration is wrong.
        DataError: there are several recordings, or a step, signal, constant or an earlier
            calibrated value is missing.
    """
    steps = steps_of(sweeps, options.calibration)
    tell(f"{steps.sweep.plan.model} of {steps.sweep.path.name}")
    return evaluated(steps, _METHODS[steps.sweep.plan.model](steps))
