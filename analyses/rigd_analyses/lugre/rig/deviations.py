"""Computes how noise of the current and of the sensors changes the outputs of a simulated trial.

The state of the deviations is: carriage position, wheel angle, both speeds, bristle, and the zero
error of the current in this trial. The step from sample to sample is the derivative of the
recursion itself (:mod:`.kernel`). An approximation would not be exact enough: wheel and carriage
drift by a millimetre, and their difference is known to a tenth of a micrometre.

If the carriage turns, dry friction turns its sign, and the acceleration jumps. The noise of the
current moves the speed by more than the speed over which the sign turns, so that the simulation
turns some samples too early or too late. No derivative says what the accelerometer reads there: its
readings are not heeded.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rigd.analysis.kernel import kernel
from rigd.analysis.output_error.innovations import Deviations, spread
from rigd.analysis.result import FloatArray
from rigd_analyses.lugre.rig import kernel as rig
from rigd_analyses.lugre.rig.outputs import (
    ACCELERATION_DELAY,
    CARRIAGE_DELAY,
    GAIN,
    WHEEL_DELAY,
    late,
    unsure,
)

if TYPE_CHECKING:
    from rigd_analyses.lugre.rig.system import RigSystem

X, ANGLE, V, W, Z, OFFSET = range(6)
STATES = 6
MOVING_M_S = 2e-3  #: of the wheel's rim; below it static friction takes up what disturbs
MOST_REPEATS = 300.0  #: samples that may show the same count, and count as one
DRIFTS = 0.3  #: of the speed over which dry friction turns: less drift leaves the turn in its place
TURNS = 4.0  #: standard deviations of the speed within which the carriage may turn
CREEPS = 0.95  #: of dry friction: with more pull the carriage would leave
UNHEEDED = 1e3  #: standard deviations of a reading that is not heeded


@dataclass(frozen=True)
class SensorNoise:
    """Standard deviations of current and accelerometer, and the counts of both encoders.

    ``angle_count`` and ``position_count`` are the steps of the readings, 0 of means of several;
    ``rest`` is how many samples the zero of the current is the mean of.
    """

    current_a: float
    angle_rad: float
    position_m: float
    acceleration_m_s2: float
    rest: int
    angle_count: float = 0.0
    position_count: float = 0.0


@kernel
def transitions(
    states: FloatArray, q: FloatArray, current: FloatArray, jumps: FloatArray, angle: FloatArray,
    turning: FloatArray, orders: float, mass: float, normal: float, period: float,
) -> tuple[FloatArray, FloatArray, FloatArray]:  # fmt: skip
    """Return the derivatives of each step of the recursion along ``states`` (n, 6).

    To (x, angle, v, w, z) before it, (n, 5, 5), and to a current that is added throughout, (n, 5);
    those of the acceleration to (v, w, z) at the sample, (n, 3). The last row of the first two is
    not a step. Arguments as those of :func:`.kernel.integrate`.
    """
    count = current.size
    forward, driven, felt = np.zeros((count, 5, 5)), np.zeros((count, 5)), np.zeros((count, 3))
    static, late = q[1] * math.exp(q[2]), q[18]
    rate, by_state = np.zeros((4, 3)), np.zeros((4, 3, 3))
    by_q, by_input = np.zeros((4, 3, rig.COUNT)), np.zeros((4, 3, rig.COUNT))
    for stage in range(4):
        by_input[stage, 1, 5] = q[6] / q[9]
    s = np.zeros((5, rig.COUNT))  # to the state before the step, and to the current; 0 beyond
    for k in range(count):
        v, w, z = states[k, 3], states[k, 4], states[k, 5]
        after = min(k + 1, count - 1)
        i_0, i_1 = current[k], current[after]
        phase_0 = orders * (angle[k] + late * turning[k])
        phase_1 = orders * (angle[after] + late * turning[after])
        jump = jumps[k] > 0.0
        steps = rig.steps_of(period, jump or rig.turns(v, q[14] * w))
        h = period / steps
        s[:] = 0.0
        for d in range(5):
            s[d, d] = 1.0
        for step in range(steps):
            for stage in range(4):
                share = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
                at = (step + share) / steps
                phase = phase_0 + (phase_1 - phase_0) * at
                i = i_0 + (i_1 - i_0) * at
                if jump:
                    i = i_1 + (i_0 - i_1) * math.exp(-rig.LOOP_RATE * at * period)
                reach = h * share
                before = max(stage - 1, 0)
                rig.rates(
                    stage, v + reach * rate[before, 0], w + reach * rate[before, 1],
                    z + reach * rate[before, 2], q, static, i, math.cos(phase), math.sin(phase),
                    0.0, mass, normal, True, rate, by_state, by_q,
                )  # fmt: skip
                if step == 0 and stage == 0:
                    felt[k] = by_state[0, 0]
            v += h / 6.0 * (rate[0, 0] + 2.0 * rate[1, 0] + 2.0 * rate[2, 0] + rate[3, 0])
            w += h / 6.0 * (rate[0, 1] + 2.0 * rate[1, 1] + 2.0 * rate[2, 1] + rate[3, 1])
            z += h / 6.0 * (rate[0, 2] + 2.0 * rate[1, 2] + 2.0 * rate[2, 2] + rate[3, 2])
            rig.advance_derivatives(s, h, by_state, by_input)
        forward[k] = s[:, :5]
        driven[k] = s[:, 5]
    return forward, driven, felt


def stepped(
    system: RigSystem, trial: int, states: FloatArray, q: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return :func:`transitions` along the ``states`` of one trial with parameters ``q`` (20,)."""
    driven = system.trials[trial]
    return transitions(
        states, q, driven.current_a, driven.jumps, driven.angle_rad, driven.turning_rad_s,
        system.constants.roller_transitions, system.mass_kg(trial), system.normal_force_n(trial),
        system.period_s,
    )  # fmt: skip


