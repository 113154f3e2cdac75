"""Defines the input of the approach-angle analyses: runs, known quantities of the rig, flags."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


class Coefficient(Enum):
    """Names the three legitimate coefficients; every table states which one it shows."""

    ROLLING = "rolling-direction"  #: F_r/N: along the rolling direction, what the torque measures
    USABLE = "usable"  #: (F_r cos(alpha) - F_a sin(alpha))/N: the push along the travel
    RESULTANT = "resultant"  #: sqrt(F_r^2 + F_a^2)/N


class Regime(Enum):
    """The motion of the wheel in the window: F_r/N is a friction limit only if the wheel slides."""

    SLIDING = "sliding"
    ROLLING = "rolling"
    MIXED = "mixed"


@dataclass(frozen=True)
class Known:
    """A quantity known before the analysis: SI value and standard uncertainty (k = 1)."""

    value: float
    u: float = 0.0


#: Rise of N per metre of travel if it has not been measured: about 3 % over 0.5 m, either way.
UNKNOWN_RISE = Known(0.0, 0.05)


#: Share of the torque that gauge a shows, if it is not known: two gauges at 45 degrees, and
#: amplifiers whose gains are equal to 1 %.
UNKNOWN_SHARE = Known(0.5, 0.0035)


@dataclass(frozen=True)
class AngleCalibration:
    """The values that convert volts to quantities, from the calibration in the recording."""

    torque: Known  #: N m per V of (gauge a - gauge b): m g L / d(V_a - V_b)
    wheel: Known  #: rad per V of the wheel's potentiometer
    platform: Known  #: m per V of the platform's potentiometer
    load: Known = Known(1.0)  #: true load per indicated load of the scale
    normal_force: Known | None = None  #: N per V of the high-rate load cell, if there is one
    normal_force_zero: Known = Known(0.0)  #: V of the load cell that mean 0 N
    gauge_share: Known = UNKNOWN_SHARE  #: of the torque, that gauge a shows


@dataclass(frozen=True)
class AngleRig:
    """The known quantities of the rig except its sensors; uncertain ones have their uncertainty."""

    wheel_radius_m: float  #: nominal R of the paper (0.050 m), not the shaft's
    wheel_inertia: (
        float  #: kg m^2, wheel and shaft about the axle, which is fixed (no Steiner term)
    )
    platform_mass_kg: float
    gravity: float  #: m/s^2
    effective_radius: Known  #: R_eff/R
    bearing_constant: Known  #: b0 of T_b = b0 + b1 |w| + bN N, N m
    bearing_viscous: Known  #: b1, N m s/rad
    bearing_load: Known  #: bN, N m/N
    rolling_resistance: Known  #: C_rr: moment C_rr N R
    roller_drag: Known  #: mu_a: axial drag F_a = mu_a N of the free rollers
    rail_constant: Known  #: c0 of F_rail = c0 + c_N (|N - m g| + |F_y|) + c_v V, N
    rail_load: Known  #: c_N
    rail_viscous: Known  #: c_v, N s/m
    #: Rise of N per metre of travel, relative, on rails that are not parallel; 1/m. The scale at
    #: both ends of the travel shows it.
    load_rise: Known = UNKNOWN_RISE


class Severity(Enum):
    """Whether a flagged run still gives a number."""

    NOTE = "note"  #: used, and reported
    EXCLUDED = "excluded"  #: shown with its reason; enters no maximum, no curve, no trend


@dataclass(frozen=True)
class Flag:
    """The reason why a run is not as it should be: a code for programs, a sentence for people."""

    code: str  #: such as peak_at_edge, negative_torque, no_pre_trigger, rubbing
    reason: str
    severity: Severity = Severity.EXCLUDED

    def shape(self) -> dict[str, object]:
        """Return the fields of the JSON object."""
        return {
            "code": self.code,
            "reason": self.reason,
            "severity": self.severity,
            "excluded": self.severity is Severity.EXCLUDED,
        }


@dataclass(frozen=True)
class RunOn:
    """How far platform and wheel went beyond the stop; NaN for what the recording does not show.

    Positions are those of the converted channels, by which the procedure stops a run.
    """

    stop_travel_m: float = math.nan  #: where the platform was as the relay was commanded to open
    stop_speed_m_s: float = math.nan  #: of the platform then
    threshold_m: float = math.nan  #: travel at which the relay is to open
    final_travel_m: float = math.nan  #: the farthest that the platform went
    final_turning_rad: float = math.nan  #: where the wheel came to rest
    turning_limit_rad: float = math.nan  #: where it is to have come to rest
    at_rest: bool = False  #: whether both stood still at the end of what was recorded

    @property
    def by_travel(self) -> bool:
        """Whether the travel stopped the run; if not, the wheel's turning or the time did."""
        return self.stop_travel_m >= self.threshold_m

    @property
    def overshoot_m(self) -> float:
        """Travel beyond the threshold at the command; NaN if another condition stopped the run."""
        return self.stop_travel_m - self.threshold_m if self.by_travel else math.nan

    @property
    def overshoot_s(self) -> float:
        """Time since the platform passed the threshold: overshoot over speed (angle.md 4.6)."""
        return self.overshoot_m / self.stop_speed_m_s if self.stop_speed_m_s > 0.0 else math.nan

    def shape(self) -> dict[str, object]:
        """Return the fields of the JSON object."""
        unknown = math.isnan(self.stop_travel_m) or math.isnan(self.threshold_m)
        stopped_by = "travel" if self.by_travel else "other"
        return {
            "stopped_by": None if unknown else stopped_by,
            "travel_at_stop_m": self.stop_travel_m,
            "speed_at_stop_m_per_s": self.stop_speed_m_s,
            "threshold_m": self.threshold_m,
            "overshoot_m": self.overshoot_m,
            "overshoot_s": self.overshoot_s,
            "final_travel_m": self.final_travel_m,
            "final_turning_rad": self.final_turning_rad,
            "turning_limit_rad": self.turning_limit_rad,
            "at_rest": self.at_rest,
        }


