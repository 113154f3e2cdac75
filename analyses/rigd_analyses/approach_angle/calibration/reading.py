"""Reads calibration recordings by the names of their steps and passes the arrays to estimators.

A step is one named piece of the recorded procedure, such as ``measure``. An estimator is the
function that computes the calibrated values. There are five calibrations of the approach-angle rig:

- torque: the operator puts weights on the arm of the clamped shaft;
- scale: the operator puts known weights on the scale;
- load cell: the operator loads the wheel, and the scale shows by how much;
- friction: the lifted wheel spins (friction of the bearings), the platform coasts after a push
  (friction of the rails);
- rise (the change of the wheel's load along the travel): the operator pushes the loaded platform to
  the end of its travel and back.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigd.analysis import DataError
from rigd.analysis.calibration.reading import Steps
from rigd.analysis.calibration.result import CalibrationResult, together
from rigd.analysis.recordings.source import TrialInfo
from rigd_analyses.approach_angle.calibration import rails, rise
from rigd_analyses.approach_angle.calibration.bearings import (
    BearingBench,
    Spin,
    calibrate_bearings,
    steady_turning,
)
from rigd_analyses.approach_angle.calibration.cell import CellBench, calibrate_cell
from rigd_analyses.approach_angle.calibration.scale import calibrate_scale
from rigd_analyses.approach_angle.calibration.torque import ArmBench, calibrate_torque

#: The step over which gauges, or the scale at rest, are averaged.
MEASURE = "measure"
#: What the prompt for the weight changes: on the arm, on the scale, on the platform.
ARM_MASS, SCALE_WEIGHT, LOAD = "arm_mass", "scale_weight", "load"
#: The steps over which scale and potentiometer are averaged, at rest.
RISE_STEPS = ("start", "end", "back")
#: What a trial tests, by its parameter `test`, and the steps that are evaluated.
COAST, SPIN = "coast", "spin"
ZERO_STEP = "zero"
#: The motor needs so long to a steady speed: five times its time constant of 60 ms.
SPIN_UP_NS = 400_000_000
#: Travel is averaged over so many samples' time: what is finer is noise.
TRAVEL_S = 0.01
#: The fewest such pieces that a push, or a spin, is evaluated by.
_PIECES = 4


def torque_result(steps: Steps) -> CalibrationResult:
    """Return the torque scale that the recording gives.

    Raises:
        DataError: a step, signal or constant is missing.
    """
    trials = sorted(steps.sweep.trials, key=lambda trial: trial.start_ns)
    spans = [steps.span(trial, MEASURE) for trial in trials]
    return calibrate_torque(
        np.array([steps.announced(trial, ARM_MASS, "mass") for trial in trials]),
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


def scale_result(steps: Steps) -> CalibrationResult:
    """Return the load scale that the recording gives.

    Raises:
        DataError: a step, signal or constant is missing.
    """
    trials = sorted(steps.sweep.trials, key=lambda trial: trial.start_ns)
    return calibrate_scale(
        np.array([steps.announced(trial, SCALE_WEIGHT, "weight") for trial in trials]),
        np.array(
            [float(np.mean(steps.signal("load", steps.span(item, MEASURE))[1])) for item in trials]
        ),
        u_weight=steps.constant("weight_uncertainty"),
        division_kg=steps.constant("division"),
    )


def cell_result(steps: Steps) -> CalibrationResult:
    """Return the scale and the zero of the load cell that the recording gives.

    Raises:
        DataError: a step, signal, constant or the calibrated scale is missing.
    """
    trials = sorted(steps.sweep.trials, key=lambda trial: trial.start_ns)
    spans = [steps.span(trial, MEASURE) for trial in trials]
    scale = steps.known("load_scale")
    return calibrate_cell(
        np.array([steps.announced(trial, LOAD, "load") for trial in trials]),
        np.array([float(np.mean(steps.signal("load", span)[1])) for span in spans]),
        np.array([steps.mean("normal_force", span) for span in spans]),
        CellBench(
            load_scale=scale.value,
            u_load_scale=scale.u,
            division_kg=steps.constant("division"),
            gravity=steps.constant("gravity"),
        ),
    )


def friction_result(steps: Steps) -> CalibrationResult:
    """Return the pushes and spins of a recording of rails and bearings.

    Raises:
        DataError: a step, signal, constant or an earlier calibrated value is missing.
    """
    trials: dict[str, list[TrialInfo]] = {COAST: [], SPIN: []}
    for trial in steps.sweep.trials:
        test = str(trial.parameters.get("test"))
        if test not in trials:
            raise DataError(
                f"{steps.sweep.path}: trial {trial.number} tests {test!r}",
                hint=f"its parameter `test` must be {COAST} or {SPIN}",
            )
        trials[test].append(trial)
    found = []
    if trials[COAST]:
        bench = _rail_bench(steps)
        found.append(rails.calibrate_rails([_coast(steps, item) for item in trials[COAST]], bench))
    if trials[SPIN]:
        spins = [_spin(steps, item) for item in trials[SPIN]]
        found.append(calibrate_bearings(spins, _bearing_bench(steps)))
    return together("Friction of rails and bearings", found)


def _rail_bench(steps: Steps) -> rails.RailBench:
    travel, load = steps.known("platform_scale"), steps.known("rail_load")
    return rails.RailBench(
        mass_kg=steps.constant("platform_mass"),
        u_mass=steps.constant("platform_mass_uncertainty"),
        gravity=steps.constant("gravity"),
        u_platform_scale=travel.u / travel.value,
        rail_load=load.value,
        u_rail_load=load.u,
    )


def _bearing_bench(steps: Steps) -> BearingBench:
    torque = steps.known("torque_scale")
    return BearingBench(torque.value, torque.u / torque.value, steps.constant("wheel_inertia"))


def _coast(steps: Steps, trial: TrialInfo) -> rails.Push:
    t_s, volts = steps.signal("platform_position", steps.span(trial, COAST))
    _check_long(t_s, trial, COAST)
    count = max(1, round(TRAVEL_S * (len(t_s) - 1) / float(t_s[-1] - t_s[0])))
    whole = len(t_s) // count * count
    times = t_s[:whole].reshape(-1, count).mean(axis=1)
    travel = steps.known("platform_scale").value * volts[:whole].reshape(-1, count).mean(axis=1)
    # The card's clock is even; its times as rigd estimates them tremble by microseconds.
    return rails.Push(np.linspace(times[0], times[-1], len(times)), travel)


def _check_long(t_s: NDArray[np.float64], trial: TrialInfo, step: str) -> None:
    """Raise unless the step is long enough to be averaged piece by piece.

    Raises:
        DataError: it is shorter than four pieces.

    """
    if len(t_s) < _PIECES or t_s[-1] - t_s[0] < _PIECES * TRAVEL_S:
        raise DataError(
            f"the step {step} of trial {trial.number} has {len(t_s)} samples, which are too few",
            hint=f"record it for {_PIECES * TRAVEL_S:g} s at least",
        )


def _spin(steps: Steps, trial: TrialInfo) -> Spin:
    begin, end = steps.span(trial, SPIN)
    zero, steady = steps.span(trial, ZERO_STEP), (min(begin + SPIN_UP_NS, end), end)
    difference = steps.mean("gauge_a", steady) - steps.mean("gauge_b", steady)
    before = steps.mean("gauge_a", zero) - steps.mean("gauge_b", zero)
    t_s, volts = steps.signal("wheel_angle", steady)
    _check_long(t_s, trial, SPIN)
    speed, acceleration = steady_turning(t_s, steps.known("wheel_scale").value * volts)
    return Spin(difference - before, speed, acceleration, float(t_s[-1] - t_s[0]))


def rise_result(steps: Steps) -> CalibrationResult:
    """Return the rise of the load that the recording gives.

    Raises:
        DataError: a step, signal, constant or an earlier calibrated value is missing.
    """
    trials = sorted(steps.sweep.trials, key=lambda trial: trial.start_ns)
    travel = steps.known("platform_scale")
    return rise.calibrate_rise(
        [_rise_push(steps, trial, travel.value) for trial in trials],
        u_travel=travel.u / travel.value,
        division_kg=steps.constant("division"),
    )


def _rise_push(steps: Steps, trial: TrialInfo, metres_per_volt: float) -> rise.Push:
    spans = [steps.span(trial, name) for name in RISE_STEPS]
    return rise.Push(
        steps.announced(trial, LOAD, "load"),
        np.array([float(np.mean(steps.signal("load", span)[1])) for span in spans]),
        metres_per_volt * np.array([steps.mean("platform_position", span) for span in spans]),
    )
