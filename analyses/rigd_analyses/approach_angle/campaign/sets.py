"""Computes the largest friction coefficient of one set, with its uncertainty.

A run is one recorded movement of the platform, which the wheel drives. A campaign is all runs that
one analysis evaluates together. A set is all runs of a campaign that share the wheel and the
approach angle (between the wheel's rolling direction and the movement). The result has

- the largest coefficient of a single run by the paper's method ("Omni-wheel friction coefficient
  measuring methodology for various angles");
- the maximum of the friction curve that is fitted to all sliding runs together (the pooled curve:
  friction coefficient over sliding speed), and the usable and the resultant coefficient that
  follow from it;
- the uncertainty budget of the set (the list of contributions to the uncertainty);
- warnings, for example that too few runs slide for a maximum.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from rigd.analysis.estimates import Share
from rigd_analyses.approach_angle.better.settings import BetterSettings
from rigd_analyses.approach_angle.budget import Budget, set_budget
from rigd_analyses.approach_angle.curve import Pooled, pool
from rigd_analyses.approach_angle.raw.run_data import AngleRig, Coefficient, KnownRun, Severity
from rigd_analyses.approach_angle.result import MeasuredCoefficient, PaperMaximum, SetResult
from rigd_analyses.approach_angle.run_result import RunResult
from rigd_analyses.approach_angle.shared_error import SharedError

#: Fewer sliding runs than these give no maximum; fewer than ``FEW`` one with a warning.
MIN_RUNS, FEW = 5, 10
#: What is the same in all runs of one rig, under any calibration.
CONSTANTS = ("wheel_radius_m", "wheel_inertia", "platform_mass_kg", "gravity")
#: Sets whose angles differ by more than this are mixed up, rad.
SAME_ANGLE = math.radians(0.05)


def evaluate_set(
    name: str,
    known: Sequence[KnownRun],
    results: Sequence[RunResult],
    *,
    published: float | None,
    missing: tuple[str, ...],
    settings: BetterSettings,
    shared: Sequence[SharedError] = (),
    unseen: Mapping[str, float] | None = None,
) -> SetResult:
    """Return the result of a set; ``known`` and ``results`` are of the same runs, in order.

    ``shared`` errors widen the interval of the maximum by their effect; so does, by the name of
    the set, what of such errors would be ``unseen``.
    """
    alphas = [k.run.alpha_rad for k in known]
    sliding = [
        (k, r)
        for k, r in zip(known, results, strict=True)
        if not r.excluded and r.better.budget is not None
    ]
    warnings = [*_record_warnings(known, results, missing)]
    mixed = max(alphas) - min(alphas) > SAME_ANGLE
    if mixed:
        warnings.append(
            f"its runs have angles from {math.degrees(min(alphas)):g} to "
            f"{math.degrees(max(alphas)):g} degrees; a maximum of them would mean nothing"
        )
    elif len(sliding) < MIN_RUNS:
        warnings.append(
            f"the wheel slides steadily in {len(sliding)} of {len(known)} runs, need {MIN_RUNS} "
            "for a maximum; use higher voltages or lower loads"
        )
    pooled = None
    if not mixed and len(sliding) >= MIN_RUNS:
        pooled = _pooled([r for _, r in sliding])
        warnings += _curve_warnings(pooled, len(sliding))
    budget = None
    if sliding:
        scatter = None if pooled is None else pooled.scatter
        first = sliding[0][0]
        runs = [b for _, r in sliding if (b := r.better.budget) is not None]
        budget = set_budget(runs, first.calibration, first.rig, scatter)
    named_u = math.hypot(*(error.effect.get(name, 0.0) for error in shared))
    shared_u = math.hypot(named_u, (unseen or {}).get(name, 0.0))
    alike = len({(k.calibration, k.rig) for k in known}) == 1
    maximum = None
    if pooled is not None and budget is not None:
        # Of runs with several calibrations nothing is known to be common to another campaign.
        maximum = _maximum(pooled, budget, shared_u, budget.shares if alike else ())
    if maximum is not None and named_u > 0.0:
        codes = ", ".join(error.code for error in shared if error.effect.get(name, 0.0) > 0.0)
        warnings.append(
            f"the interval of the maximum is widened by {named_u:.1%} (k = 1) for what all runs "
            f"show ({codes}; see the warnings)"
        )
    usable, resultant = _others(maximum, alphas[0], known[0].rig, settings)
    return SetResult(
        name=name,
        alpha_rad=alphas[0],
        wheel=known[0].run.wheel,
        published=published,
        paper=_paper_maximum(results),
        curve=None if pooled is None else pooled.curve,
        maximum=maximum,
        usable=usable,
        resultant=resultant,
        statistical_u=None if pooled is None else pooled.maximum_u,
        sliding_runs=len(sliding),
        budget=budget,
        missing=missing,
        warnings=tuple(warnings),
        shared_u=shared_u,
    )


def _pooled(results: Sequence[RunResult]) -> Pooled:
    blocks = [r.better.blocks for r in results]
    return pool(
        [b.sliding_speed_m_s[b.sliding] for b in blocks],
        [b.mu[b.sliding] for b in blocks],
        [r.run.number for r in results],
    )


def _maximum(
    pooled: Pooled, budget: Budget, shared_u: float, relative: Sequence[Share]
) -> MeasuredCoefficient:
    u = math.hypot(pooled.maximum_u, math.hypot(budget.systematic, shared_u) * pooled.maximum)
    shares = _times(pooled.maximum, relative)
    return MeasuredCoefficient(pooled.maximum, u, Coefficient.ROLLING, shares)


def _times(factor: float, shares: Iterable[Share]) -> tuple[Share, ...]:
    return tuple(replace(item, effect=factor * item.effect) for item in shares)


def _others(
    rolling: MeasuredCoefficient | None, alpha: float, rig: AngleRig, settings: BetterSettings
) -> tuple[MeasuredCoefficient | None, MeasuredCoefficient | None]:
    """Return usable and resultant coefficient that belong to the rolling-direction one."""
    if rolling is None:
        return None, None
    mu, drag = rolling.value, rig.roller_drag
    usable = mu * math.cos(alpha) - drag.value * math.sin(alpha)
    turned = mu * math.sin(alpha) + drag.value * math.cos(alpha)
    usable_u = math.hypot(
        rolling.u * math.cos(alpha), drag.u * math.sin(alpha), turned * settings.angle_u_rad
    )
    resultant = math.hypot(mu, drag.value)
    resultant_u = math.hypot(mu * rolling.u, drag.value * drag.u) / resultant

    def shares(by_mu: float, by_drag: float) -> tuple[Share, ...]:
        of_drag = Share("roller_drag", drag.value, drag.u, by_drag * drag.u)
        return (*_times(by_mu, rolling.shares), of_drag) if rolling.shares else ()

    return (
        MeasuredCoefficient(
            usable, usable_u, Coefficient.USABLE, shares(math.cos(alpha), -math.sin(alpha))
        ),
        MeasuredCoefficient(
            resultant, resultant_u, Coefficient.RESULTANT,
            shares(mu / resultant, drag.value / resultant),
        ),
    )  # fmt: skip


def _paper_maximum(results: Sequence[RunResult]) -> PaperMaximum:
    numbers = [r for r in results if math.isfinite(r.paper.mu)]
    used = [r for r in numbers if not r.excluded]
    best = max(used, key=lambda r: r.paper.mu, default=None)
    return PaperMaximum(
        value=None if best is None else best.paper.mu,
        value_raw=max((r.paper.mu for r in numbers), default=None),
        run="" if best is None else best.run.label,
        regime=None if best is None else best.paper.regime,
        raw=len(results),
        flagged=len(results) - len(used),
        used=len(used),
    )


def _record_warnings(
    known: Sequence[KnownRun], results: Sequence[RunResult], missing: Sequence[str]
) -> list[str]:
    found = []
    if missing:
        cells = "; ".join(missing[:3]) + (f"; and {len(missing) - 3} more" if missing[3:] else "")
        found.append(f"incomplete: {cells}")
    excluded = sum(r.excluded for r in results)
    if excluded:
        reasons: dict[str, int] = {}
        for result in results:
            for code in {f.code for f in result.flags if f.severity is Severity.EXCLUDED}:
                reasons[code] = reasons.get(code, 0) + 1
        listed = ", ".join(f"{code} {count}" for code, count in sorted(reasons.items()))
        found.append(f"{excluded} of {len(results)} runs are left out: {listed}")
    if len({k.calibration for k in known}) > 1:
        found.append(
            "its runs were made under several calibrations; the budget is that of the first"
        )
    found += [
        f"its runs have several values of {name} ({', '.join(f'{v:g}' for v in values)}): are they "
        "of one rig?"
        for name in CONSTANTS
        if len(values := dict.fromkeys(getattr(k.rig, name) for k in known)) > 1
    ]
    return found


def _curve_warnings(pooled: Pooled, runs: int) -> list[str]:
    found = []
    if runs < FEW:
        found.append(f"only {runs} runs slide steadily; the interval is wide for that")
    if pooled.at_edge:
        low, high = (float(v) for v in np.asarray(pooled.curve.speed_m_s)[[0, -1]])
        where = low if pooled.at_edge == "slow" else high
        found.append(
            f"the curve still rises at {where:.2f} m/s, the {pooled.at_edge} end of the sliding "
            f"speeds ({low:.2f} to {high:.2f} m/s): the maximum may lie beyond, and its interval "
            "is widened for that"
        )
    return found
