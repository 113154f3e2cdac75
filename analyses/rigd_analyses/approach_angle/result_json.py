"""The result of a campaign as an object for JSON: no NaN, every number named with its unit."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from rigd_analyses.approach_angle.data import Coefficient, Flag, FloatArray, Severity

if TYPE_CHECKING:
    from rigd_analyses.approach_angle.budget import Budget
    from rigd_analyses.approach_angle.result import (
        CampaignResult,
        Estimate,
        FrictionCurve,
        RunResult,
        SetResult,
        Trend,
    )

_MEANING = {
    Coefficient.ROLLING: "F_r/N, along the rolling direction: what the torque measures",
    Coefficient.USABLE: "(F_r cos(alpha) - F_a sin(alpha))/N, the push along the travel",
    Coefficient.RESULTANT: "sqrt(F_r^2 + F_a^2)/N",
}


def campaign_json(result: CampaignResult) -> dict[str, object]:
    """Return ``result`` as :meth:`CampaignResult.to_json` describes it."""
    return {
        "model": "approach-angle",
        "coefficients": {c.value: _MEANING[c] for c in Coefficient},
        "sets": {s.name: _set_json(s) for s in result.sets},
        "trends": {name: _trend_json(t) for name, t in result.trends.items()},
        "runs": [_run_json(r) for r in result.runs],
        "reference": result.reference,
        "statements": list(result.statements),
        "warnings": list(result.warnings),
    }


def _finite(value: float | None) -> float | None:
    return float(value) if value is not None and math.isfinite(value) else None


def _list(values: FloatArray) -> list[float | None]:
    return [_finite(v) for v in values.tolist()]


def _estimate_json(e: Estimate | None) -> dict[str, object] | None:
    if e is None:
        return None
    return {
        "coefficient": e.coefficient.value,
        "value": _finite(e.value),
        "u_k1": _finite(e.u),
        "U_k2": _finite(e.expanded),
        "low_k2": _finite(e.low),
        "high_k2": _finite(e.high),
    }


def _flags_json(flags: tuple[Flag, ...]) -> list[dict[str, object]]:
    return [
        {
            "code": f.code,
            "reason": f.reason,
            "severity": f.severity.value,
            "excluded": f.severity is Severity.EXCLUDED,
        }
        for f in flags
    ]


def _set_json(s: SetResult) -> dict[str, object]:
    return {
        "angle_deg": _finite(s.angle_deg),
        "wheel": s.wheel,
        "published": None
        if s.published is None
        else {"coefficient": Coefficient.ROLLING.value, "value": s.published},
        "paper": {
            "coefficient": s.paper.coefficient.value,
            "maximum": _finite(s.paper.value),
            "maximum_of_all_runs": _finite(s.paper.value_raw),
            "run": s.paper.run,
            "regime": None if s.paper.regime is None else s.paper.regime.value,
            "runs_raw": s.paper.raw,
            "runs_flagged": s.paper.flagged,
            "runs_used": s.paper.used,
        },
        "maximum": _estimate_json(s.maximum),
        "usable": _estimate_json(s.usable),
        "resultant": _estimate_json(s.resultant),
        "statistical_u_k1": _finite(s.statistical_u),
        "sliding_runs": s.sliding_runs,
        "curve": None if s.curve is None else _curve_json(s.curve),
        "budget": None if s.budget is None else _budget_json(s.budget),
        "missing": list(s.missing),
        "warnings": list(s.warnings),
    }


def _curve_json(c: FrictionCurve) -> dict[str, object]:
    return {
        "coefficient": c.coefficient.value,
        "form": c.form,
        "peak_sliding_speed_m_per_s": _finite(c.peak_speed_m_s),
        "sliding_speed_m_per_s": _list(c.speed_m_s),
        "mu": _list(c.mu),
        "mu_low_k2": _list(c.low),
        "mu_high_k2": _list(c.high),
    }


def _budget_json(b: Budget) -> dict[str, object]:
    return {
        "coefficient": b.coefficient.value,
        "mu": _finite(b.mu),
        "load_N": _finite(b.load_n),
        "wheel_speed_rad_per_s": _finite(b.wheel_speed_rad_s),
        "runs": b.runs,
        "relative_u_k1": {"paper": _finite(b.paper), "better": _finite(b.better)},
        "relative_U_k2": {"paper": _finite(2 * b.paper), "better": _finite(2 * b.better)},
        "terms": [
            {
                "name": t.name,
                "input_u": _finite(t.input_u),
                "input_unit": t.unit,
                "relative_sensitivity_per_unit": _finite(t.sensitivity),
                "relative_u_k1": {"paper": _finite(t.paper), "better": _finite(t.better)},
                "type": t.kind,
                "systematic": t.systematic,
                "paper_uncorrected": t.uncorrected,
                "source": t.source,
            }
            for t in b.terms
        ],
    }


def _trend_json(t: Trend) -> dict[str, object]:
    return {
        "coefficient": t.coefficient.value,
        "sets": list(t.sets),
        "angle_deg": _list(t.angle_deg),
        "mu": _list(t.mu),
        "mu_u_k1": None if t.u is None else _list(t.u),
        "line": {
            "slope_per_deg": _finite(t.line.slope_per_deg),
            "slope_u_k1_per_deg": _finite(t.line.slope_u),
            "slope_95_per_deg": [_finite(t.line.slope_low), _finite(t.line.slope_high)],
            "intercept": _finite(t.line.intercept),
            "intercept_u_k1": _finite(t.line.intercept_u),
            "r_squared": _finite(t.line.r_squared),
            "rms": _finite(t.line.rms),
            "degrees_of_freedom": t.line.dof,
        },
        "demand": {
            "a": _finite(t.demand.a),
            "b": _finite(t.demand.b),
            "rms": _finite(t.demand.rms),
        },
        "sentence": t.sentence,
    }


def _run_json(r: RunResult) -> dict[str, object]:
    p, b = r.paper, r.better
    return {
        "label": r.run.label,
        "trial": r.run.number,
        "recording": r.run.recording,
        "set": r.run.set_name,
        "angle_deg": _finite(math.degrees(r.run.alpha_rad)),
        "announced_load_kg": _finite(r.run.announced_load_kg),
        "load_N": _finite(r.run.load_n),
        "motor_voltage_V": _finite(r.run.voltage_v),
        "repeat": r.run.repeat,
        "excluded": r.excluded,
        "paper": {
            "coefficient": Coefficient.ROLLING.value,
            "mu": _finite(p.mu),
            "torque_Nm": _finite(p.torque_nm),
            "slip": _finite(p.slip),
            "slip_corrected": _finite(p.slip_corrected),
            "relative_speed_m_per_s": _finite(p.relative_speed),
            "sigma_s": _finite(p.sigma_s),
            "peak_torque_Nm": _finite(p.h),
            "peak_time_s": _finite(p.p),
            "steady_from_s": _finite(p.t_steady_s),
            "regime": None if p.regime is None else p.regime.value,
        },
        "better": {
            "coefficient": b.coefficient.value,
            "mu": _finite(b.mu),
            "mu_u_k1": _finite(b.mu_u),
            "demand": _finite(b.demand),
            "torque_Nm": _finite(b.torque_nm),
            "normal_force_N": _finite(b.normal_force_n),
            "sliding_speed_m_per_s": _finite(b.sliding_speed_m_s),
            "slip": _finite(b.slip),
            "slip_corrected": _finite(b.slip_corrected),
            "slip_corrected_u_k1": _finite(b.slip_corrected_u),
            "relative_speed_m_per_s": _finite(b.relative_speed_m_s),
            "regime": None if b.regime is None else b.regime.value,
            "sliding_blocks": int(np.count_nonzero(b.blocks.sliding)),
            "blocks": int(b.blocks.sliding.size),
            "force_residual": _finite(b.force_residual),
            "force_residual_limit": _finite(b.force_residual_limit),
            "tare_V": _finite(b.tare_v),
        },
        "flags": _flags_json(r.flags),
    }
