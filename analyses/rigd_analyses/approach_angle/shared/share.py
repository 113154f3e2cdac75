"""Finds a gauge, or a potentiometer, that shows more or less than when it was calibrated.

Gauge a rises by as much as gauge b falls: its share of their difference is a half, as far as both
amplifiers have one gain. A gauge that comes off its shaft, or an amplifier that was turned, moves
the share: a gain of (1 + x) gives (1 + x)/(2 + x), and the torque is wrong by x/2.

The load bends the shaft, which adds to both gauges alike, once per turn. The mean m of both over a
run, from rest to the stop, is therefore fitted by

    m = m_0 + (share - 1/2) d + c cos(k theta) + s sin(k theta)

with d their difference and theta the wheel's angle since the start: at rest d is 0, in the run
theta goes round. The shaft bends once per turn of the wheel, whatever its potentiometer shows: k is
the true turn over the one shown. If k is not 1 the potentiometer's scale is wrong, or the supply of
all sensors is another one, and the torque is then wrong by as much (Gauss-Newton from k = 1).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.stats import median_abs_deviation

from rigd_analyses.approach_angle.better.settings import BetterSettings
from rigd_analyses.approach_angle.raw.run_data import FloatArray, Known, KnownRun
from rigd_analyses.approach_angle.run_result import RunResult
from rigd_analyses.approach_angle.shared_error import SIGNIFICANT, SharedError

#: Fewer runs do not show how the share scatters.
MIN_RUNS: Final = 4
#: Samples are averaged over so long, s; a turn takes 140 ms or more.
BLOCK_S: Final = 0.005
#: Fewer turns of the wheel do not separate bending from torque.
LEAST_TURN_RAD: Final = 2.0 * math.pi
#: From 10 % off this many steps find k to 5e-5.
STEPS: Final = 3


@dataclass(frozen=True)
class Shown:
    """What the mean of both gauges shows in one run."""

    share: Known  #: of gauge a in the torque; u is from the fit
    turn: float  #: true turn of the wheel over the one that the potentiometer shows


def shown(known: KnownRun) -> Shown | None:
    """Return what a run shows; None if it has no rest before it, or less than one turn."""
    run = known.run
    used = run.t_s <= run.stop_s
    if np.count_nonzero(used) < 100 or run.t_s[0] > -BLOCK_S:
        return None
    t_s = run.t_s[used]
    size = max(1, int(np.searchsorted(t_s, t_s[0] + BLOCK_S)))
    count = t_s.size // size

    def means(volts: FloatArray) -> FloatArray:
        return np.asarray(volts[used][: count * size].reshape(count, size).mean(axis=1))

    a, b = means(run.gauge_a_v), means(run.gauge_b_v)
    theta = known.calibration.wheel.value * means(run.wheel_v)
    if not np.all(np.isfinite(a + b + theta)) or np.ptp(theta) < LEAST_TURN_RAD:
        return None
    theta -= theta[0]
    target, k = 0.5 * (a + b), 1.0
    plain = np.column_stack([np.ones_like(a), a - b, np.cos(theta), np.sin(theta)])
    c, s = np.linalg.lstsq(plain, target, rcond=None)[0][2:]
    for _ in range(STEPS):
        cos, sin = np.cos(k * theta), np.sin(k * theta)
        basis = np.column_stack([plain[:, :2], cos, sin, theta * (s * cos - c * sin)])
        found, _, rank, _ = np.linalg.lstsq(basis, target, rcond=None)
        if rank < basis.shape[1] or count <= basis.shape[1]:
            return None
        (c, s), k = found[2:4], k + float(found[4])
    left = target - basis @ found
    variance = float(left @ left) / (count - basis.shape[1])
    u = np.sqrt(variance * np.diag(np.linalg.inv(basis.T @ basis)))
    return Shown(Known(0.5 + float(found[1]), float(u[1])), k)


def gauge_errors(known: Sequence[KnownRun], results: Sequence[RunResult]) -> list[SharedError]:
    """Return a wrong share of a gauge and a wrong turn of the wheel, as far as runs show them."""
    found = [
        (k, item)
        for k, result in zip(known, results, strict=True)
        if not result.excluded and result.better.balance is not None
        if (item := shown(k)) is not None and item.share.u > 0.0
    ]
    sets = dict.fromkeys(k.run.set_name for k in known)
    return [*_turn_error(found, sets), *_share_error(found, sets)]


def _turn_error(
    found: Sequence[tuple[KnownRun, Shown]], sets: Iterable[str]
) -> Iterator[SharedError]:
    if len(found) < MIN_RUNS:
        return
    turns = np.array([item.turn for _, item in found])
    size = float(np.median(turns)) - 1.0
    spread = median_abs_deviation(turns, scale="normal") / math.sqrt(len(turns))
    wheel = found[0][0].calibration.wheel
    u = math.hypot(wheel.u / wheel.value, BetterSettings.linearity_u, spread)
    if abs(size) < SIGNIFICANT * u:
        return
    sentence = (
        f"The shaft bends once in {1.0 / (1.0 + size):.3f} turns that the wheel's potentiometer "
        f"shows: it shows {abs(size):.1%} (± {2 * u:.1%}) too {'little' if size > 0 else 'much'}. "
        "Its scale is wrong, or gauges and potentiometers are not of one time, or the supply of "
        "all sensors, with which the torque is wrong by as much. The intervals are widened for it."
    )
    yield SharedError("wheel_turn", sentence, size, u, "1", dict.fromkeys(sets, abs(size)))


def _share_error(
    found: Sequence[tuple[KnownRun, Shown]], sets: Iterable[str]
) -> Iterator[SharedError]:
    """Yield the set in which the share is farthest from the known one; none if it is near."""
    by_set: dict[str, list[tuple[float, float, KnownRun]]] = {}  # share, u, run
    for k, item in found:
        by_set.setdefault(k.run.set_name, []).append((item.share.value, item.share.u, k))
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
        return
    _, mean, u, name = worst
    # All sets have the same gauges: where fewer runs show the share the error is there, too.
    effect = dict.fromkeys(sets, max(effect.values()))
    reference = by_set[name][0][2].calibration.gauge_share.value
    low = "a" if mean < reference else "b"
    sentence = (
        f"Gauge a shows {mean:.1%} of the torque in {name}, {reference:.1%} were to be expected "
        f"(± {2 * u:.1%}): gauge {low} has lost gain (it comes off the shaft, or its amplifier "
        "was turned), or the other has gained. The intervals are widened for it."
    )
    yield SharedError("gauge_share", sentence, mean - reference, u, "1", effect)


def _gain(share: float) -> float:
    """Return the gain of gauge a over that of gauge b, less 1."""
    return share / (1.0 - share) - 1.0
