"""Angle over time to torque of friction over speed: T_f = -(I d2q/dt2 + G sin(q))."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from rigd.analysis import DataError, Options
from rigd.analysis.fitting.model import FitParameter
from rigd.analysis.fitting.response import (
    Axis,
    ResponseModel,
    ResponseQuantity,
    ResponseTrial,
    Wording,
    identify_response,
)
from rigd.analysis.parameters import Fitted, ParameterEvaluation, complete_groups
from rigd.analysis.recordings.source import RecordedSweep, TrialInfo
from rigd.analysis.result import FloatArray, Preprocessing

#: A cubic is fitted to the angle over so long: its derivatives are speed and acceleration.
BLOCK_S = 0.1
#: Below this speed in rad/s the sign of the friction is not certain over a block.
TURNING_RAD_S = 0.8
PARAMETERS = (
    FitParameter("coulomb", "N m", 1e-5, 1.0, 0.02),
    FitParameter("viscous", "N m s/rad", 1e-6, 1.0, 0.01),
)
FARTHER = "Let it go from a larger angle: the two differ over a range of speeds."
WORDING = Wording(
    model="pendulum",
    method="cubics through short blocks of the angle",
    title="Friction of a pendulum",
    x=Axis("speed", "rad/s"),
    y=Axis("torque of friction", "N m"),
    quantities=(
        ResponseQuantity("T_c", "dry friction", FARTHER),
        ResponseQuantity("b", "friction per angular speed", FARTHER),
    ),
)


def evaluate(
    sweeps: Sequence[RecordedSweep], options: Options, notify: Callable[[str], None]
) -> ParameterEvaluation:
    """Return the friction of each group of trials.

    Raises:
        DataError: a recording has no complete trial, or samples are no numbers.
    """
    fitted = []
    for group in complete_groups(sweeps, options, notify):
        trials = tuple(response(sweep, trial) for sweep, trial in group.trials)
        scale = max(float(np.median(np.abs(item.measured[item.used]))) for item in trials)
        model = ResponseModel(PARAMETERS, friction, trials, scale)
        account = Preprocessing(
            (f"A cubic through each block of {1e3 * BLOCK_S:g} ms of the free swing.",),
            {"block_s": BLOCK_S, "turning_rad_s": TURNING_RAD_S},
            {},
        )
        result = identify_response(model, WORDING, options, account)
        fitted.append(Fitted(group, result))
    return ParameterEvaluation.of(sweeps, fitted, options)


def friction(theta: FloatArray, speed: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return T_c sgn(w) + b w in N m (n,), and its derivatives (n, 2)."""
    way = np.sign(speed)
    return theta[0] * way + theta[1] * speed, np.stack([way, speed], axis=1)


def response(sweep: RecordedSweep, trial: TrialInfo) -> ResponseTrial:
    """Return speed and torque of friction of one trial, block by block.

    Raises:
        DataError: a signal or constant is missing, samples are no numbers, or it never swings.
    """
    t_s, signals = sweep.signals(trial)
    if not all(np.all(np.isfinite(signal)) for signal in signals.values()):
        raise DataError(
            f"{sweep.path}: in trial {trial.number} samples are no numbers",
            hint="look at them: rigd report draws the recording",
        )
    size = max(5, round(BLOCK_S / float(t_s[1] - t_s[0])))
    count = len(t_s) // size
    times, angle, speed, acceleration = (np.empty(count) for _ in range(4))
    held = signals["held"][: count * size].reshape(count, size).max(axis=1)
    for index in range(count):
        block = slice(index * size, (index + 1) * size)
        times[index] = t_s[block].mean()
        cubic = np.polynomial.Polynomial.fit(t_s[block] - times[index], signals["angle"][block], 3)
        angle[index], speed[index], acceleration[index] = (
            cubic(0.0), cubic.deriv(1)(0.0), cubic.deriv(2)(0.0),
        )  # fmt: skip
    used = (held < 0.5) & (np.abs(speed) > TURNING_RAD_S)
    if not used.any():
        raise DataError(
            f"{sweep.path}: in trial {trial.number} the pendulum never swings freely",
            hint="open the clamp in the trial, and let it go from a larger angle",
        )
    inertia, weight = sweep.constant(trial, "inertia"), sweep.constant(trial, "weight_moment")
    return ResponseTrial(
        label=f"trial {trial.number}",
        condition=f"from {np.max(np.abs(angle)):.2f} rad",
        recording=str(sweep.path),
        t_s=times,
        x=speed,
        measured=-(inertia * acceleration + weight * np.sin(angle)),
        used=used,
    )