@dataclass(frozen=True, eq=False)
class AngleRun:
    """One run: raw volts over the time since the relay COMMAND; negative times are pre-trigger.

    The signals have shape (n,); ``stop_s`` is the time of the stop command. ``load_n`` is the
    normal force N that the scale showed before the start, NaN if it showed none that was
    stable. A run whose recording is not whole is still a run: its arrays may be empty, and
    ``flags`` has the reason.
    """

    label: str
    set_name: str  #: such as clean_45
    alpha_rad: float  #: between rolling direction and movement
    announced_load_kg: float  #: what the answer to the prompt was, else what was planned
    voltage_v: float
    repeat: int
    t_s: FloatArray
    gauge_a_v: FloatArray
    gauge_b_v: FloatArray
    wheel_v: FloatArray
    platform_v: FloatArray
    stop_s: float
    load_n: float
    load_stable: bool = True  #: whether the scale's reading had come to rest
    normal_force_v: FloatArray | None = None
    wheel: str = ""  #: which wheel ran, such as clean; the sets of one wheel make a trend
    number: int = 0  #: of the trial
    recording: str = ""
    planned_load_kg: float = math.nan  #: NaN if it is the one announced
    flags: tuple[Flag, ...] = ()  #: what is wrong with the run by its recording, such as incomplete
    run_on: RunOn = field(default_factory=RunOn)

    @property
    def cell(self) -> tuple[str, float, float]:
        """Set, planned load in kg and voltage in V: which runs repeat each other."""
        load_kg = self.planned_load_kg
        if math.isnan(load_kg):
            load_kg = self.announced_load_kg
        return self.set_name, load_kg, self.voltage_v


@dataclass(frozen=True)
class KnownRun:
    """A run, the calibration it is evaluated under, and the rig as it was in that run.

    The recordings of one campaign may have been made under several calibrations, each its own.
    """

    run: AngleRun
    calibration: AngleCalibration
    rig: AngleRig


@dataclass(frozen=True)
class SetReference:
    """A published maximum of one set, printed beside ours and never used."""

    label: str
    values: dict[str, float] = field(default_factory=dict)  #: by set name
