"""Calibrations of the approach-angle rig keep what every analysis promises."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from support.approach_angle.recording import calibration_text

from rigd.analysis.check import Case, SimulatedTrial, check_analysis
from rigd_analyses.approach_angle.calibration.analysis import (
    FrictionCalibration,
    LoadCellCalibration,
    RiseCalibration,
    ScaleCalibration,
    TorqueCalibration,
)

MASSES_KG = (0.0, 1.0, 2.0, 3.0, 4.0, 3.0, 2.0, 1.0, 0.0)
T_S = np.arange(1000) / 1000.0
SCALE_NM_V = 2.04
ARM_M, GRAVITY = 0.2039, 9.81
LOAD_SCALE = 1.004


def test_torque_calibration_conforms(tmp_path: Path) -> None:
    random = np.random.default_rng(1)
    trials = []
    for mass in MASSES_KG:
        volts = mass * GRAVITY * ARM_M / SCALE_NM_V
        noise = 2e-3 * random.standard_normal((2, len(T_S)))
        signals = {
            "gauge_a": 0.25 + 0.5 * volts + noise[0],
            "gauge_b": 0.20 - 0.5 * volts + noise[1],
        }
        trials.append(SimulatedTrial(T_S, signals, {"mass": mass}, {"hang": 0.0, "measure": 0.2}))
    constants = {
        "arm": ARM_M, "arm_uncertainty": 5e-4, "mass_uncertainty": 3e-4, "gravity": GRAVITY,
        "gravity_uncertainty": 5e-3, "alignment_uncertainty": 0.0175, "poisson": 0.33,
    }  # fmt: skip
    case = Case(trials, constants, {"torque_scale": SCALE_NM_V})
    check_analysis(TorqueCalibration, [case], tmp_path)


def test_scale_calibration_conforms(tmp_path: Path) -> None:
    division = 0.01
    trials = [
        SimulatedTrial(
            T_S,
            {"load": np.full(len(T_S), np.round(mass / LOAD_SCALE / division) * division)},
            {"weight": mass},
            {"measure": 0.0},
        )
        for mass in MASSES_KG
    ]
    constants = {"weight_uncertainty": 3e-4, "division": division}
    case = Case(trials, constants, {"load_scale": LOAD_SCALE})
    check_analysis(ScaleCalibration, [case], tmp_path)


def test_load_cell_calibration_conforms(tmp_path: Path) -> None:
    division, newton_per_volt, zero_v = 0.01, 20.0, 0.09
    random = np.random.default_rng(3)
    trials = []
    for load in (2.0, 4.0, 6.0, 8.0, 8.0, 6.0, 4.0, 2.0):
        volts = load * GRAVITY / newton_per_volt + zero_v + 0.03 * random.standard_normal(len(T_S))
        shown = np.full(len(T_S), np.round(load / LOAD_SCALE / division) * division)
        signals = {"normal_force": volts, "load": shown}
        trials.append(SimulatedTrial(T_S, signals, {"load": load}, {"measure": 0.0}))
    case = Case(
        trials, {"division": division, "gravity": GRAVITY},
        {"normal_force_scale": newton_per_volt, "normal_force_zero": zero_v},
        calibration=calibration_text({"load_scale": (f"{LOAD_SCALE}", "0.0006")}),
    )  # fmt: skip
    check_analysis(LoadCellCalibration, [case], tmp_path)


def test_rise_calibration_conforms(tmp_path: Path) -> None:
    """Pushes of 0.3 m and back under three loads; the load rises by 8 % in a metre."""
    rise, travel_m, metres_per_volt = 0.08, 0.3, 0.25
    at_end = (T_S >= 0.4) & (T_S < 0.7)
    random = np.random.default_rng(2)
    trials = [
        SimulatedTrial(
            T_S,
            {
                "load": np.asarray(
                    load * (1.0 + rise * travel_m * at_end) + 1e-3 * random.standard_normal(),
                    np.float64,
                ),
                "platform_position": np.asarray(
                    0.1 + travel_m / metres_per_volt * at_end, np.float64
                ),
            },
            {"load": load},
            {"start": 0.0, "end": 0.4, "back": 0.7},
        )
        for load in (4.0, 6.0, 8.0)
        for _ in range(3)
    ]
    calibration = calibration_text({"platform_scale": (f"{metres_per_volt} m/V", "4e-4 m/V")})
    case = Case(trials, {"division": 1e-3}, {"load_rise": rise}, calibration=calibration)
    check_analysis(RiseCalibration, [case], tmp_path)


#: Of the platform, of its rails and of the wheel's bearings, in SI.
MASS_KG, RAILS_N, RAIL_LOAD, BEARINGS_NM = 3.0, 0.6, 0.01, 0.012
RAD_PER_V, M_PER_V = 12.5, 0.1875


def coast(
    speed: float, viscous: float, random: np.random.Generator
) -> dict[str, NDArray[np.float64]]:
    """Return signals of 0.3 s at rest, then the exact answer of m dv/dt = -A - B v."""
    t = np.arange(3000) / 1000.0
    rate, limit = viscous / MASS_KG, (RAILS_N + RAIL_LOAD * MASS_KG * GRAVITY) / viscous
    since = np.clip(t - 0.3, 0.0, np.log1p(speed / limit) / rate)
    travel = (speed + limit) * -np.expm1(-rate * since) / rate - limit * since
    still = np.full(len(t), 1.0)
    volts = (0.05 + travel) / M_PER_V + 1e-3 * random.standard_normal(len(t))
    return {"gauge_a": still, "gauge_b": still, "wheel_angle": still, "platform_position": volts}


def spin(
    speed: float, viscous: float, random: np.random.Generator
) -> dict[str, NDArray[np.float64]]:
    """Return signals of the lifted wheel: at rest, then 1.4 s of turning at one speed."""
    t = np.arange(1700) / 1000.0
    turning = t >= 0.3
    volts = (BEARINGS_NM + viscous * speed) * turning / SCALE_NM_V
    drift = 0.02 * random.standard_normal(2)
    noise = 1e-3 * random.standard_normal((3, len(t)))
    return {
        "gauge_a": drift[0] + 0.5 * volts + noise[0],
        "gauge_b": drift[1] - 0.5 * volts + noise[1],
        "wheel_angle": speed * np.where(turning, t - 0.3, 0.0) / RAD_PER_V + noise[2],
        "platform_position": np.full(len(t), 1.0),
    }


def friction_case(rail_viscous: float, bearing_viscous: float) -> tuple[list[SimulatedTrial], str]:
    """Return pushes and spins, and what was calibrated before."""
    random = np.random.default_rng(4)
    pushes = [coast(v, rail_viscous, random) for v in (0.25, 0.3, 0.35, 0.4) * 2]
    spins = [spin(w, bearing_viscous, random) for w in (6.0, 10.0, 17.0, 24.0) * 2]
    trials = [
        SimulatedTrial(np.arange(3000) / 1000.0, item, {"test": "coast"}, {"coast": 0.0})
        for item in pushes
    ] + [
        SimulatedTrial(np.arange(1700) / 1000.0, item, {"test": "spin"}, {"zero": 0.0, "spin": 0.3})
        for item in spins
    ]
    return trials, calibration_text(
        {
            "torque_scale": (f"{SCALE_NM_V} N m/V", "0.005 N m/V"),
            "wheel_scale": (f"{RAD_PER_V} rad/V", "0.025 rad/V"),
            "platform_scale": (f"{M_PER_V} m/V", "4e-4 m/V"),
            "rail_load": (f"{RAIL_LOAD}", "0.002"),
        }
    )


def test_friction_calibration_conforms(tmp_path: Path) -> None:
    """In the second case nothing brakes with the speed that these pushes and spins could show."""
    constants = {
        "platform_mass": MASS_KG, "platform_mass_uncertainty": 3e-3, "gravity": GRAVITY,
        "wheel_inertia": 4e-4,
    }  # fmt: skip
    fixed = {"rail_constant": RAILS_N, "bearing_constant": BEARINGS_NM}
    viscous = {"rail_viscous": 0.3, "bearing_viscous": 2e-4}
    trials, calibration = friction_case(*viscous.values())
    cases = [Case(trials, constants, fixed | viscous, calibration=calibration)]
    trials, calibration = friction_case(1e-3, 1e-7)
    cases.append(Case(trials, constants, fixed, tuple(viscous), calibration))
    check_analysis(FrictionCalibration, cases, tmp_path)
