"""Predicts the motion of a test, and what the sensors of the rig read of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigd.analysis.result import FloatArray
from rigd_analyses.lugre.design.shapes import Phase, Shape
from rigd_analyses.lugre.rig import kernel
from rigd_analyses.lugre.rig.outputs import ACCELERATION, DYNAMIC, LOCAL, outputs
from rigd_analyses.lugre.rig.parts import LEAST_SPEED_M_S, LEAST_TRAVEL_M
from rigd_analyses.lugre.rig.system import BY_MASS, MASS
from rigd_analyses.lugre.trials.known_constants import RigConstants
from rigd_analyses.lugre.trials.trial import LugreTrial

TAIL = 30  #: samples behind the drive, in which the belt holds the carriage
FINE = 0.1  #: count of the accelerometer over its noise: without one, a search for it takes long
MARGIN = 2.0  #: travel and speed that a test needs, over the least that the estimator takes
#: The steps of the base procedure around the drive; a dry run of it takes as long to 3 %.
REST_S = 0.5
SETTLE_S = 0.3
RELAX_S = 1.2
HALTS_S = 0.28
BRAKE_M_S2 = 20.0
RETURN_M_S = 0.4
CREEP_M, CREEP_M_S = 0.028, 0.05
PARTS = (0.3, 0.6, 1.0)  #: of a phase, which a motion is predicted for until it comes to its end
MOST_REPETITIONS = 60
SETTLED_RAD, SETTLED_A = 1e-4, 1e-3  #: differences at which a repetition is the last
JUMP_A = 0.03  #: more than a ramp rises in a sample


@dataclass(frozen=True)
class Limits:
    """What a trial may reach: positions of the carriage in m, and its speed in m/s.

    ``speed_m_s`` is the largest of the recordings: how the drive behaves beyond is not known.
    """

    low_m: float
    high_m: float
    speed_m_s: float


@dataclass(frozen=True)
class Sensors:
    """Noise and counts of the sensors as a recording shows them, and the period of the samples.

    The voltage leaves ``limit_a`` less ``limit_slope`` times the wheel's speed in rad/s.
    """

    period_s: float
    current_a: float
    angle_rad: float
    position_m: float
    acceleration_m_s2: float
    limit_a: float = np.inf
    limit_slope: float = 0.0


@dataclass(frozen=True, eq=False)
class Motion:
    """The predicted rest and drive of one trial, all samples.

    ``current_a`` (n,); ``states`` (n, 6) as in :mod:`rigd_analyses.lugre.rig.kernel`;
    ``acceleration`` (n,) in m/s^2 as the accelerometer feels it.
    """

    current_a: FloatArray
    states: FloatArray
    acceleration: FloatArray
    duration_s: float


def predict(shape: Shape, shared: FloatArray, constants: RigConstants, sensors: Sensors) -> Motion:
    """Return the motion of ``shape`` with the unknowns ``shared`` (27,) of a system."""
    q, period_s = np.append(shared[:DYNAMIC], 0.0), sensors.period_s
    q[list(BY_MASS)] *= constants.mass.value / shared[MASS]
    told = np.zeros(round(REST_S / period_s))
    for phase in shape.phases:
        start = len(told)
        for share in PARTS:  # a longer drive may come to the voltage limit, and takes long
            whole = np.concatenate([told, _told(phase, period_s, share)])
            current, states = _states(q, whole, constants, sensors)
            there = np.flatnonzero(states[start:, kernel.POSITION] > phase.until_m)
            if there.size:
                break
        told = whole[: start + int(there[0]) + 1] if there.size else whole
    current, states = current[: len(told)], states[: len(told)]
    phase_of = constants.roller_transitions * states[:, kernel.ANGLE]
    nothing = np.zeros(LOCAL)
    radius = constants.wheel_radius.value
    felt = outputs(states, phase_of, shared, nothing, radius, period_s)
    speed = abs(float(states[-1, kernel.SPEED]))
    end = float(states[-1, kernel.POSITION]) + 0.5 * speed**2 / BRAKE_M_S2
    back = max(end - CREEP_M, 0.0) / RETURN_M_S + min(max(end, 0.0), CREEP_M) / CREEP_M_S
    around = SETTLE_S + RELAX_S + HALTS_S + speed / BRAKE_M_S2
    duration_s = len(current) * period_s + around + back
    return Motion(current, states, felt[:, ACCELERATION], duration_s)


def refusal(motion: Motion, limits: Limits) -> str:
    """Return which limit the motion would break, or what it lacks; empty if it is a test."""
    position, speed = motion.states[:, kernel.POSITION], motion.states[:, kernel.SPEED]
    braking = 0.5 * float(speed[-1]) ** 2 / BRAKE_M_S2 * np.sign(speed[-1])
    low = min(float(np.min(position)), float(position[-1]) + min(braking, 0.0))
    high = max(float(np.max(position)), float(position[-1]) + max(braking, 0.0))
    if not np.all(np.isfinite(motion.states)):
        return "its motion cannot be predicted"
    if low < limits.low_m or high > limits.high_m:
        return "beyond the limits of the travel"
    if float(np.max(np.abs(speed))) > limits.speed_m_s:
        return "faster than any recording"
    return "" if moves(motion) else "it hardly moves"


def moves(motion: Motion) -> bool:
    """Whether the motion is enough for the estimator."""
    travel = np.ptp(motion.states[:, kernel.POSITION])
    speed = np.max(motion.states[:, kernel.SPEED])
    return bool(travel > MARGIN * LEAST_TRAVEL_M and speed > MARGIN * LEAST_SPEED_M_S)


def reading(motion: Motion, shape: Shape, sensors: Sensors, seed: int, label: str) -> LugreTrial:
    """Return what the sensors read of ``motion``, with the noise of ``seed``."""
    random = np.random.default_rng(seed)
    held = np.zeros(len(motion.current_a) + TAIL)
    held[-TAIL:] = 1.0
    states = np.concatenate([motion.states, np.repeat(motion.states[-1:], TAIL, axis=0)])
    current = np.concatenate([motion.current_a, np.zeros(TAIL)])
    count = len(held)

    def counted(values: FloatArray, step: float) -> FloatArray:
        return np.asarray(step * np.floor(values / step + random.uniform()))

    felt = np.append(motion.acceleration, np.zeros(TAIL))
    felt += sensors.acceleration_m_s2 * random.standard_normal(count)
    return LugreTrial(
        label=label,
        current_a=shape.current_a,
        t_s=sensors.period_s * np.arange(count, dtype=np.float64),
        wheel_angle_rad=counted(states[:, kernel.ANGLE], sensors.angle_rad),
        carriage_position_m=counted(states[:, kernel.POSITION], sensors.position_m),
        acceleration_m_s2=counted(felt, FINE * sensors.acceleration_m_s2),
        motor_current_a=current + sensors.current_a * random.standard_normal(count),
        recording="predicted",
        held=held,
    )


def _told(phase: Phase, period_s: float, share: float) -> FloatArray:
    count = max(1, round(share * phase.lasting_s / period_s))
    return phase.current(period_s * np.arange(count, dtype=np.float64))


def _states(
    q: FloatArray, told: FloatArray, constants: RigConstants, sensors: Sensors
) -> tuple[FloatArray, FloatArray]:
    """Return the current (n,) and the states (n, 6) that follow from what the motor is told.

    The rollers shake with the angle, and the voltage limits the current with the speed: both are
    found by repetition. Each makes the next one right for as long again as the motion remembers.
    """
    current = told
    angle, turning = np.zeros_like(told), np.zeros_like(told)
    for _ in range(MOST_REPETITIONS):
        states = kernel.integrate(
            q, current, _jumps(told), angle, turning, constants.roller_transitions,
            constants.mass.value, constants.normal_force_n, sensors.period_s, False,
        )[0]  # fmt: skip
        moved = float(np.max(np.abs(states[:, kernel.ANGLE] - angle)))
        angle, turning = states[:, kernel.ANGLE], states[:, kernel.WHEEL_SPEED]
        most = np.maximum(sensors.limit_a - sensors.limit_slope * turning, 0.0)
        least = np.minimum(-sensors.limit_a - sensors.limit_slope * turning, 0.0)
        before, current = current, np.clip(told, least, most)
        if moved < SETTLED_RAD and np.max(np.abs(current - before)) < SETTLED_A:
            break
    return current, states


def _jumps(current: FloatArray) -> FloatArray:
    """Return (n,) 1 where the current jumps behind a sample."""
    return np.append(np.abs(np.diff(current)) > JUMP_A, False).astype(np.float64)
