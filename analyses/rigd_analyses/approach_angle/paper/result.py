"""Defines the result of the paper's method for one run, with the curves of its Figs. 6 to 10."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from rigd_analyses.approach_angle.raw.run_data import (
    Coefficient,
    Flag,
    FloatArray,
    Regime,
    Severity,
)


@dataclass(frozen=True, eq=False)
class PaperCurves:
    """Every step of the method on one run; times since the relay command.

    Arrays of one length belong together: ``t_s`` with the gauges and the torque (n,),
    ``gaussian_t_s`` with ``gaussian_nm`` (the fit window), ``position_t_s`` with the positions
    (each side shorter by one smoothing), ``speed_t_s`` with the speeds (by two, and one sample).
    """

    t_s: FloatArray
    gauge_a_v: FloatArray  #: raw, as recorded
    gauge_b_v: FloatArray
    fourier_a_v: FloatArray  #: Eq. 7 fitted to them
    fourier_b_v: FloatArray
    torque_nm: FloatArray
    gaussian_t_s: FloatArray
    gaussian_nm: FloatArray
    platform_raw_m: FloatArray  #: over ``t_s``, unsmoothed; as the potentiometer's zero has it
    rim_raw_m: FloatArray  #: wheel angle times the nominal R
    position_t_s: FloatArray
    platform_m: FloatArray
    rim_m: FloatArray
    speed_t_s: FloatArray
    platform_speed_m_s: FloatArray  #: V
    rim_speed_m_s: FloatArray  #: w R


@dataclass(frozen=True)
class PaperRun:
    """One run by the paper's method; a missing number is NaN, and a flag gives the reason.

    ``mu`` = <T>/(R N) is what the paper calls friction coefficient in every run. It is one
    (:attr:`coefficient`) only in regime ``SLIDING``; a wheel that rolls shows the force that the
    motion demands, which is not the limit: see :attr:`friction_coefficient`.
    """

    coefficient: ClassVar[Coefficient] = Coefficient.ROLLING

    torque_nm: float  #: mean over the steady segment, from the Fourier curve
    mu: float
    slip: float  #: the paper's Eq. 12, mean of (w R - V)/V over the segment where V > 0
    slip_corrected: float  #: <w R>/(<V> cos(alpha)) - 1: 0 if the wheel rolls, at any angle
    relative_speed: float  #: Eq. 11, mean of w R - V in m/s
    sigma_s: float  #: of the Gaussian of Eq. 9
    h: float  #: its height, N m: the largest torque
    p: float  #: its place, s since the relay command
    t_steady_s: float  #: p + 2 sigma, begin of the steady segment
    regime: Regime | None  #: None if the run cannot be evaluated
    flags: tuple[Flag, ...] = ()
    curves: PaperCurves | None = None

    def shape(self) -> dict[str, object]:
        """Return the fields of the JSON object; the curves stand in the recording."""
        return {
            "coefficient": self.coefficient,
            "mu": self.mu,
            "torque_Nm": self.torque_nm,
            "slip": self.slip,
            "slip_corrected": self.slip_corrected,
            "relative_speed_m_per_s": self.relative_speed,
            "sigma_s": self.sigma_s,
            "peak_torque_Nm": self.h,
            "peak_time_s": self.p,
            "steady_from_s": self.t_steady_s,
            "regime": self.regime,
        }

    @property
    def excluded(self) -> bool:
        """Whether a flag excludes this run."""
        return any(flag.severity is Severity.EXCLUDED for flag in self.flags)

    @property
    def friction_coefficient(self) -> float:
        """``mu`` if the wheel slid all through the steady segment, else NaN."""
        return self.mu if self.regime is Regime.SLIDING else float("nan")
