"""States what recordings show of sensors and drive, for a program that predicts tests."""

from __future__ import annotations

import math

import numpy as np

from rigd.analysis.result import FloatArray
from rigd_analyses.lugre.rig.system import DrivenTrial, RigSystem

SPEED_SAMPLES = 21  #: over which a speed is a mean
ON = 0.05  #: share of what the motor is told, above which it is driven
LESS = 0.1  #: share of it that is missing at the voltage limit
CERTAIN = 5.0  #: and standard deviations of the monitor
AROUND = 10  #: samples around a jump of the current that do not count
LEAST_SAMPLES = 200
LINE = 0.1  #: deviation from the line, over the range of the current

#: Rows of the account, which the JSON object has below ``preprocessing.settings``.
PERIOD = "sampling_period_s"
CURRENT_NOISE = "current_noise_a"
ANGLE_COUNT = "angle_count_rad"
POSITION_COUNT = "position_count_m"
ACCELERATION_NOISE = "acceleration_noise_m_s2"
TOP_SPEED = "largest_speed_m_s"
VOLTAGE_AT_REST = "current_limit_at_rest_a"
VOLTAGE_SLOPE = "current_limit_slope_a_s"


FITTED = "fitted "  #: and the name of a constant


def fitted_rows(system: RigSystem, theta: FloatArray) -> dict[str, float]:
    """Return each constant as the fit ``theta`` (p,) has corrected it, in SI."""
    return {
        FITTED + unknown.parameter.name: float(value)
        for unknown, value in zip(system.shared, theta, strict=False)
        if math.isfinite(unknown.u)
    }


def sensor_rows(system: RigSystem) -> dict[str, float]:
    """Return noise, counts, period, the largest speed, and what the drive's voltage leaves.

    At its voltage limit a motor gets less current than it is told: a straight line over the speed
    of the wheel. Without the last two rows no trial came there.
    """
    noise = system.noise
    speeds = [np.ptp(_speeds(trial, system.period_s)) for trial in system.trials]
    rows = {
        PERIOD: system.period_s,
        CURRENT_NOISE: noise.current_a,
        ANGLE_COUNT: noise.angle_rad,
        POSITION_COUNT: noise.position_m,
        ACCELERATION_NOISE: noise.acceleration_m_s2,
        TOP_SPEED: max(float(speed) for speed in speeds),
    }
    return rows | _voltage(system, noise.current_a)


def _speeds(driven: DrivenTrial, period_s: float) -> FloatArray:
    position = driven.trial.carriage_position_m[driven.part]
    steps = min(SPEED_SAMPLES, len(position) - 1)
    return np.append(np.abs(position[steps:] - position[:-steps]) / (steps * period_s), 0.0)


def _voltage(system: RigSystem, noise_a: float) -> dict[str, float]:
    """Return the line of the current that the voltage leaves, if the trials show one."""
    currents, speeds = [], []
    for driven in system.trials:
        told, current = abs(driven.trial.current_a), np.abs(driven.current_a)
        less = (current > ON * told) & (current < told - max(LESS * told, CERTAIN * noise_a))
        less &= np.convolve(driven.jumps, np.ones(2 * AROUND + 1), mode="same") == 0.0
        currents.append(current[less])
        speeds.append(np.abs(driven.turning_rad_s[less]))
    current, speed = np.concatenate(currents), np.concatenate(speeds)
    if len(current) < LEAST_SAMPLES:
        return {}
    slope, at_rest = np.polyfit(speed, current, 1)
    misfit = float(np.std(current - at_rest - slope * speed))
    # Another current of the trial is lower too, but not on one line with the rest.
    if slope >= 0.0 or misfit > LINE * np.ptp(current):
        return {}
    return {VOLTAGE_AT_REST: float(at_rest), VOLTAGE_SLOPE: float(-slope)}
