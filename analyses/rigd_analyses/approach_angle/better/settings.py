"""Defines the settings of the corrected method, each with the reason for its value."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from rigd_analyses.approach_angle.raw.good_run_limits import Limits


@dataclass(frozen=True)
class BetterSettings:
    """Settings of the method, and assumed sizes of the effects that are not measured on this rig.

    Smoother: half-gain frequencies of wheel angle and platform position, after which the rim speed
    is known to 3 mm/s; the paper's filter gives 7.

    Blocks: 20 ms, one period of the mains, so that its hum leaves every mean.

    Slip gate: a block counts as sliding when its corrected slip is at least that of
    :mod:`rigd_analyses.approach_angle.regime`, its sliding speed at least ``sliding_speed_m_s``
    (ten times what the speeds are uncertain by), and after the contact has slid
    ``sliding_distance_m`` since the start, by which the breakaway peak has passed. A run with fewer
    than ``min_sliding_blocks`` gives no coefficient.

    Force balance: a residual above ``balance_coverage`` times what it is uncertain by is rubbing;
    3 leaves 0.3 % of good runs to chance.

    Standard uncertainties (k = 1) that neither a calibration nor the data give; assumed. Tilting
    and settling are sizes instead: nothing corrects N for them, and each may lie between 0 and
    twice its size.
    """

    wheel_cutoff_hz: float = 14.0
    platform_cutoff_hz: float = 16.0
    smoothed_hz: float = 960.0  #: samples are averaged to about this rate, far above both cut-offs
    block_s: float = 0.020
    start_s: float = 0.080  #: first steady block: relay, backlash and breakaway are over
    min_tare_s: float = 0.040  #: two periods of the mains
    sliding_speed_m_s: float = 0.05
    sliding_distance_m: float = 0.040
    min_sliding_blocks: int = 2
    balance_coverage: float = 3.0
    zero_u_v: float = 0.006  #: of (gauge a - gauge b), until a campaign shows its spread
    crosstalk_m: float = 0.0005  #: N m per N of load, likewise: two gauges a degree off
    inertia_u: float = 0.05  #: relative, of the wheel's moment of inertia (a drawing's)
    tilting: float = 0.02  #: rise of N over the traction, as the platform tilts (angle.yaml, k_F)
    settling: float = 0.01  #: relative loss of N as the ground settles (angle.yaml, relax)
    settling_s: float = 0.2  #: its time constant (angle.yaml, tau_relax)
    load_reading_u_n: float = 0.1  #: of one reading of the scale: resolution and noise, 10 g
    vibration_u: float = 0.001  #: relative, what the rollers' vibration of N leaves in a mean
    linearity_u: float = 0.005  #: of a speed, relative: a potentiometer's linearity over a turn
    angle_u_rad: float = math.radians(0.2)  #: of the mounted approach angle
    scatter_u: float = 0.015  #: relative, between equal runs, until a campaign shows it
    limits: Limits = field(default_factory=Limits)  #: bounds of a good raw run
