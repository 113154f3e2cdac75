"""Fits the crosstalk of bending into the measured torque, from all runs of a campaign.

The load of the wheel bends the shaft. Gauges that are a degree off their 45 degrees measure a part
of the bending: N (c cos(theta) + s sin(theta)) in N m, once per turn of the shaft. c and s are the
same in every run, because gauges and potentiometer are on the same shaft. The angle theta is
absolute, because the potentiometer does not wrap. A tare before the trigger contains the crosstalk
at the start angle. For this reason a tare alone makes the clean 0 degree runs worse (11.4 instead
of 11.0 % rms, angle.md 3.4). If c and s are known, zero drift and crosstalk can both be removed.

The other torque of a steadily sliding wheel is smooth over a run: N times a constant, a slope over
the logarithm of the sliding speed, and a slope over the time, which includes the inertia. The
module does not use the measured acceleration: a potentiometer error of 8 mrad once per turn gives
a false 5 mN m, also once per turn. Each run has its own three smooth terms. The module projects
them out and fits c and s to the rest of all runs, by least squares with Huber weights per run. On
simulated rigs an error of 1 % of mu remains at the weakest runs; a zero alone leaves 3 %. The fit
would take a friction that varies once per turn of the wheel itself for crosstalk.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rigd.analysis.fitting.fit import HUBER_K
from rigd_analyses.approach_angle.better.forces import bearing_torque
from rigd_analyses.approach_angle.better.motion import Means, Motion
from rigd_analyses.approach_angle.better.result import BoolArray
from rigd_analyses.approach_angle.raw.run_data import FloatArray

NUISANCE = 3  #: smooth terms of each run
START_S = 0.16  #: the load still swings from the start before, in step with the wheel's angle
#: The spread between runs times this is the uncertainty: what all runs have in common (the same
#: start, the same angle) makes the true error of c and s three times their spread.
IN_COMMON = 3.0
MIN_RUNS = 8  #: fewer do not separate what runs have in common from chance
ITERATIONS = 10


@dataclass(frozen=True)
class Bending:
    """Crosstalk N (c cos + s sin) with the standard uncertainty of either coefficient, m.

    ``zero_u_nm`` is the spread of the gauges' zeros before the triggers once the crosstalk is off
    them: how far the amplifiers drift between two runs. NaN without pre-trigger samples.
    """

    c: float
    s: float
    u: float
    runs: int  #: that it was fitted to
    zero_u_nm: float

    def torque(self, turn: FloatArray, normal_n: FloatArray | float) -> FloatArray:
        """Return the crosstalk in N m at a wheel angle of (cos, sin) = ``turn`` (..., 2)."""
        return np.asarray((self.c * turn[..., 0] + self.s * turn[..., 1]) * normal_n)

    @property
    def amplitude(self) -> float:
        """N m of crosstalk per N of load."""
        return float(np.hypot(self.c, self.s))


@dataclass(frozen=True, eq=False)
class Sample:
    """One run, and a mask of its blocks in which the wheel slides, (n,)."""

    motion: Motion
    sliding: BoolArray


def fit_bending(samples: Sequence[Sample]) -> Bending | None:
    """Return the crosstalk common to the runs, or None if they do not determine it."""
    pieces = [p for p in map(_projected, samples) if p is not None]
    if len(pieces) < MIN_RUNS:
        return None
    weights = np.ones(len(pieces))
    normals = np.array([x.T @ x for x, _ in pieces])
    moments = np.array([x.T @ y for x, y in pieces])
    for _ in range(ITERATIONS):
        information = np.tensordot(weights, normals, 1)
        if np.linalg.cond(information) > 1e6:
            return None
        found = np.linalg.solve(information, weights @ moments)
        rest = np.array([np.sqrt(np.mean((y - x @ found) ** 2)) for x, y in pieces])
        weights = np.minimum(1.0, HUBER_K * np.median(rest) / np.maximum(rest, 1e-300))
    scores = weights[:, None] * (moments - normals @ found)
    inverse = np.linalg.inv(information)
    spread = inverse @ (scores.T @ scores) @ inverse * len(pieces) / (len(pieces) - 2)
    c, s = (float(v) for v in found)
    bending = Bending(
        c, s, IN_COMMON * float(np.sqrt(np.trace(spread) / 2.0)), len(pieces), float("nan")
    )
    return replace(bending, zero_u_nm=_spread_of_zeros(samples, bending))


def _spread_of_zeros(samples: Sequence[Sample], bending: Bending) -> float:
    zeros = np.array(
        [
            s.motion.known.calibration.torque.value * s.motion.tare_v
            - bending.torque(s.motion.start_turn, s.motion.start_normal_n)
            for s in samples
            if np.isfinite(s.motion.tare_v)
        ]
    )
    if zeros.size < MIN_RUNS:
        return float("nan")
    return 1.4826 * float(np.median(np.abs(zeros - np.median(zeros))))


def _projected(sample: Sample) -> tuple[FloatArray, FloatArray] | None:
    """Return basis (m, 2) and torque (m,) of the sliding blocks, the smooth terms taken out."""
    means, known = sample.motion.means, sample.motion.known
    at = sample.sliding & (means.t_s >= START_S)
    if np.count_nonzero(at) < NUISANCE + 3:
        return None
    torque = known.calibration.torque.value * means.gauges_v - bearing_torque(means, known.rig)
    basis = _smooth_terms(means)[at]
    both = np.column_stack([means.turn * means.normal_force_n[:, None], torque])[at]
    left = both - basis @ np.linalg.lstsq(basis, both, rcond=None)[0]
    return np.asarray(left[:, :2]), np.asarray(left[:, 2])


def _smooth_terms(means: Means) -> FloatArray:
    speed = np.log(np.maximum(means.sliding_speed_m_s, 1e-3))
    columns = np.column_stack([np.ones_like(speed), speed, means.t_s])
    return np.asarray(means.normal_force_n[:, None] * columns)
