"""Simulates a trial from its measured current, and compares the result with the measurement.

Measured and modelled travel pass the same zero-phase filter (that of method A), so the filter
causes no difference between them. The measured current is used as it is: an offset of the current
monitor is reported as a finding and not removed before.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import numpy as np
from scipy.signal import savgol_filter

from rigd.analysis.recordings.noise import noise_of_differences
from rigd.analysis.result import FloatArray, TrialRejection
from rigd_analyses.lugre.rig import kernel
from rigd_analyses.lugre.rig.current import SimulatedCurrent, simulated_current
from rigd_analyses.lugre.rig.parts import free_part
from rigd_analyses.lugre.rig.standard_errors import WINDOW_S
from rigd_analyses.lugre.rig.system import DRAG_N_S_M, LEAD, REST, SLOPE_M_S2
from rigd_analyses.lugre.slip_force.identify import Settings
from rigd_analyses.lugre.trials.known_constants import RigConstants
from rigd_analyses.lugre.trials.slip_and_traction import Guards, window_samples
from rigd_analyses.lugre.trials.trial import LugreTrial, sampling_period_s

SPEED, SLIP, FORCE = "speed", "slip", "force"
UNITS: Final = {SPEED: "m/s", SLIP: "m/s", FORCE: "N"}
LEAST_TRAVEL_M: Final = 0.05  #: a trial that moves less does not show sliding
FRICTION: Final = 6  #: parameters of friction, the first of the recursion
COLUMN: Final = {name: k for k, name in enumerate(kernel.NAMES)}
GAIN, ZERO, LATE = "drive_gain", "current_zero", "late_s"


@dataclass(frozen=True, eq=False)
class DrivenMotion:
    """The part of one trial in which the motor alone moves the carriage; all arrays (n,).

    ``conditions`` are those of the trial by name. ``rest_a`` is the mean current before the step.
    """

    trial: LugreTrial
    constants: RigConstants
    conditions: Mapping[str, str]
    part: slice
    period_s: float
    window: int
    order: int
    current: SimulatedCurrent
    rest_a: float
    rest_u_a: float
    acceleration_zero: float

    @cached_property
    def t_s(self) -> FloatArray:
        """The times that are compared: not those within half a window of either end."""
        return np.asarray(self.trial.t_s[self.part][self.inside])

    @property
    def inside(self) -> slice:
        """Which samples of the part are compared."""
        half = self.window // 2
        return slice(half, self.part.stop - self.part.start - half)

    @cached_property
    def carriage_speed(self) -> FloatArray:
        """The measured speed of the carriage in m/s."""
        return self.rate(self.trial.carriage_position_m[self.part])

    @cached_property
    def turning(self) -> FloatArray:
        """The measured speed of the wheel in rad/s."""
        return self.rate(self.trial.wheel_angle_rad[self.part])

    @cached_property
    def acceleration(self) -> FloatArray:
        """The measured acceleration in m/s^2 without its zero, smoothed as the speeds are."""
        values = self.trial.acceleration_m_s2[self.part] - self.acceleration_zero
        return self.smooth(values)

    def rate(self, values: FloatArray) -> FloatArray:
        """Return the time derivative along the first axis of what is compared."""
        slope = savgol_filter(
            values, self.window, self.order, deriv=1, delta=self.period_s, axis=0, mode="interp"
        )
        return np.asarray(slope[self.inside])

    def smooth(self, values: FloatArray) -> FloatArray:
        """Return ``values`` smoothed by the same polynomial."""
        return np.asarray(savgol_filter(values, self.window, self.order)[self.inside])


def driven_motion(
    trial: LugreTrial,
    constants: RigConstants,
    conditions: Mapping[str, str],
    guards: Guards | None = None,
) -> DrivenMotion | TrialRejection:
    """Return the part of ``trial`` to simulate, or why it is not usable.

    Raises:
        DataError: its samples are not usable, or it has no rest and no step of the current.
    """
    guards = Guards() if guards is None else guards
    period = sampling_period_s(trial)
    window = window_samples(guards, period)
    part = free_part(trial, period, Settings(guards=guards))
    travel = float(np.ptp(trial.carriage_position_m[part]))
    if travel < LEAST_TRAVEL_M or part.stop - part.start < 4 * window:
        return TrialRejection(
            trial.label,
            f"the carriage moved {1e3 * travel:.1f} mm while driven, need "
            f"{1e3 * LEAST_TRAVEL_M:.0f} mm",
        )
    rest = slice(max(0, part.start - REST), part.start + LEAD)
    at_rest = trial.motor_current_a[rest]
    smooth = max(3, round(WINDOW_S / period))
    return DrivenMotion(
        trial, constants, dict(conditions), part, period, window, guards.order,
        simulated_current(trial.motor_current_a[part], smooth + 1 - smooth % 2),
        float(np.mean(at_rest)), float(np.std(at_rest) / np.sqrt(len(at_rest))),
        float(np.mean(trial.acceleration_m_s2[rest])),
    )  # fmt: skip


def stated(motion: DrivenMotion, theta: FloatArray) -> FloatArray:
    """Return the parameters (k,) of the recursion as they are stated, with friction ``theta``."""
    c = motion.constants
    q = np.zeros(kernel.COUNT)
    q[:FRICTION] = theta
    for name, known in (
        ("drive_gain", c.drive_gain), ("no_load", c.no_load), ("wheel_viscous", c.viscous),
        ("wheel_inertia", c.inertia), ("guide_friction", c.guide_friction),
        ("rolling_resistance", c.rolling_resistance), ("wheel_radius", c.wheel_radius),
    ):  # fmt: skip
        q[COLUMN[name]] = known.value
    return q


def uncertainties(motion: DrivenMotion) -> dict[str, float]:
    """Return the standard uncertainty of each constant that is not fitted, by its name."""
    c = motion.constants
    return {
        "no_load": c.no_load.u,
        "wheel_viscous": c.viscous.u,
        "wheel_inertia": c.inertia.u,
        "guide_friction": c.guide_friction.u,
        "rolling_resistance": c.rolling_resistance.u,
        "drag": DRAG_N_S_M,
        "slope": SLOPE_M_S2,
    }


@dataclass(frozen=True, eq=False)
class Simulated:
    """A simulated trial with the parameters ``q``; the times are those of the motion, (n,).

    ``by_q`` has the derivatives (n, k) of the modelled speed and slip to ``q``, empty if they
    were not asked for. ``late_s`` is by how much the carriage encoder reads late, in s; below 0
    the wheel encoder does.
    """

    motion: DrivenMotion
    q: FloatArray
    speed: FloatArray
    turning: FloatArray
    acceleration: FloatArray
    by_q: Mapping[str, FloatArray] = field(repr=False)
    late_s: float = 0.0

    @property
    def radius_m(self) -> float:
        """The wheel radius that slip is made with."""
        return float(self.q[COLUMN["wheel_radius"]])

    def measured(self, output: str) -> FloatArray:
        """Return what was measured of ``output``, (n,)."""
        motion = self.motion
        speed = motion.carriage_speed + max(self.late_s, 0.0) * self.acceleration
        if output == SPEED:
            return np.asarray(speed)
        if output == SLIP:
            turning = motion.turning + max(-self.late_s, 0.0) * self._rate(self.turning)
            return np.asarray(self.radius_m * turning - speed)
        return self._force(motion.acceleration, motion.carriage_speed)

    def modelled(self, output: str) -> FloatArray:
        """Return ``output`` by the model, (n,)."""
        if output == SPEED:
            return self.speed
        if output == SLIP:
            return np.asarray(self.radius_m * self.turning - self.speed)
        return self._force(self.acceleration, self.speed)

    def error(self, output: str) -> FloatArray:
        """Return measured minus modelled, (n,)."""
        return self.measured(output) - self.modelled(output)

    def slopes(self, output: str, name: str) -> FloatArray:
        """Return the derivative (n,) of :meth:`error` to the constant ``name``, or to ``late_s``.

        Of the drive's gain, to its logarithm.
        """
        if name == LATE:
            return self.acceleration if output == SPEED else -self.acceleration
        slope = -self.by_q[output][:, COLUMN[name]]
        if name == "wheel_radius" and output == SLIP:
            slope = slope + self.motion.turning
        return np.asarray(slope * self.q[COLUMN[name]] if name == GAIN else slope)

    def _rate(self, values: FloatArray) -> FloatArray:
        return np.asarray(np.gradient(values, self.motion.period_s))

    def _force(self, acceleration: FloatArray, speed: FloatArray) -> FloatArray:
        """Return the traction in N: Eq. 34, with both resistances kinetic."""
        c = self.motion.constants
        resistance = c.guide_friction.value + c.rolling_resistance.value * c.normal_force_n
        turned = np.tanh(speed / kernel.SMOOTH_M_S)
        return np.asarray(c.mass.value * acceleration + resistance * turned)


def simulate(motion: DrivenMotion, q: FloatArray, *, sensitive: bool = True) -> Simulated:
    """Return ``motion`` simulated with the parameters ``q`` (k,) of the recursion."""
    constants = motion.constants
    # Without ripple the simulation does not depend on the measured angle, nor on its rate.
    angle = np.zeros_like(motion.current.current_a)
    states, by_q = kernel.integrate(
        q, motion.current.current_a, motion.current.jumps, angle, angle,
        constants.roller_transitions, constants.mass.value, constants.normal_force_n,
        motion.period_s, sensitive,
    )  # fmt: skip
    slopes = {}
    if sensitive:
        radius = q[COLUMN["wheel_radius"]]
        by_speed, by_turning = (motion.rate(by_q[:, k]) for k in (kernel.POSITION, kernel.ANGLE))
        slopes = {SPEED: by_speed, SLIP: radius * by_turning - by_speed}
        slopes[SLIP][:, COLUMN["wheel_radius"]] += motion.rate(states[:, kernel.ANGLE])
    return Simulated(
        motion, q, motion.rate(states[:, kernel.POSITION]), motion.rate(states[:, kernel.ANGLE]),
        motion.smooth(states[:, kernel.ACCELERATION]), slopes,
    )  # fmt: skip


def late(simulated: Simulated, seconds: float) -> Simulated:
    """Return the same with the carriage encoder late; below 0, with the wheel encoder late."""
    return replace(simulated, late_s=seconds)


def noise(simulated: Simulated, output: str) -> float:
    """Return the standard deviation that the recording's own noise leaves in an error.

    Two parts: what differs between residuals one filter window apart (von Neumann 1941; robust),
    which counts of encoders and shaking make; and the drift that the noise of the current monitor
    makes in the simulated motion, by its sensitivity to the current.
    """
    motion = simulated.motion
    error = simulated.error(output)
    steps = error[motion.window :] - error[: -motion.window]
    fast = noise_of_differences(steps - float(np.median(steps)), 1)
    by_current = np.diff(simulated.by_q[output][:, COLUMN[ZERO]], prepend=0.0)
    drift = motion.current.noise_a**2 * float(np.mean(np.cumsum(by_current**2)))
    return float(np.sqrt(fast**2 + drift))


def rms(values: FloatArray) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(values**2)))
