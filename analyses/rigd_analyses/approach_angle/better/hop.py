"""Finds runs in which the contact is unloaded again and again: the wheel hops.

A sliding wheel takes a torque in proportion to its load. Rollers that stand out lift it off the
ground once each passage: the torque falls to almost nothing for some milliseconds. Means over
blocks hide that, and friction then stands for a contact that is open for a part of the time.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from rigd_analyses.approach_angle.better.motion import Motion
from rigd_analyses.approach_angle.better.result import BoolArray

#: Torque is averaged over so long, s: 11 mN m of noise are left, and a passage of a roller takes
#: 8 ms at 45 rad/s.
MEAN_S: Final = 0.0017
#: Below this share of its mean the torque shows a contact without load. Good runs stay above 0.6,
#: a contact that loses half of its load above 0.4.
UNLOADED: Final = 0.3
#: More of the time than this is hop, and no chance.
MOST_SHARE: Final = 0.02


def unloaded_share(motion: Motion, sliding: BoolArray, block_s: float) -> float:
    """Return in which share of the ``sliding`` blocks (n,) the contact is unloaded; 0 of none."""
    run = motion.known.run
    volts = run.gauge_a_v - run.gauge_b_v
    if math.isfinite(motion.tare_v):
        volts = volts - motion.tare_v
    size = max(1, round(MEAN_S / motion.period_s))
    count = volts.size // size
    means = volts[: count * size].reshape(count, size).mean(axis=1)
    times = run.t_s[: count * size].reshape(count, size).mean(axis=1)
    used = np.zeros(count, dtype=np.bool_)
    for middle in motion.means.t_s[sliding]:
        used |= np.abs(times - middle) <= 0.5 * block_s
    if not np.any(used):
        return 0.0
    level = float(np.mean(means[used]))
    return float(np.mean(means[used] / level < UNLOADED)) if level else 0.0
