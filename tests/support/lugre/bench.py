"""A small rig of its own to make data from: lugre.md section 2, classical RK4.

It shares no code with the identification or with rigd_sim; a common one would hide its own bug.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from rigd.model.machine.kernel import kernel
from rigd_analyses.lugre.trials.known_constants import Known, RigConstants
from rigd_analyses.lugre.trials.trial import LugreConstants, LugreTrial

FloatArray = NDArray[np.float64]

G0 = 9.81
RADIUS_M = 0.05
GUIDE_DRY = 0.01956708695 * 0.012 / 0.030  #: 0.304 N at 3.9593 kg
SUBSTEPS = 40  #: 25 µs: the fastest rate is the current loop's 6283 1/s


@dataclass(frozen=True)
class Floor:
    """Table I of the paper, with the rolling resistance assumed in lugre.yaml."""

    v_s: float
    mu_c: float
    mu_s: float
    s0: float
    s1: float
    s2: float
    mu_rol: float

    def g(self, slip: FloatArray) -> FloatArray:
        """Return the corrected Eq. 6 at ``slip`` in m/s."""
        return self.mu_c + (self.mu_s - self.mu_c) * np.exp(-np.sqrt(np.abs(slip) / self.v_s))


FLOORS = {
    "stone": Floor(1.9643, 0.12, 0.1205, 11.451, 0.0809, 2.449, 0.009),
    "pvc": Floor(0.0044, 0.12, 0.15, 49.933, 0.372, 2.8084, 0.022),
    "paperboard": Floor(0.817, 0.04, 0.07, 54.724, 0.6146, 2.4028, 0.009),
}
PAPER_CURRENTS_A = tuple(round(0.15 * k, 2) for k in range(1, 11))


@kernel
def _rates(
    y: FloatArray, command: float, brake: float, lateral: float, q: tuple[float, ...],
    out: FloatArray,
) -> None:  # fmt: skip
    v, w, p, i, _x, theta = y
    v_s, mu_c, mu_s, s0, s1, s2, mu_rol, mass, a_vib = q
    slip = 0.05 * w - v
    g = mu_c + (mu_s - mu_c) * np.exp(-np.sqrt(abs(slip) / v_s))
    dp = slip - s0 * abs(slip) * p / g
    normal = mass * 9.81
    force = normal * (s0 * p + s1 * dp + s2 * slip)
    sv = np.tanh(v / 1e-3)
    sw = np.tanh(0.05 * w / 1e-3)
    moment = normal * 0.012 - lateral * 0.25
    guide = 0.01956708695 * sv * max(abs(lateral), abs(moment) / 0.030)
    ripple = mass * a_vib * v * np.sin(18.0 * theta)
    out[0] = (force - guide - mu_rol * normal * sv + ripple - brake * sv) / mass
    near, far = (normal * 0.07 - lateral * 0.05) / 0.04, (normal * 0.03 - lateral * 0.05) / 0.04
    bearing = (0.002 * sw + 2e-5 * w) * (abs(near) + abs(far)) * 0.01
    idle = 2.2e-3 * sw + 1.9e-6 * 20.25 * w
    inertia = 4.5e-4 + 1.2e-6 * 0.81 * 20.25**2
    out[1] = ((0.0295 * i - idle) * 0.81 * 20.25 - bearing - 0.05 * force) / inertia
    out[2] = dp
    back = 0.0295 * 20.25 * w
    ref = min(max(command, (-24.0 - back) / 3.2), (24.0 - back) / 3.2)
    out[3] = 2.0 * np.pi * 1000.0 * (ref - i)
    out[4] = v
    out[5] = w


@kernel
def _drive(
    q: tuple[float, ...],
    lateral: FloatArray,
    commands: FloatArray,
    max_steps: int,
    after_steps: int,
    dt: float,
    substeps: int,
) -> FloatArray:
    rows = np.empty((max_steps + after_steps, 9))
    y = np.zeros(6)
    k1, k2, k3, k4 = np.empty(6), np.empty(6), np.empty(6), np.empty(6)
    h = dt / substeps
    left = after_steps
    n = 0
    while n < max_steps + after_steps and left > 0:
        braking = y[4] > 1.15 or n >= max_steps
        if braking:
            left -= 1
        command = 0.0 if braking else commands[n]
        brake = 15.0 if braking else 0.0
        _rates(y, command, brake, lateral[n], q, k1)
        rows[n, 0] = n * dt
        rows[n, 1:7] = y
        rows[n, 7] = k1[0]
        rows[n, 8] = braking
        push = lateral[n]
        n += 1
        for _ in range(substeps):
            _rates(y, command, brake, push, q, k1)
            _rates(y + 0.5 * h * k1, command, brake, push, q, k2)
            _rates(y + 0.5 * h * k2, command, brake, push, q, k3)
            _rates(y + h * k3, command, brake, push, q, k4)
            y = y + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return rows[:n]


@dataclass(frozen=True)
class Bench:
    """Makes trials as the rig records them: ``noisy`` adds noise, bias, counts and vibration."""

    floor: str
    mass_kg: float = 3.9593
    noisy: bool = True
    dt_s: float = 1e-3
    max_s: float = 3.0
    half_swing_s: float = np.inf  #: after which the current changes its sign, again and again
    #: Friction G of the rollers in N from sample to sample; none without lateral motion.
    lateral_n: FloatArray | None = field(default=None, compare=False)

    @property
    def truth(self) -> Floor:
        """Return the hidden parameters."""
        return FLOORS[self.floor]

    @property
    def constants(self) -> LugreConstants:
        """Return the rig-file constants of this bench."""
        return LugreConstants(
            mass_kg=self.mass_kg,
            wheel_radius_m=RADIUS_M,
            guide_friction_n=GUIDE_DRY * self.mass_kg * G0,
            rolling_resistance=self.truth.mu_rol,
            gravity_m_s2=G0,
        )

    def rows(self, current_a: float) -> FloatArray:
        """Return (n, 9): time, v, w, p, i, x, theta, acceleration, whether it brakes."""
        f = self.truth
        q = (f.v_s, f.mu_c, f.mu_s, f.s0, f.s1, f.s2, f.mu_rol, self.mass_kg, 0.3 * self.noisy)
        most, after = round(self.max_s / self.dt_s), round(0.1 / self.dt_s)
        push = np.zeros(most + after) if self.lateral_n is None else self.lateral_n
        since = self.dt_s * np.arange(most + after) - 0.35 + 1e-9
        sign = 1.0 - 2.0 * (since // self.half_swing_s % 2)
        commands = np.where(since > 0.0, sign * current_a, 0.0)
        return _drive(
            q, push, commands, most, after, self.dt_s,
            max(1, round(SUBSTEPS * self.dt_s / 1e-3)),
        )  # fmt: skip

    def trial(self, current_a: float, seed: int) -> LugreTrial:
        """Return one recording: 0.35 s of rest, the drive, 0.1 s of braking."""
        rows = self.rows(current_a)
        t, v, theta = rows[:, 0], rows[:, 1], rows[:, 6]
        trial = LugreTrial(
            label=f"{current_a:.2f} A",
            current_a=current_a,
            t_s=t,
            wheel_angle_rad=theta,
            carriage_position_m=rows[:, 5],
            acceleration_m_s2=rows[:, 7],
            motor_current_a=rows[:, 4],
        )
        if not self.noisy:
            return trial
        rng = np.random.default_rng([seed, round(1e4 * current_a)])
        n = len(t)
        shake = 0.15 * v * np.sin(36 * theta)
        lsb_a, lsb_i, lsb_x = 0.0119682, 0.00305, 3.0679616e-05
        lsb_theta = 2 * np.pi / (1024 * 20.25)
        offset = rng.uniform(0.0, 1.0, 2)
        acceleration = trial.acceleration_m_s2 + shake + 0.02 + 0.03 * rng.standard_normal(n)
        current = trial.motor_current_a + 0.006 * rng.standard_normal(n)
        return replace(
            trial,
            wheel_angle_rad=np.floor(theta / lsb_theta + offset[0]) * lsb_theta,
            carriage_position_m=np.floor(trial.carriage_position_m / lsb_x + offset[1]) * lsb_x,
            acceleration_m_s2=np.round(acceleration / lsb_a) * lsb_a,
            motor_current_a=np.round(current / lsb_i) * lsb_i,
        )

    def sweep(
        self, seed: int = 1, currents: tuple[float, ...] = PAPER_CURRENTS_A
    ) -> list[LugreTrial]:
        """Return one trial per current, the paper's procedure by default."""
        return [self.trial(c, seed) for c in currents]


def known_rig(constants: LugreConstants, **changed: Known) -> RigConstants:
    """Return the rig-file constants of the independent simulator."""
    bearing = 0.002 * 0.01 * constants.normal_force_n * (0.07 + 0.03) / 0.04
    stated = {
        "mass": Known(constants.mass_kg, 1e-3),
        "wheel_radius": Known(0.05, 1e-4),
        "guide_friction": Known(constants.guide_friction_n, 0.015),
        "rolling_resistance": Known(constants.rolling_resistance, 0.002),
        "gravity": Known(9.81, 0.01),
        "torque_constant": Known(0.0295, 3e-4),
        "gear_ratio": Known(20.25, 0.0),
        "gear_efficiency": Known(0.81, 0.024),
        "no_load_torque": Known(2.2e-3, 2.2e-4),
        "no_load_viscous": Known(1.9e-6, 4e-7),
        "motor_inertia": Known(1.2e-6, 1.2e-7),
        "wheel_inertia": Known(4.5e-4, 1.4e-5),
        "bearing_torque": Known(bearing, 0.3 * bearing),
        "guide_lift": Known(0.0, constants.guide_friction_n / math.sqrt(3.0)),
    }
    return RigConstants(**{**stated, **changed}, roller_transitions=18.0)
