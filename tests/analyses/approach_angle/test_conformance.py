"""The approach-angle analysis keeps what every analysis promises, on runs of the simulated rig."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from support.approach_angle.headless import SimulatedRun, simulate
from support.approach_angle.recording import calibration_of
from support.approach_angle.runs import TABLE_1
from support.cases import FEW_EVALUATIONS

from rigd.analysis import Evaluation
from rigd.analysis.check import Case, SimulatedTrial, check_analysis
from rigd_analyses.approach_angle.analysis import ApproachAngleAnalysis
from rigd_analyses.approach_angle.evaluation import CampaignEvaluation

CONSTANTS = {
    "angle": 0.0, "wheel_radius": 0.05, "wheel_inertia": 4e-4, "platform_mass": 3.0,
    "gravity": 9.81,
}  # fmt: skip


def as_trial(run: SimulatedRun) -> SimulatedTrial:
    closed = np.asarray((run.t_s >= 0.0) & (run.t_s < run.stop_s), np.float64)
    signals = {
        "gauge_a": run.gauge_a_v,
        "gauge_b": run.gauge_b_v,
        "wheel_angle": run.wheel_v,
        "platform_position": run.platform_v,
        "relay": closed,
        "load": np.full(len(run.t_s), run.scale_kg),
    }
    parameters: dict[str, float | str] = {
        "set": run.set_name, "load": run.announced_load_kg, "voltage": run.voltage_v,
    }  # fmt: skip
    return SimulatedTrial(run.t_s, signals, parameters, channels={"relay_setpoint": closed})


def maxima(evaluation: Evaluation) -> Mapping[str, tuple[float, float] | None]:
    assert isinstance(evaluation, CampaignEvaluation)
    found = {item.name: item.maximum for item in evaluation.result.sets}
    return {
        name: None if maximum is None else (maximum.low, maximum.high)
        for name, maximum in found.items()
    }


def test_approach_angle_analysis_conforms(tmp_path: Path) -> None:
    """The coated wheel slides at 4 kg; the clean one, at 8 kg and a low voltage, only rolls."""
    sliding = [
        simulate("coated_0", 4.0, voltage, seed=seed)
        for seed, voltage in enumerate((7.0, 8.5, 10.0) * 2, start=1)
    ]
    rolling = [simulate("clean_0", 8.0, 4.0, seed=seed) for seed in (11, 12)]
    case = Case(
        [as_trial(run) for run in (*sliding, *rolling)],
        CONSTANTS,
        {"coated_0": TABLE_1["coated_0"]},
        ("clean_0",),
        calibration_of(sliding[0], rig="case"),
    )
    check_analysis(ApproachAngleAnalysis, [case], tmp_path, read=maxima, only=FEW_EVALUATIONS)
