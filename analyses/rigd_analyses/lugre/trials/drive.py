"""Finds the begin and the end of the driven part of a trial from the motor current."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigd.analysis import DataError
from rigd.analysis.result import FloatArray
from rigd_analyses.lugre.trials.trial import LugreTrial

MIN_REST_S = 0.1  #: shortest rest from which the accelerometer's zero is taken
#: The drive is on while the current exceeds this share of the command. At the voltage limit the
#: current falls to what friction needs (0.2 A of 1.5 A commanded), so the share must stay below.
ON_SHARE = 0.1
NOISE_FACTOR = 4.0  #: and this many standard deviations of the monitor at rest
EDGE_SHARE = 0.5  #: at the step the current passes half of the command


@dataclass(frozen=True)
class Drive:
    """Index of the last sample before the current step, and one past the last driven sample."""

    start: int
    end: int


def find_drive(trial: LugreTrial, period_s: float, window: int) -> Drive:
    """Return the samples in which ``trial`` is driven.

    Raises DataError when there is no current step, none after a rest, or one of the wrong sign.
    """
    if not np.isfinite(trial.current_a) or trial.current_a == 0.0:
        raise DataError(f"trial {trial.label}: commanded current is {trial.current_a} A")
    current = trial.motor_current_a * np.sign(trial.current_a)
    height = abs(trial.current_a)
    over = np.flatnonzero(_median_of_five(current) > EDGE_SHARE * height)
    if over.size == 0:
        raise _no_step(trial, current, height)
    start = max(int(over[0]) - 1, 0)
    rest = start - window
    if rest * period_s < MIN_REST_S:
        raise DataError(
            f"trial {trial.label}: {1e3 * max(rest, 0) * period_s:.0f} ms of rest before the "
            f"current step, need {1e3 * (MIN_REST_S + window * period_s):.0f} ms",
            hint="start recording earlier: the accelerometer's zero is taken from the rest",
        )
    noise = float(np.std(current[:rest]))
    threshold = max(ON_SHARE * height, NOISE_FACTOR * noise)
    off = np.flatnonzero(_running_mean(current[start + 1 :], 5) < threshold)
    end = len(current) if off.size == 0 else start + 1 + max(int(off[0]) - 2, 1)
    return Drive(start, end)


def _no_step(trial: LugreTrial, current: FloatArray, height: float) -> DataError:
    peak = float(np.max(_median_of_five(current)))
    trough = float(np.min(_median_of_five(current)))
    if trough < -EDGE_SHARE * height:
        return DataError(
            f"trial {trial.label}: the motor current reaches {trough:.3g} A against a command of "
            f"{height:.3g} A",
            hint="the current monitor's sign is reversed; correct its calibration",
        )
    return DataError(
        f"trial {trial.label}: the motor current stays below {peak:.3g} A, no step to "
        f"{height:.3g} A",
        hint="the amplifier was not enabled, or the monitor is not connected",
    )


def _median_of_five(values: FloatArray) -> FloatArray:
    padded = np.pad(values, 2, mode="edge")
    return np.asarray(np.median(np.lib.stride_tricks.sliding_window_view(padded, 5), axis=1))


def _running_mean(values: FloatArray, count: int) -> FloatArray:
    half = count // 2
    padded = np.pad(values, half, mode="edge")
    return np.asarray(np.convolve(padded, np.full(count, 1.0 / count), mode="valid"))
