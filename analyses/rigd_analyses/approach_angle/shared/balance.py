"""Finds what the signed residuals of the force balance have in common.

The residual of a run is E = F_gauge - F_needed in N (:mod:`..better.balance`). What the rig is
known by is uncertain in all runs alike, and each uncertainty makes a residual of its own shape.
With rho R the effective radius, x true less known:

    b0, b1, bN, C_rr: (1, w, N, N R) x/(rho R)    rho: F x/rho    torque scale: T x/(rho R)
    c0, c_N, c_v: (1, N_rails, V) x/cos(alpha)    mu_a: N tan(alpha) x    travel: m a x/cos(alpha)

The residuals therefore have the covariance V = S + X U X', with S the scatter of single runs. An
error d with the shape c has the generalised least-squares estimate

    d = c' V^-1 E/(c' V^-1 c),   u(d) = (c' V^-1 c)^-1/2

If the residuals scatter more than V about the error, S is as many times larger as makes their
chi^2 that of n - 1 degrees of freedom (Paule and Mandel, J. Res. NBS 87, 1982): what the equations
leave out is scatter of single runs, so that an error is the better known the more runs there are.

The m candidates and "none of them" have the weights exp(d^2/(2 u(d)^2) - 1)/m and 1, over their
sum (Akaike's: Burnham and Anderson, Model Selection and Multimodel Inference, 2002, 2.9; before the
data, one of the candidates is as likely as none). The maximum of a set is uncertain by the effects
of d and u(d), each with its weight: what the balance only just misses at this number of runs is so
in the interval. If one is significant, each that explains the data as well (:data:`AS_GOOD`) is
there whole: rails that brake and torque that is lost differ by 1/cos(alpha) only, and shapes that
are only nearly right do not tell them apart.

Runs that the balance alone has excluded are part of the evidence: an error that is the same in all
runs excludes those in which chance adds to it. If more runs are excluded than chance allows, the
intervals are widened, whether or not one error explains them.

A gain shows in proportion to the torque, rubbing not at all: sets of strong and weak friction tell
them apart.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.stats import binom, norm

from rigd_analyses.approach_angle.better.bending import MIN_RUNS
from rigd_analyses.approach_angle.better.result import BalanceRow
from rigd_analyses.approach_angle.better.settings import BetterSettings
from rigd_analyses.approach_angle.raw.run_data import FloatArray, KnownRun, Severity
from rigd_analyses.approach_angle.run_result import RunResult
from rigd_analyses.approach_angle.shared_error import (
    AS_GOOD,
    CHANCE,
    SIGNIFICANT,
    SharedError,
)

#: The least scatter of a residual over N: noise of the gauges' zero and of the speeds at the ends.
LEAST_SCATTER: Final = 4e-4
#: Flags of runs that the force balance has excluded, and the share of good runs that it excludes.
BY_BALANCE: Final = frozenset({"rubbing", "torque_missing"})
EXCLUDED_SHARE: Final = 2.0 * float(norm.sf(BetterSettings.balance_coverage))
#: What the equations leave out of a force, relative, from e times less load to more: on good
#: simulated rigs the residuals change with the load by up to 1 %.
LOAD_U: Final = 0.02
TYPICAL_N: Final = 55.0
#: What differs from mounting to mounting, by which a force is wrong in a whole set: relative
#: (on good simulated rigs sets differ by 0.3 to 1.5 %).
MOUNTING_U: Final = 0.01


@dataclass(frozen=True, eq=False)
class _Candidate:
    """One error: its size is 1 in ``unit`` where ``shape`` gives its residual, (n,) in N."""

    code: str
    unit: str
    shape: FloatArray
    effect: FloatArray  #: on F_r/N of each run, relative, (n,)
    words: Callable[[float, float], str]


@dataclass(frozen=True)
class _Weighed:
    """A candidate, its size with standard uncertainty, and its weight among all explanations."""

    of: _Candidate
    size: float
    u: float
    weight: float

    @property
    def pull(self) -> float:
        """Its size over its uncertainty."""
        return abs(self.size) / self.u

    def does(self, there: NDArray[np.bool_]) -> float:
        """Return by how much F_r/N is wrong for it in the runs that are ``there``, (n,)."""
        return math.hypot(self.size, self.u) * float(np.mean(self.of.effect[there]))


def balance_errors(
    known: Sequence[KnownRun], results: Sequence[RunResult]
) -> tuple[list[SharedError], Mapping[str, float]]:
    """Return the error that explains the residuals, none if none is needed; and what it does.

    The second is the relative standard uncertainty of the maximum of each set for errors that all
    runs may share, whether or not one is significant: by their weights, as above.
    """
    chosen = _evidence(known, results)
    if len(chosen) < MIN_RUNS:
        return [], {}
    runs, rows = [k for k, _, _ in chosen], [row for _, row, _ in chosen]
    residual = np.array([row.residual_n for row in rows])
    explained = np.column_stack(
        [
            np.array([_known_shapes(k, row) for k, row in zip(runs, rows, strict=True)]),
            _of_mounting(runs, rows),
        ]
    )
    scatter = LEAST_SCATTER * np.array([row.normal_n for row in rows])
    candidates = [item for item in _candidates(runs, rows) if np.any(item.shape)]
    sizes = [_estimate(residual, item.shape, scatter, explained) for item in candidates]
    prior = math.log(len(candidates))
    odds = np.array([0.0, *(0.5 * (size / u) ** 2 - 1.0 - prior for size, u in sizes)])
    weights = np.exp(odds - np.max(odds))
    weights /= np.sum(weights)
    found = [
        _Weighed(item, size, u, float(weight))
        for item, (size, u), weight in zip(candidates, sizes, weights[1:], strict=True)
    ]
    # A wheel that rolls shows the error, and no maximum that it is in.
    names = [r.run.set_name if _slides(r) else None for _, _, r in chosen]
    best = max(found, key=lambda item: item.pull)
    named = (
        [best, *(i for i in found if i is not best and i.pull**2 > best.pull**2 - AS_GOOD)]
        if best.pull >= SIGNIFICANT
        else []
    )
    effect = {}
    for name in dict.fromkeys(name for name in names if name is not None):
        there = np.array([of == name for of in names])
        weighed = math.hypot(*(math.sqrt(item.weight) * item.does(there) for item in found))
        effect[name] = max([weighed, *(item.does(there) for item in named)])
    if not named:
        return [], effect
    also = "".join(f" As well possible: {i.of.words(i.size, i.u)}" for i in named[1:])
    sentence = (
        f"The force balance of all runs together shows {best.of.words(best.size, best.u)}{also} "
        "The intervals are widened for it."
    )
    return [SharedError(best.of.code, sentence, best.size, best.u, best.of.unit, effect)], effect


def excluded_errors(known: Sequence[KnownRun], results: Sequence[RunResult]) -> list[SharedError]:
    """Return the error that excludes more runs by their balance than chance; none if it does not.

    Its size is the median residual of all sliding runs over what F_r/N they show.
    """
    chosen = _evidence(known, results)
    count = sum(r.excluded for _, _, r in chosen)
    chance = float(binom.sf(count - 1, max(len(chosen), 1), EXCLUDED_SHARE))
    if len(chosen) < MIN_RUNS or chance > CHANCE:
        return []
    shares: dict[str, list[float]] = {}
    for _, row, r in chosen:
        if _slides(r):
            share = row.residual_n / max(abs(row.force_n), 1e-9)
            shares.setdefault(r.run.set_name, []).append(share)
    effect = {name: abs(float(np.median(values))) for name, values in shares.items()}
    size = float(np.median([value for values in shares.values() for value in values] or [0.0]))
    sentence = (
        f"The force balance excludes {count} of {len(chosen)} runs; of good runs chance "
        f"excludes {EXCLUDED_SHARE:.1%}. What all runs share, such as the gain or zero of the "
        "gauges, an angle, a load, a mass or a calibration, is off in the others too. The "
        "intervals are widened by the median residual."
    )
    return [SharedError("runs_excluded", sentence, size, abs(size), "1", effect)]


def _slides(result: RunResult) -> bool:
    return all(flag.code != "no_sliding" for flag in result.better.flags)


def _evidence(
    known: Sequence[KnownRun], results: Sequence[RunResult]
) -> list[tuple[KnownRun, BalanceRow, RunResult]]:
    """Return the runs that have a balance, with those that only the balance excludes."""
    return [
        (k, row, r)
        for k, r in zip(known, results, strict=True)
        if (row := r.better.balance) is not None
        and {f.code for f in r.flags if f.severity is Severity.EXCLUDED} <= BY_BALANCE
    ]


def _estimate(
    residual: FloatArray, shape: FloatArray, scatter: FloatArray, explained: FloatArray
) -> tuple[float, float]:
    """Return the size of an error of ``shape`` (n,), and its standard uncertainty."""

    def at(times: float) -> tuple[float, float, float]:
        covariance = np.diag((times * scatter) ** 2) + explained @ explained.T
        weighted = np.linalg.solve(covariance, np.column_stack([shape, residual]))
        information = float(shape @ weighted[:, 0])
        size = float(shape @ weighted[:, 1]) / information
        return float(residual @ weighted[:, 1]) - size**2 * information, size, information

    times, freedom = 1.0, len(residual) - 1
    if at(times)[0] > freedom:
        # With S alone chi^2 is not smaller, and such that n - 1 remain at the most.
        most = float(np.linalg.norm(residual / scatter)) / math.sqrt(freedom)
        times = brentq(lambda x: at(x)[0] - freedom, 1.0, most + 1.0)
    _, size, information = at(times)
    return size, 1.0 / math.sqrt(information)


def _known_shapes(known: KnownRun, row: BalanceRow) -> FloatArray:
    """Return the residual in N that each known quantity makes if it is wrong by its u, (k,)."""
    rig, calibration = known.rig, known.calibration
    rho, cos = rig.effective_radius.value, math.cos(known.run.alpha_rad)
    radius = rho * rig.wheel_radius_m
    return np.array(
        [
            row.torque_nm * calibration.torque.u / calibration.torque.value / radius,
            rig.bearing_constant.u / radius,
            rig.bearing_viscous.u * abs(row.wheel_speed_rad_s) / radius,
            rig.bearing_load.u * row.normal_n / radius,
            rig.rolling_resistance.u * row.normal_n / rho,
            rig.effective_radius.u * row.force_n / rho,
            rig.rail_constant.u / cos,
            rig.rail_load.u * row.on_rails_n / cos,
            rig.rail_viscous.u * row.platform_speed_m_s / cos,
            rig.roller_drag.u * row.normal_n * math.tan(known.run.alpha_rad),
            row.push_n * calibration.platform.u / calibration.platform.value / cos,
            # All runs begin and end at the same places: the potentiometer's error repeats itself.
            row.push_u_n / cos,
            LOAD_U * row.force_n * math.log(row.normal_n / TYPICAL_N),
        ]
    )


def _of_mounting(runs: Sequence[KnownRun], rows: Sequence[BalanceRow]) -> FloatArray:
    """Return the residual in N that the mounting of each set makes in its runs, (n, sets)."""
    names = [k.run.set_name for k in runs]
    size = np.array(
        [
            abs(row.force_n)
            * math.hypot(MOUNTING_U, BetterSettings.angle_u_rad * math.tan(k.run.alpha_rad))
            for k, row in zip(runs, rows, strict=True)
        ]
    )
    return np.column_stack(
        [size * np.array([name == of for name in names]) for of in dict.fromkeys(names)]
    )


def _candidates(runs: Sequence[KnownRun], rows: Sequence[BalanceRow]) -> list[_Candidate]:
    radius = np.array([k.rig.effective_radius.value * k.rig.wheel_radius_m for k in runs])
    torque, force, normal = (
        np.array([getattr(row, name) for row in rows])
        for name in ("torque_nm", "force_n", "normal_n")
    )
    strong = np.maximum(np.abs(force), 1e-9)
    alpha = np.array([k.run.alpha_rad for k in runs])
    order = np.array([k.run.number for k in runs], dtype=np.float64)
    span = float(np.ptp(order))
    by_torque = torque / radius
    none = np.zeros_like(torque)
    found = [
        _Candidate(
            "torque_gain", "1", by_torque, by_torque / strong,
            lambda size, u: f"{abs(size):.1%} (± {2 * u:.1%}) too {_much(size)} torque, in "
            "proportion to it: the gain of a gauge or of both is not that of the calibration.",
        ),
        _Candidate(
            "torque_offset", "N m", 1.0 / radius, 1.0 / radius / strong,
            lambda size, u: f"{abs(size):.3f} N m (± {2 * u:.3f} N m) too {_much(size)} torque, "
            "the same at any force: "
            + ("something rubs between gauges and wheel in every run, or " if size > 0 else "")
            + "the gauges' zero moves from the start to the run, or the wheel's bearings brake "
            "otherwise than by the calibration.",
        ),
        _Candidate(
            "roller_drag", "1", normal * np.tan(alpha), none,
            lambda size, u: f"a drag of the free rollers that is {size:+.3f} (± {2 * u:.3f}) from "
            "the one of the calibration, or angles that are not as announced; F_r/N does not "
            "depend on it, the usable coefficient does.",
        ),
        _Candidate(
            "rails", "N", 1.0 / np.cos(alpha), none,
            lambda size, u: f"rails that brake by {size:+.2f} N (± {2 * u:.2f} N) more than by the "
            "calibration; F_r/N does not depend on it.",
        ),
    ]  # fmt: skip
    if span > 0.0:
        grown = (order - float(np.min(order))) / span
        found.append(
            _Candidate(
                "torque_drift", "1", by_torque * grown, by_torque * grown / strong,
                lambda size, u: f"a torque that is {abs(size):.1%} (± {2 * u:.1%}) too "
                f"{_much(size)} at the last run and right at the first: a gauge's gain drifts.",
            )
        )  # fmt: skip
    return found


def _much(size: float) -> str:
    return "much" if size > 0.0 else "little"
