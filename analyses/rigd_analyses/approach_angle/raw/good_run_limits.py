"""Defines the limits between a good and a bad run of the approach-angle rig."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Limits:
    """The limits between a good and a bad run.

    ``pre_trigger_s`` 0 accepts records that have none, as the paper's own. ``early_s``: signs are
    judged this long after the command. ``torque_nm``: the least mean torque until then that counts
    as one (good runs show 0.4 N m or more, the zero drifts by 0.02 N m). ``zero_nm``: the most that
    the gauges may show before the command (drift and bending: 0.06 N m). ``gauge_share``: the
    least part of it that either gauge must see (a half each, if bending does not reach them).
    ``wheel_rad``, ``platform_m``: less movement than this is none, over the first 100 ms and over
    each later eighth of the run (good runs: at least 0.4 rad and 8 mm). ``gauge_noise_v``,
    ``pot_noise_v``: the most noise of a sample (good signals: 16 mV and 1.5 mV). ``pot_v_per_s``:
    the fastest a potentiometer can move (good runs: 15 V/s, the platform at 2.8 m/s).
    """

    pre_trigger_s: float = 0.05
    shortest_s: float = 0.15  #: good runs take 0.3 to 0.7 s, less if stopped too early
    gap: float = 1.5  #: of the usual time between samples
    rail_v: float = 9.99  #: of the converter's +-10 V
    watchdog_s: float = 1.4  #: the procedure's own is 1.5 s
    #: Scale against the load that was announced, relative: the rule by which the prompt of
    #: ``approach_angles`` agrees; bolts and scale scatter by 1 %, loads differ by 20 %.
    load: float = 0.05
    early_s: float = 0.1
    torque_nm: float = 0.05
    zero_nm: float = 0.15
    gauge_share: float = 0.15
    wheel_rad: float = 0.1
    platform_m: float = 0.002
    gauge_noise_v: float = 0.1
    pot_noise_v: float = 0.02
    pot_v_per_s: float = 35.0
    turns: float = 10.0  #: of either potentiometer (paper)
    end_share: float = 0.01  #: of their range, at both ends
    wheel_room_rad: float = 8.0 * math.pi  #: four turns, what a spinning run may take
    platform_room_m: float = 0.35  #: travel to the stop, and overshoot