def moving(states: FloatArray, radius_m: float) -> FloatArray:
    """Return (n,) 1 if the wheel turns in the step behind a sample, 0 if it stands."""
    speed = np.abs(radius_m * states[:, rig.WHEEL_SPEED])
    return np.asarray(np.append(np.maximum(speed[1:], speed[:-1]), speed[-1]) > MOVING_M_S, float)


def deviations(
    system: RigSystem, noise: SensorNoise, trial: int, shared: FloatArray, local: FloatArray,
    *, settles: bool = True,
) -> Deviations:  # fmt: skip
    """Return how noise moves the outputs of one trial around its simulation.

    Outputs as :class:`.system.RigSystem` has them, with the wheel's travel in place of slip travel:
    the noise of the two encoders is independent. ``settles``: a contact that is still bent before
    the step may creep, see :func:`_settling`.
    """
    states = system.states(trial, shared, local)
    q = system.recursion(trial, shared, local)
    step, by_input, felt = stepped(system, trial, states, q)
    count, radius = len(states), system.constants.wheel_radius.value
    free = moving(states, radius)
    forward = np.zeros((count, STATES, STATES))
    forward[:, :5, :5] = step
    forward[:, :5, OFFSET] = by_input * free[:, None]
    forward[:, OFFSET, OFFSET] = 1.0
    driven = np.zeros((count, STATES))
    driven[:, :5] = by_input * (noise.current_a * free)[:, None]
    seen = np.zeros((count, 3, STATES))
    seen[:, 0, ANGLE], seen[:, 0, W] = radius, -radius * shared[WHEEL_DELAY]
    seen[:, 1, X], seen[:, 1, V] = 1.0, -shared[CARRIAGE_DELAY]
    first = np.zeros(STATES)
    first[OFFSET] = noise.current_a**2 / noise.rest
    drift = np.sqrt(_drift(forward, driven, first))
    turns = may_turn(states[:, rig.SPEED], drift)
    lag = shared[ACCELERATION_DELAY] / system.period_s
    seen[:, 2, V : Z + 1] = (1.0 + shared[GAIN]) * late(felt, lag)[0]
    jumps = system.trials[trial].jumps
    unknown = unsure(states[:, 2], jumps, lag)
    if settles:
        unknown = np.hypot(unknown, _settling(system, trial, q, count))
    felt_sd = np.hypot(noise.acceleration_m_s2, unknown)
    turned = radius * system.period_s * np.abs(states[:, rig.WHEEL_SPEED])
    moved = system.period_s * np.abs(states[:, rig.SPEED])
    variance = np.stack(
        [
            _rounding(radius * noise.angle_rad, turned),
            _rounding(noise.position_m, moved),
            (felt_sd * np.where(turns, UNHEEDED, 1.0)) ** 2,
        ],
        axis=1,
    )
    mix = np.eye(3)
    mix[0, 1] = 1.0  # slip travel and carriage travel are the wheel's travel
    counts = (radius * noise.angle_count, noise.position_count, 0.0)
    return Deviations(forward, driven, seen, variance, first, mix, counts)


def _settling(system: RigSystem, trial: int, q: FloatArray, count: int) -> FloatArray:
    """Return by how much the acceleration (n,) may err as the simulation begins at rest, in m/s^2.

    A contact that is still bent creeps instead, against dry friction: the simulation takes some
    milliseconds to creep too. The current jumps later. Without it a right rig was refused.
    """
    normal_n, mass_kg = system.normal_force_n(trial), system.mass_kg(trial)
    pull = abs(float(q[rig.NAMES.index("first_bristle")])) * normal_n
    names = rig.NAMES.index("guide_friction"), rig.NAMES.index("rolling_resistance")
    dry = max(float(q[names[0]] + q[names[1]] * normal_n), 0.0)
    share = pull / dry if pull < CREEPS * dry else CREEPS
    rate = dry * (1.0 - share**2) / (mass_kg * rig.SMOOTH_M_S)
    row = np.arange(count)
    at_rest = row <= np.argmax(system.trials[trial].jumps)
    return np.asarray(at_rest * pull / mass_kg * np.exp(-rate * system.period_s * row))


@kernel
def _drift(forward: FloatArray, driven: FloatArray, first: FloatArray) -> FloatArray:
    """Return the variance (n,) of the carriage's speed before any output is heeded.

    Arguments as those of :class:`rigd.analysis.output_error.innovations.Deviations`.
    """
    count, states = driven.shape
    out = np.zeros(count)
    p, moved = np.diag(first), np.zeros((states, states))
    for n in range(count):
        out[n] = max(p[V, V], 0.0)
        spread(forward, driven, n, p, moved)
    return out


def may_turn(speed: FloatArray, drift: FloatArray) -> NDArray[np.bool_]:
    """Return at which samples (n,) the carriage may have turned already, or not yet.

    ``speed`` as simulated and its standard deviation ``drift`` are (n,) in m/s.
    """
    near = np.abs(speed) < TURNS * (drift + rig.SMOOTH_M_S)
    return np.asarray(near & (drift > DRIFTS * rig.SMOOTH_M_S))


def _rounding(step: float, moved: FloatArray) -> FloatArray:
    """Return the variance of rounding to ``step`` for each sample that moves by ``moved`` (n,).

    Samples that show one count count together as one.
    """
    repeats = np.clip(step / np.maximum(moved, 1e-12), 1.0, MOST_REPEATS)
    return np.asarray(step**2 / 12.0 * repeats)
