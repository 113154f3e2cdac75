"""Finds a gauge that shows more or less of the torque than it did when it was calibrated.

Gauge a rises by as much as gauge b falls: its share of their difference is a half, as far as both
amplifiers have one gain. A gauge that comes off its shaft, or an amplifier that was turned, moves
the share: a gain of (1 + x) gives (1 + x)/(2 + x), and the torque is wrong by x/2.

The load bends the shaft, which adds to both gauges alike, once per turn. The mean m of both over a
run, from rest to the stop, is therefore fitted by

    m = m_0 + (share - 1/2) d + N (c cos(theta) + s sin(theta))

with d their difference and theta the wheel's angle: at rest d is 0, in the run theta goes round.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from rigd_analyses.approach_angle.data import FloatArray, KnownRun
from rigd_analyses.approach_angle.result import RunResult
from rigd_analyses.approach_angle.shared.result import SIGNIFICANT, SharedError

#: Fewer runs do not show how the share scatters.
MIN_RUNS: Final = 4
#: Samples are averaged over so long, s; a turn takes 140 ms or more.
BLOCK_S: Final = 0.005
#: Fewer turns of the wheel do not separate bending from torque.
LEAST_TURN_RAD: Final = 2.0 * math.pi


def gauge_share(known: KnownRun) -> tuple[float, float]:
    """Return the share of gauge a in the torque, and its standard uncertainty from the fit.

    NaN if the run has no rest before it, or less than one turn.
    """
    run = known.run
    used = run.t_s <= run.stop_s
    if np.count_nonzero(used) < 100 or run.t_s[0] > -BLOCK_S:
        return math.nan, math.nan
    t_s = run.t_s[used]
    size = max(1, int(np.searchsorted(t_s, t_s[0] + BLOCK_S)))
    count = t_s.size // size

    def means(volts: FloatArray) -> FloatArray:
        return np.asarray(volts[used][: count * size].reshape(count, size).mean(axis=1))

    a, b = means(run.gauge_a_v), means(run.gauge_b_v)
    theta = known.calibration.wheel.value * means(run.wheel_v)
    if not np.all(np.isfinite(a + b + theta)) or np.ptp(theta) < LEAST_TURN_RAD:
        return math.nan, math.nan
    basis = np.column_stack([np.ones_like(a), a - b, np.cos(theta), np.sin(theta)])
    target = 0.5 * (a + b)
    found, _, rank, _ = np.linalg.lstsq(basis, target, rcond=None)
    if rank < basis.shape[1] or count <= basis.shape[1]:
        return math.nan, math.nan
    left = target - basis @ found
    variance = float(left @ left) / (count - basis.shape[1])
    u = math.sqrt(variance * float(np.linalg.inv(basis.T @ basis)[1, 1]))
    return 0.5 + float(found[1]), u


def share_errors(known: Sequence[KnownRun], results: Sequence[RunResult]) -> list[SharedError]:
    """Return the set in which the share is farthest from the known one; none if it is near."""
    by_set: dict[str, list[tuple[float, float, KnownRun]]] = {}  # share, u, run
    for k, result in zip(known, results, strict=True):
        if result.excluded or result.better.balance is None:
            continue
        share, u = gauge_share(k)
        if math.isfinite(share) and u > 0.0:
            by_set.setdefault(k.run.set_name, []).append((share, u, k))
    worst: tuple[float, float, float, str] | None = None
    effect: dict[str, float] = {}
    for name, items in by_set.items():
        if len(items) < MIN_RUNS:
            continue
        weights = np.array([u**-2 for _, u, _ in items])
        shares = np.array([share for share, _, _ in items])
        mean = float(np.average(shares, weights=weights))
        spread = float(np.average((shares - mean) ** 2, weights=weights))
        calibrated = items[0][2].calibration.gauge_share
        u = math.hypot(calibrated.u, math.sqrt(spread / (len(items) - 1)))
        z = abs(mean - calibrated.value) / u if u > 0.0 else 0.0
        if z >= SIGNIFICANT:
            effect[name] = abs(_gain(mean) - _gain(calibrated.value)) / 2.0
        if worst is None or z > worst[0]:
            worst = (z, mean, u, name)
    if worst is None or worst[0] < SIGNIFICANT:
        return []
    _, mean, u, name = worst
    # All sets have the same gauges: where fewer runs show the share the error is there, too.
    effect = dict.fromkeys((k.run.set_name for k in known), max(effect.values()))
    reference = by_set[name][0][2].calibration.gauge_share.value
    low = "a" if mean < reference else "b"
    sentence = (
        f"Gauge a shows {mean:.1%} of the torque in {name}, {reference:.1%} were to be expected "
        f"(± {2 * u:.1%}): gauge {low} has lost gain (it comes off the shaft, or its amplifier "
        "was turned), or the other has gained. The intervals are widened for it."
    )
    return [SharedError("gauge_share", sentence, mean - reference, u, "1", effect)]


def _gain(share: float) -> float:
    """Return the gain of gauge a over that of gauge b, less 1."""
    return share / (1.0 - share) - 1.0
