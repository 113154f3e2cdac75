"""Defines the input of the LuGre identification: one object per trial, and the known constants."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from rigd.analysis import DataError
from rigd.analysis.result import FloatArray
from rigd_analyses.lugre.trials.known_constants import refuse_lift
from rigd_analyses.lugre.trials.resolution import Rounding, count

#: Uniform sampling may jitter by this share of the period before the filters stop being right.
MAX_JITTER = 0.5
MIN_SAMPLES = 100
#: No sensor of the rig reads as much, in rad, m, m/s^2 or A; the squares of sums stay numbers.
MOST_READING = 1e6


@dataclass(frozen=True, eq=False)
class LugreTrial:
    """One recording: rest, a current step held while the carriage drives, and what follows.

    All arrays are (n,) on one clock. ``current_a`` is the commanded step, negative for driving
    backwards. ``wheel_angle_rad`` is at the wheel (behind the gear), ``acceleration_m_s2`` is the
    carriage's, ``motor_current_a`` the monitor's. Nothing is filtered and no bias is removed.
    ``recording`` is the file that it is from. ``held`` (n,) is above
    0.5 while something else than the motor holds or moves the carriage; None if not recorded.
    ``load`` is the mass over that of the constants. ``wheel_encoder``, ``carriage_encoder`` and
    ``accelerometer`` are known if their readings are means of several samples; else these show how
    they round. ``spikes`` are the sizes of single readings that were bridged, by encoder.
    """

    label: str
    current_a: float
    t_s: FloatArray
    wheel_angle_rad: FloatArray
    carriage_position_m: FloatArray
    acceleration_m_s2: FloatArray
    motor_current_a: FloatArray
    recording: str = ""
    held: FloatArray | None = None
    load: float = 1.0
    wheel_encoder: Rounding | None = None
    carriage_encoder: Rounding | None = None
    accelerometer: Rounding | None = None
    spikes: Mapping[str, FloatArray] = field(default_factory=dict)

    @property
    def angle_rounding(self) -> Rounding:
        """Return how the wheel encoder rounds, in rad."""
        return self.wheel_encoder or Rounding(count(self.wheel_angle_rad))

    @property
    def position_rounding(self) -> Rounding:
        """Return how the carriage encoder rounds, in m."""
        return self.carriage_encoder or Rounding(count(self.carriage_position_m))

    @property
    def acceleration_rounding(self) -> Rounding:
        """Return how the converter of the accelerometer rounds, in m/s^2."""
        return self.accelerometer or Rounding(count(self.acceleration_m_s2))


@dataclass(frozen=True)
class LugreConstants:
    """The constants that were measured before the trials (lugre.md section 3); all SI.

    ``guide_friction_n`` is the kinetic friction of the guide at ``mass_kg`` (0.304 N at 3.9593 kg
    in the paper); it scales with the mass, see :meth:`for_mass`. ``rolling_resistance`` is the
    share of the load that rolling costs. ``guide_lift_n`` is the force of the guide that lifts the
    carriage off its wheel, of either sign.
    """

    mass_kg: float
    wheel_radius_m: float
    guide_friction_n: float
    rolling_resistance: float
    gravity_m_s2: float = 9.81
    guide_lift_n: float = 0.0

    def __post_init__(self) -> None:
        positive = {
            "mass_kg": self.mass_kg,
            "wheel_radius_m": self.wheel_radius_m,
            "gravity_m_s2": self.gravity_m_s2,
        }
        for name, value in positive.items():
            if not (np.isfinite(value) and value > 0.0):
                raise DataError(f"{name} is {value}, must be a positive number")
        for name, value in (
            ("guide_friction_n", self.guide_friction_n),
            ("rolling_resistance", self.rolling_resistance),
        ):
            if not (np.isfinite(value) and value >= 0.0):
                raise DataError(f"{name} is {value}, must not be negative")
        refuse_lift(self.guide_lift_n, self.mass_kg * self.gravity_m_s2)

    @property
    def normal_force_n(self) -> float:
        """Return the load on the wheel in N: m_T g of Eq. 25, less the lift of the guide."""
        return self.mass_kg * self.gravity_m_s2 - self.guide_lift_n

    @property
    def resistance_n(self) -> float:
        """Return guide friction plus rolling resistance of the moving carriage in N."""
        return self.guide_friction_n + self.rolling_resistance * self.normal_force_n

    def for_mass(self, mass_kg: float) -> LugreConstants:
        """Return the constants with another carriage mass; the guide's friction follows it."""
        return LugreConstants(
            mass_kg,
            self.wheel_radius_m,
            self.guide_friction_n * mass_kg / self.mass_kg,
            self.rolling_resistance,
            self.gravity_m_s2,
            self.guide_lift_n * mass_kg / self.mass_kg,
        )


def sampling_period_s(trial: LugreTrial) -> float:
    """Return the period of ``trial`` in s.

    Raises DataError for arrays of unequal length, non-finite samples, samples beyond
    ``MOST_READING``, a clock that runs backwards or has gaps, and channels that never change.
    """
    arrays = {
        "t": trial.t_s,
        "wheel angle": trial.wheel_angle_rad,
        "carriage position": trial.carriage_position_m,
        "acceleration": trial.acceleration_m_s2,
        "motor current": trial.motor_current_a,
    }
    count = len(trial.t_s)
    if count < MIN_SAMPLES:
        raise DataError(f"trial {trial.label}: {count} samples, need at least {MIN_SAMPLES}")
    for name, values in arrays.items():
        if np.shape(values) != (count,):
            raise DataError(
                f"trial {trial.label}: {name} has shape {np.shape(values)}, time has ({count},)"
            )
        bad = int(np.count_nonzero(~np.isfinite(values)))
        if bad:
            raise DataError(
                f"trial {trial.label}: {name} has {bad} samples that are not numbers, the first "
                f"at index {int(np.argmin(np.isfinite(values)))}",
                hint="a stale channel was recorded; leave this trial out or repeat it",
            )
        largest = float(np.max(np.abs(values)))
        if largest > MOST_READING:
            raise DataError(
                f"trial {trial.label}: {name} reads up to {largest:.3g}, limit {MOST_READING:g}: "
                "no sensor of this rig shows as much",
                hint="look at the scale and the wiring of this channel; repeat the trial",
            )
    steps = np.diff(trial.t_s)
    period = float(np.median(steps))
    if period <= 0.0 or np.any(steps <= 0.0):
        raise DataError(f"trial {trial.label}: time does not increase from sample to sample")
    worst = float(np.max(np.abs(steps - period)))
    if worst > MAX_JITTER * period:
        raise DataError(
            f"trial {trial.label}: samples are up to {1e3 * worst:.3g} ms off the period of "
            f"{1e3 * period:.3g} ms, limit {1e3 * MAX_JITTER * period:.3g} ms",
            hint="samples are missing; repeat the trial",
        )
    for name in ("acceleration", "motor current"):
        if np.ptp(arrays[name]) == 0.0:
            raise DataError(
                f"trial {trial.label}: {name} is {arrays[name][0]:.6g} in all {count} samples",
                hint="the channel is not connected or not recorded; check its wiring",
            )
    return period
