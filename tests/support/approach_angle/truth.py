"""What a simulated run of the approach-angle rig really did, by the paper's definitions."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from support.approach_angle.headless import SimulatedRun

RADIUS_M = 0.05
#: Where the largest of a set's T/(R N) may lie relative to Table 1 (angle.md, acceptance target
#: 2): too large by inertia, drags and the choice of a maximum; nearer to 0 something is missing.
WINDOWS = {
    "clean_0": (0.09, 0.25),
    "clean_15": (0.08, 0.21),
    "clean_30": (0.03, 0.15),
    "clean_45": (0.01, 0.14),
    "coated_0": (0.0, 0.18),
}


@dataclass(frozen=True)
class Steady:
    """True means over a steady segment, up to the stop."""

    torque_nm: float  #: at the gauges
    mu: float  #: <F_r>/<N>
    slip: float  #: mean of (w R - V)/V, with the nominal R
    slip_corrected: float  #: <w R>/(<V> cos(alpha)) - 1
    inertia: float  #: I <dw/dt>/(R N), which T/(R N) takes for friction


def steady(run: SimulatedRun, from_s: float, wheel_inertia: float = 4e-4) -> Steady:
    """Return what happened from ``from_s`` to the stop."""
    at = run.window(from_s, run.stop_s)
    t_s, w = run.t_s[at], run.truth["wheel_speed"][at]
    speed, normal = run.truth["platform_speed"][at], run.truth["normal_force"][at]
    mean_acceleration = (w[-1] - w[0]) / (t_s[-1] - t_s[0])
    return Steady(
        torque_nm=float(np.mean(run.truth["torque"][at])),
        mu=run.true_mu(from_s, run.stop_s),
        slip=float(np.mean((RADIUS_M * w - speed) / speed)),
        slip_corrected=float(
            np.mean(RADIUS_M * w) / (np.mean(speed) * math.cos(run.alpha_rad)) - 1.0
        ),
        inertia=float(wheel_inertia * mean_acceleration / (RADIUS_M * np.mean(normal))),
    )


def slip_error(found: float, true: float) -> float:
    """Return the error of a slip relative to 1 + s, which is that of the ratio of speeds."""
    return (found - true) / (1.0 + true)
