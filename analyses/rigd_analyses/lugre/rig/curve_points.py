"""Computes points of the friction curve from the measured acceleration, to plot beside the fit.

Slip and all terms besides g are those of the fit. The residual of the acceleration is m/F_N of it,
smoothed as method A smooths it; without that, the noise of the accelerometer hides everything.
"""

from __future__ import annotations

import numpy as np

from rigd.analysis.result import Seen
from rigd_analyses.lugre.curve import SLIDING, in_ranges
from rigd_analyses.lugre.model import friction
from rigd_analyses.lugre.rig import kernel
from rigd_analyses.lugre.rig.outputs import ACCELERATION
from rigd_analyses.lugre.rig.standard_errors import FRICTION, RigIdentification, all_states, slip
from rigd_analyses.lugre.trials.slip_and_traction import Guards, smooth, window_samples


def seen(found: RigIdentification) -> tuple[Seen, ...]:
    """Return g plus the residual of the measured traction, in ranges of the fitted slip."""
    system, theta, guards = found.family.system, found.theta[:FRICTION], Guards()
    window = window_samples(guards, system.period_s)
    share = system.constants.mass.value / system.constants.normal_force_n
    sizes, shown = [], []
    states = all_states(system, found.whole)
    for driven, error, state in zip(system.trials, found.whole.errors, states, strict=True):
        speed = slip(system, found.whole, state)
        g = friction(theta, np.abs(speed))
        away = -share * smooth(error[:, ACCELERATION], window, guards.order)
        # What the filter reaches across a jump of the current is no friction.
        near = np.convolve(driven.jumps, np.ones(window), mode="same") > 0.0
        inside = (np.abs(state[:, kernel.BRISTLE]) >= SLIDING * g) & ~near
        sizes.append(np.abs(speed)[inside])
        shown.append((g + np.sign(speed) * away)[inside])
    return in_ranges(np.concatenate(sizes), np.concatenate(shown), found.visited)
