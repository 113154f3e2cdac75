"""Defines the result of the corrected method for one run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from rigd_analyses.approach_angle.budget import Budget
from rigd_analyses.approach_angle.raw.run_data import (
    Coefficient,
    Flag,
    FloatArray,
    Regime,
    Severity,
)

BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Blocks:
    """Means over short blocks of the driven part of a run; arrays of shape (n,), maybe empty.

    ``mu`` is F_r/N: the friction limit if ``sliding``, else only what the motion demanded.
    """

    t_s: FloatArray  #: middle of the block, since the relay command
    sliding_speed_m_s: FloatArray  #: v_r = R_eff w - V cos(alpha)
    mu: FloatArray
    normal_force_n: FloatArray
    travel_m: FloatArray  #: of the platform since the start
    sliding: BoolArray

    @classmethod
    def none(cls) -> Blocks:
        """Return no blocks at all, as of a run that cannot be evaluated."""
        empty = np.empty(0)
        return cls(empty, empty, empty, empty, empty, np.empty(0, dtype=np.bool_))


@dataclass(frozen=True, eq=False)
class Smoothed:
    """Signals for a plot, shape (n,), from the pre-trigger samples to past the stop."""

    t_s: FloatArray
    torque_nm: FloatArray  #: at the gauges, unfiltered
    wheel_angle_rad: FloatArray
    wheel_speed_rad_s: FloatArray
    wheel_acceleration_rad_s2: FloatArray
    platform_position_m: FloatArray
    platform_speed_m_s: FloatArray
    platform_acceleration_m_s2: FloatArray


@dataclass(frozen=True)
class BalanceRow:
    """Means over the steady blocks of one run, by which errors that all runs share are found."""

    residual_n: float  #: F_gauge - force that the motion needs
    normal_n: float
    torque_nm: float  #: at the gauges
    force_n: float  #: F_r by the gauges
    wheel_speed_rad_s: float
    platform_speed_m_s: float
    push_n: float  #: m a of the platform
    on_rails_n: float  #: |N - m g| + |F_y|
    push_u_n: float  #: what m a is uncertain by: the speeds at both ends


@dataclass(frozen=True)
class BetterRun:
    """One run; a number that cannot be computed is NaN, a flag gives the reason; ``u`` are k = 1.

    ``mu`` is the mean of F_r/N over the blocks in which the wheel slides, a friction limit in the
    rolling direction; ``mu_u`` is its uncertainty for this very run, without what varies from run
    to run. ``demand`` is the mean over all steady blocks and never a limit. ``tare_v``
    is the zero of (gauge a - gauge b) seen before the trigger, whether it was taken off or not.
    """

    coefficient: ClassVar[Coefficient] = Coefficient.ROLLING

    mu: float
    mu_u: float
    demand: float
    torque_nm: float  #: at the gauges, over the blocks of ``mu``, or of ``demand`` if it rolls
    normal_force_n: float  #: over the same blocks
    sliding_speed_m_s: float  #: over the same blocks
    slip: float  #: (w R - V)/V as the paper defines it, from means; with the nominal R
    slip_corrected: float  #: w R/(V cos(alpha)) - 1, from means over the steady part
    slip_corrected_u: float
    relative_speed_m_s: float  #: mean of w R - V over the steady part
    regime: Regime | None  #: None if the run cannot be evaluated
    blocks: Blocks
    force_residual: float  #: (F_gauge - force that the motion needs)/N
    force_residual_limit: float  #: beyond it the run is ``rubbing``, or its ``torque_missing``
    tare_v: float
    flags: tuple[Flag, ...] = ()
    curves: Smoothed | None = None
    budget: Budget | None = None  #: of ``mu``
    balance: BalanceRow | None = None

    def shape(self) -> dict[str, object]:
        """Return the fields of the JSON object; the curves stand in the recording."""
        return {
            "coefficient": self.coefficient,
            "mu": self.mu,
            "mu_u_k1": self.mu_u,
            "demand": self.demand,
            "torque_Nm": self.torque_nm,
            "normal_force_N": self.normal_force_n,
            "sliding_speed_m_per_s": self.sliding_speed_m_s,
            "slip": self.slip,
            "slip_corrected": self.slip_corrected,
            "slip_corrected_u_k1": self.slip_corrected_u,
            "relative_speed_m_per_s": self.relative_speed_m_s,
            "regime": self.regime,
            "sliding_blocks": np.count_nonzero(self.blocks.sliding),
            "blocks": self.blocks.sliding.size,
            "force_residual": self.force_residual,
            "force_residual_limit": self.force_residual_limit,
            "tare_V": self.tare_v,
        }

    @property
    def excluded(self) -> bool:
        """Whether this run enters no maximum, no curve, and no trend."""
        return any(flag.severity is Severity.EXCLUDED for flag in self.flags)
