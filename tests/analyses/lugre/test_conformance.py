"""The LuGre analysis keeps what every analysis promises, on trials of independent code."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from support.cases import FEW_EVALUATIONS

from rigd.analysis.check import Case, SimulatedTrial, check_analysis
from rigd_analyses.lugre.analysis import LugreAnalysis


def test_lugre_analysis_conforms(bench: Callable[..., Any], tmp_path: Path) -> None:
    rig = bench("stone")
    trials = [
        SimulatedTrial(
            trial.t_s,
            {
                "wheel_angle": trial.wheel_angle_rad,
                "carriage_position": trial.carriage_position_m,
                "acceleration": trial.acceleration_m_s2,
                "motor_current": trial.motor_current_a,
            },
            {"current": trial.current_a},
        )
        for trial in rig.sweep(1, (0.45, 0.75, 1.05, 1.35))
    ]
    constants = {
        "mass": rig.constants.mass_kg,
        "wheel_radius": rig.constants.wheel_radius_m,
        "guide_friction": rig.constants.guide_friction_n,
        "rolling_resistance": rig.constants.rolling_resistance,
        "gravity": rig.constants.gravity_m_s2,
    }
    truth = {"sigma_0": rig.truth.s0, "sigma_2": rig.truth.s2}
    case = Case(trials, constants, truth, ("V_s", "mu_s-mu_c"))
    check_analysis(LugreAnalysis, [case], tmp_path, only=FEW_EVALUATIONS)
