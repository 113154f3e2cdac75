"""Computes how a small disturbance of the rig changes its outputs, to first order.

A disturbance adds to the rates of carriage speed, wheel speed and bristle. Its effect follows the
derivative of each step of the recursion (:func:`.deviations.transitions`): the variational equation
(Hairer, Nørsett and Wanner, Solving Ordinary Differential Equations I, sec. I.14). While the rig
stands still, static friction takes the disturbance up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rigd.analysis.kernel import kernel
from rigd.analysis.result import FloatArray
from rigd_analyses.lugre.model import friction
from rigd_analyses.lugre.rig import kernel as rig
from rigd_analyses.lugre.rig.deviations import moving, stepped
from rigd_analyses.lugre.rig.outputs import (
    ACCELERATION,
    ACCELERATION_DELAY,
    CARRIAGE_DELAY,
    GAIN,
    LOCAL,
    SLIP,
    TRAVEL,
    WHEEL_DELAY,
    late,
)
from rigd_analyses.lugre.rig.standard_errors import FRICTION
from rigd_analyses.lugre.rig.system import RigSystem

V, W, Z = range(3)  #: carriage speed, wheel speed, bristle: columns of a disturbance of the rates


@dataclass(frozen=True, eq=False)
class Motion:
    """One trial as fitted. All arrays (n,), SI; ``g`` is the friction at its slip.

    ``time`` begins with the part that is simulated; ``angle`` is the encoder's, absolute.
    ``forward``, ``felt`` and ``moving`` as :mod:`.deviations` has them.
    """

    time: FloatArray
    current: FloatArray
    position: FloatArray
    angle: FloatArray
    speed: FloatArray
    turning: FloatArray
    acceleration: FloatArray
    bristle: FloatArray
    slip: FloatArray
    g: FloatArray
    forward: FloatArray
    felt: FloatArray
    moving: FloatArray


class Disturbed:
    """The fitted rig: the motions of its trials, and what disturbances would make of them."""

    def __init__(
        self, system: RigSystem, theta: FloatArray, own: Sequence[FloatArray] | None = None
    ) -> None:
        """Simulate ``system`` with the parameters ``theta`` (p,): shared, then local ones.

        ``own`` are the shared parameters as each trial has them, if its loads differ.
        """
        self.system, self.shared = system, theta[: len(system.shared)]
        self._own = [self.shared] * len(system.trials) if own is None else own
        names = (item.parameter.name for item in system.shared)
        self.named = dict(zip(names, self.shared.tolist(), strict=True))
        local = theta[len(system.shared) :].reshape(-1, LOCAL)
        self.motions = [self._motion(k, local[k]) for k in range(len(system.trials))]

    def _motion(self, trial: int, local: FloatArray) -> Motion:
        system, shared, driven = self.system, self._own[trial], self.system.trials[trial]
        states = system.states(trial, shared, local)
        q = system.recursion(trial, shared, local)
        forward, _, felt = stepped(system, trial, states, q)
        slip = self.named["wheel_radius"] * states[:, rig.WHEEL_SPEED] - states[:, rig.SPEED]
        return Motion(
            time=system.period_s * np.arange(len(states), dtype=np.float64),
            current=driven.current_a,
            position=states[:, rig.POSITION],
            angle=driven.angle_rad,
            speed=states[:, rig.SPEED],
            turning=states[:, rig.WHEEL_SPEED],
            acceleration=states[:, rig.ACCELERATION],
            bristle=states[:, rig.BRISTLE],
            slip=slip,
            g=friction(shared[:FRICTION], slip),
            forward=forward,
            felt=felt,
            moving=moving(states, self.named["wheel_radius"]),
        )

    def readings(
        self,
        position: FloatArray | None = None,
        angle: FloatArray | None = None,
        acceleration: FloatArray | None = None,
    ) -> FloatArray:
        """Return the outputs (n, 3, c) for changed readings (n, c); None: not changed."""
        given = next(item for item in (position, angle, acceleration) if item is not None)
        out = np.zeros((given.shape[0], 3, given.shape[1]))
        if position is not None:
            out[:, SLIP] -= position
            out[:, TRAVEL] += position
        if angle is not None:
            out[:, SLIP] += self.system.constants.wheel_radius.value * angle
        if acceleration is not None:
            out[:, ACCELERATION] += acceleration
        return out

    def forced(
        self, trial: int, force_n: FloatArray | None = None, torque_nm: FloatArray | None = None
    ) -> FloatArray:
        """Return the outputs (n, 3, c) for a force or a torque on the wheel, each (n, c)."""
        like = next(item for item in (force_n, torque_nm) if item is not None)
        rates = np.zeros((like.shape[0], 3, like.shape[1]))
        if force_n is not None:
            rates[:, V] += force_n / self.system.mass_kg(trial)
        if torque_nm is not None:
            rates[:, W] += torque_nm / self.named["wheel_inertia"]
        return self._outputs(trial, rates)

    def rubbed(
        self,
        trial: int,
        friction_share: FloatArray | None = None,
        traction: FloatArray | None = None,
        bristle: FloatArray | None = None,
    ) -> FloatArray:
        """Return the outputs (n, 3, c) for another contact, each (n, c).

        ``friction_share`` is added to g, as a share of it; ``traction`` to F/F_N; ``bristle`` to
        dz/dt in 1/s.
        """
        motion, named = self.motions[trial], self.named
        like = next(x for x in (friction_share, traction, bristle) if x is not None)
        pull, stretch = np.zeros_like(like), np.zeros_like(like)
        if traction is not None:
            pull += traction
        if bristle is not None:
            stretch += bristle
        if friction_share is not None:  # u = V - |V| z/g
            by_share = named["sigma_0"] * np.abs(motion.slip) * motion.bristle / motion.g
            stretch += by_share[:, None] * friction_share
        pull += stretch * named["sigma_1"] / named["sigma_0"]
        rates = np.zeros((like.shape[0], 3, like.shape[1]))
        normal = self.system.normal_force_n(trial)
        rates[:, V] = normal / self.system.mass_kg(trial) * pull
        rates[:, W] = -named["wheel_radius"] * normal / named["wheel_inertia"] * pull
        rates[:, Z] = stretch
        return self._outputs(trial, rates)

    def _outputs(self, trial: int, rates: FloatArray) -> FloatArray:
        motion, period = self.motions[trial], self.system.period_s
        moved = _propagated(
            motion.forward, motion.felt, rates * motion.moving[:, None, None], period
        )
        felt, _ = late(moved[:, 2], self.shared[ACCELERATION_DELAY] / period)
        return self.readings(
            moved[:, 0] - self.shared[CARRIAGE_DELAY] * moved[:, 3],
            moved[:, 1] - self.shared[WHEEL_DELAY] * moved[:, 4],
            (1.0 + self.shared[GAIN]) * felt,
        )


@kernel
def _propagated(
    forward: FloatArray, felt: FloatArray, rates: FloatArray, period: float
) -> FloatArray:
    """Return the change (n, 5, c) of x, angle, dv/dt, v, w for added ``rates`` (n, 3, c).

    Half of a rate acts at the begin of a step, half at its end (trapezoidal rule).
    """
    count, _, columns = rates.shape
    out = np.zeros((count, 5, columns))
    y, new = np.zeros((5, columns)), np.zeros((5, columns))
    half = 0.5 * period
    for n in range(count):
        for k in range(columns):
            out[n, 0, k], out[n, 1, k] = y[0, k], y[1, k]
            out[n, 3, k], out[n, 4, k] = y[2, k], y[3, k]
            out[n, 2, k] = rates[n, 0, k]
            for d in range(3):
                out[n, 2, k] += felt[n, d] * y[2 + d, k]
        if n + 1 == count:
            break
        for k in range(columns):
            for d in range(3):
                y[2 + d, k] += half * rates[n, d, k]
            for a in range(5):
                total = 0.0
                for b in range(5):
                    total += forward[n, a, b] * y[b, k]
                new[a, k] = total
            for d in range(3):
                new[2 + d, k] += half * rates[n + 1, d, k]
        y, new = new, y
    return out
