"""Tests whether friction changes along the travel of the platform, in all runs by the same share.

Such a change is an error of the rig, for example a load that rises along the rails by more than the
calibration says. Friction itself depends on the sliding speed v. Runs of different voltages slide
at different speeds after the same travel x, so the two can be told apart: a change with the travel
is g in

    ln(F_r/N) = a + b log10(v) + c log10(v)^2 + g x

with a of each run, b and c of each set, and g (relative, per metre) of all runs. If the load N
rises by d (relative, per metre) more than is known, g is d. The covariance is the sandwich
estimator with one score per run, as that of the curve (:mod:`..curve`). The first 0.16 s, in which
the load swings and the breakaway fades, are left out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from rigd_analyses.approach_angle.better.bending import MIN_RUNS, START_S
from rigd_analyses.approach_angle.raw.run_data import FloatArray, KnownRun
from rigd_analyses.approach_angle.run_result import RunResult
from rigd_analyses.approach_angle.shared_error import SIGNIFICANT, SharedError

#: What a right rig has of g beside the spread between its runs, 1/m: the ground settles (-0.05 in
#: the mean of 32 simulated rigs).
RIGHT_U: Final = 0.05


@dataclass(frozen=True, eq=False)
class _Slide:
    """The sliding blocks of a run, (n,): log10 of the speed, ln of F_r/N, travel in m."""

    name: str
    log_v: FloatArray
    log_mu: FloatArray
    travel_m: FloatArray


def travel_errors(known: Sequence[KnownRun], results: Sequence[RunResult]) -> list[SharedError]:
    """Return what F_r/N changes by along the travel, if it is more than a right rig has."""
    slides = [slide for r in results if (slide := _slide(r)) is not None]
    if len(slides) < MIN_RUNS:
        return []
    size, spread = _slope(slides)
    u = math.hypot(spread, RIGHT_U, known[0].rig.load_rise.u)
    if abs(size) < SIGNIFICANT * u:
        return []
    travels: dict[str, list[float]] = {}
    for slide in slides:
        travels.setdefault(slide.name, []).append(float(np.mean(slide.travel_m)))
    effect = {name: abs(size) * float(np.mean(means)) for name, means in travels.items()}
    sentence = (
        f"Within all runs F_r/N {'rises' if size > 0.0 else 'falls'} by {abs(size):.0%} "
        f"(± {2 * u:.0%}) per metre of travel beside its change with the speed: the load rises "
        "otherwise along the rails than by the calibration, the gauges' zero moves in each run, or "
        "the times of samples are wrong. The intervals are widened for it."
    )
    return [SharedError("changes_in_run", sentence, size, u, "1/m", effect)]


def _slide(result: RunResult) -> _Slide | None:
    """Return the blocks of a run in which the wheel slides; None if there are fewer than two."""
    blocks = result.better.blocks
    used = blocks.sliding & (blocks.mu > 0.0) & (blocks.t_s >= START_S)
    if result.excluded or np.count_nonzero(used) < 2:
        return None
    return _Slide(
        result.run.set_name,
        np.log10(blocks.sliding_speed_m_s[used]),
        np.log(blocks.mu[used]),
        blocks.travel_m[used],
    )


def _slope(slides: Sequence[_Slide]) -> tuple[float, float]:
    """Return g and its standard uncertainty from the spread between runs, 1/m."""
    names = list(dict.fromkeys(slide.name for slide in slides))
    bases, targets = [], []
    for slide in slides:
        basis = np.zeros((slide.log_v.size, 2 * len(names) + 1))
        first = 2 * names.index(slide.name)
        basis[:, first], basis[:, first + 1] = slide.log_v, slide.log_v**2
        basis[:, -1] = slide.travel_m
        bases.append(basis - basis.mean(axis=0))
        targets.append(slide.log_mu - slide.log_mu.mean())
    whole = np.vstack(bases)
    found = np.linalg.lstsq(whole, np.concatenate(targets), rcond=None)[0]
    inverse = np.linalg.pinv(whole.T @ whole)
    scores = np.array([x.T @ (y - x @ found) for x, y in zip(bases, targets, strict=True)])
    factor = len(slides) / max(len(slides) - found.size, 1)
    covariance = factor * inverse @ (scores.T @ scores) @ inverse
    return float(found[-1]), math.sqrt(max(float(covariance[-1, -1]), 0.0))
