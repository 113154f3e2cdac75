"""Recordings of `friction-calibration`: the lifted wheel spins, the platform coasts."""

from __future__ import annotations

import numpy as np

from rigd.evaluate.calibration.reading import Steps
from rigd.identify.calibration.bearings import (
    BearingBench,
    Spin,
    calibrate_bearings,
    steady_turning,
)
from rigd.identify.calibration.rails import Push, RailBench, calibrate_rails
from rigd.identify.calibration.result import CalibrationResult, together
from rigd.model.errors import DataError
from rigd.record import TrialInfo

#: What a trial tests, by its parameter `test`, and the steps that are evaluated.
COAST, SPIN = "coast", "spin"
ZERO_STEP = "zero"
#: The motor needs so long to a steady speed: five times its time constant of 60 ms.
SPIN_UP_NS = 400_000_000
#: Travel is averaged over so many samples' time: what is finer is noise.
TRAVEL_S = 0.01


def friction_result(steps: Steps) -> CalibrationResult:
    """Return what the recording tells of rails and bearings.

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
        found.append(calibrate_rails([_push(steps, one) for one in trials[COAST]], bench))
    if trials[SPIN]:
        spins = [_spin(steps, one) for one in trials[SPIN]]
        found.append(calibrate_bearings(spins, _bearing_bench(steps)))
    return together("Friction of rails and bearings", found)


def _rail_bench(steps: Steps) -> RailBench:
    travel, load = steps.known("platform_scale"), steps.known("rail_load")
    return RailBench(
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


def _push(steps: Steps, trial: TrialInfo) -> Push:
    t_s, volts = steps.signal("platform_position", steps.span(trial, COAST))
    count = max(1, round(TRAVEL_S * (len(t_s) - 1) / float(t_s[-1] - t_s[0])))
    whole = len(t_s) // count * count
    times = t_s[:whole].reshape(-1, count).mean(axis=1)
    travel = steps.known("platform_scale").value * volts[:whole].reshape(-1, count).mean(axis=1)
    # The card's clock is even; its times as rigd estimates them tremble by microseconds.
    return Push(np.linspace(times[0], times[-1], len(times)), travel)


def _spin(steps: Steps, trial: TrialInfo) -> Spin:
    begin, end = steps.span(trial, SPIN)
    zero, steady = steps.span(trial, ZERO_STEP), (min(begin + SPIN_UP_NS, end), end)
    difference = steps.mean("gauge_a", steady) - steps.mean("gauge_b", steady)
    before = steps.mean("gauge_a", zero) - steps.mean("gauge_b", zero)
    t_s, volts = steps.signal("wheel_angle", steady)
    speed, acceleration = steady_turning(t_s, steps.known("wheel_scale").value * volts)
    return Spin(difference - before, speed, acceleration, float(t_s[-1] - t_s[0]))
