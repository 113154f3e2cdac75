"""Defines the result of a campaign as frozen data, for the report and the JSON file.

Every coefficient names which of the three coefficients it is. A value that the data do not give is
``None`` or, inside the result of one run, NaN; in JSON both are null.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rigd.analysis.estimates import Estimate, Share
from rigd.analysis.plain_data import plain_object
from rigd_analyses.approach_angle.budget import Budget
from rigd_analyses.approach_angle.raw.run_data import (
    Coefficient,
    FloatArray,
    Regime,
)
from rigd_analyses.approach_angle.run_result import RunResult
from rigd_analyses.approach_angle.shared_error import SharedError

#: What each coefficient is, for readers of the JSON object alone.
_MEANING: Final = {
    Coefficient.ROLLING: "F_r/N, along the rolling direction: what the torque measures",
    Coefficient.USABLE: "(F_r cos(alpha) - F_a sin(alpha))/N, the push along the travel",
    Coefficient.RESULTANT: "sqrt(F_r^2 + F_a^2)/N",
}


def file_names(paths: Iterable[str]) -> dict[str, str]:
    """Return the name of each file, by its path; the paths themselves if two have one name."""
    named = {path: Path(path).name for path in paths}
    return named if len(set(named.values())) == len(named) else {path: path for path in named}


@dataclass(frozen=True)
class MeasuredCoefficient:
    """A coefficient with its standard uncertainty ``u`` (k = 1); dimensionless.

    ``shares`` are the parts of ``u`` that come from stated constants.
    """

    value: float
    u: float
    coefficient: Coefficient
    shares: tuple[Share, ...] = ()

    @property
    def expanded(self) -> float:
        """Expanded uncertainty U = 2 u, about 95 % (JCGM 100:2008, 6.2)."""
        return 2.0 * self.u

    @property
    def low(self) -> float:
        """Lower end of the interval value - U."""
        return self.value - self.expanded

    @property
    def high(self) -> float:
        """Upper end of the interval value + U."""
        return self.value + self.expanded

    def shape(self) -> dict[str, object]:
        """Return the fields of the JSON object."""
        return {
            "coefficient": self.coefficient,
            "value": self.value,
            "u_k1": self.u,
            "U_k2": self.expanded,
            "low_k2": self.low,
            "high_k2": self.high,
        }


@dataclass(frozen=True)
class PaperMaximum:
    """The paper's number for a set: the largest T/(R N) of its runs, with all three counts.

    ``value`` is the maximum over the used runs, ``value_raw`` over all that gave a number at all,
    as the paper's own 0.5324 was before runs were taken out. ``None`` without such a run.
    ``regime`` is what the wheel did in the run of ``value``: a limit only if it slid.
    """

    value: float | None
    value_raw: float | None
    run: str  #: label of the run with ``value``
    regime: Regime | None
    raw: int  #: runs recorded
    flagged: int  #: runs left out for a reason
    used: int
    coefficient: Coefficient = Coefficient.ROLLING

    def shape(self) -> dict[str, object]:
        """Return the fields of the JSON object."""
        return {
            "coefficient": self.coefficient,
            "maximum": self.value,
            "maximum_of_all_runs": self.value_raw,
            "run": self.run,
            "regime": self.regime,
            "runs_raw": self.raw,
            "runs_flagged": self.flagged,
            "runs_used": self.used,
        }


@dataclass(frozen=True, eq=False)
class FrictionCurve:
    """The pooled friction limit over the sliding speed, on the range the data cover only.

    ``speed_m_s``, ``mu``, ``low``, ``high``: (n,), the band +-2 u of the curve between runs (no
    systematic part). ``block_*``: (m,) the block means that made it, ``weight`` 0 to 1 the robust
    weight each got, ``block_run`` the number of its run in the campaign.
    """

    speed_m_s: FloatArray
    mu: FloatArray
    low: FloatArray
    high: FloatArray
    block_speed_m_s: FloatArray
    block_mu: FloatArray
    block_weight: FloatArray
    block_run: tuple[int, ...]
    peak_speed_m_s: float
    form: str  #: the formula in words
    coefficient: Coefficient = Coefficient.ROLLING

    def shape(self) -> dict[str, object]:
        """Return the fields of the JSON object; the blocks are left out."""
        return {
            "coefficient": self.coefficient,
            "form": self.form,
            "peak_sliding_speed_m_per_s": self.peak_speed_m_s,
            "sliding_speed_m_per_s": self.speed_m_s,
            "mu": self.mu,
            "mu_low_k2": self.low,
            "mu_high_k2": self.high,
        }


@dataclass(frozen=True)
class SetResult:
    """One set of the campaign: wheel and angle.

    ``maximum`` is the maximum of the pooled curve; its u holds the spread between runs, the
    systematic terms of the budget, and errors that the runs share. ``usable`` and ``resultant``
    follow from it and the rollers' drag. All three are ``None`` if the data do not determine them,
    and ``warnings`` gives the reason.
    """

    name: str
    alpha_rad: float
    wheel: str
    published: float | None  #: printed beside, never used
    paper: PaperMaximum
    curve: FrictionCurve | None
    maximum: MeasuredCoefficient | None
    usable: MeasuredCoefficient | None
    resultant: MeasuredCoefficient | None
    statistical_u: float | None  #: of ``maximum``, from the spread between runs
    sliding_runs: int
    budget: Budget | None
    missing: tuple[str, ...] = ()  #: repeats that the campaign lacks, one sentence each
    warnings: tuple[str, ...] = ()
    shared_u: float = 0.0  #: relative, in ``maximum``: errors that the runs share or may

    @property
    def paper_expanded(self) -> float | None:
        """U (k = 2) of the paper's maximum, from its budget; None without one."""
        if self.paper.value is None or self.budget is None:
            return None
        return 2.0 * self.budget.paper * self.paper.value

    @property
    def estimates(self) -> tuple[Estimate, ...]:
        """The coefficients as any analysis gives its numbers; none without a maximum."""
        why = " ".join((*self.missing, *self.warnings))
        return tuple(
            Estimate(
                self.name, name, "1", None, None, None, False, "not determined", why, meaning
            )
            if found is None
            else Estimate(
                self.name, name, "1", found.value, found.low, found.high, True, "determined", why,
                meaning, shares=found.shares,
            )
            for name, found, meaning in (
                ("maximum", self.maximum, _MEANING[Coefficient.ROLLING]),
                ("usable", self.usable, _MEANING[Coefficient.USABLE]),
                ("resultant", self.resultant, _MEANING[Coefficient.RESULTANT]),
            )
        )  # fmt: skip

    def shape(self) -> dict[str, object]:
        """Return the fields of the JSON object; the name is the key of the whole."""
        published = {"coefficient": Coefficient.ROLLING, "value": self.published}
        return {
            "angle_deg": self.angle_deg,
            "wheel": self.wheel,
            "published": None if self.published is None else published,
            "paper": self.paper,
            "maximum": self.maximum,
            "usable": self.usable,
            "resultant": self.resultant,
            "statistical_u_k1": self.statistical_u,
            "shared_errors_relative_u_k1": self.shared_u,
            "sliding_runs": self.sliding_runs,
            "curve": self.curve,
            "budget": self.budget,
            "missing": self.missing,
            "warnings": self.warnings,
        }

    @property
    def angle_deg(self) -> float:
        """Approach angle in degrees, as tables print it."""
        return math.degrees(self.alpha_rad)


@dataclass(frozen=True)
class LineFit:
    """mu = intercept + slope angle over the clean sets; slope per degree, u of k = 1.

    ``slope_low``, ``slope_high``: 95 % interval, of the scatter by the t-distribution with ``dof``
    degrees, or of what the maxima are uncertain by if that is wider.
    """

    slope_per_deg: float
    slope_u: float
    slope_low: float
    slope_high: float
    intercept: float
    intercept_u: float
    r_squared: float
    rms: float
    dof: int

    def shape(self) -> dict[str, object]:
        """Return the fields of the JSON object."""
        return {
            "slope_per_deg": self.slope_per_deg,
            "slope_u_k1_per_deg": self.slope_u,
            "slope_95_per_deg": [self.slope_low, self.slope_high],
            "intercept": self.intercept,
            "intercept_u_k1": self.intercept_u,
            "r_squared": self.r_squared,
            "rms": self.rms,
            "degrees_of_freedom": self.dof,
        }


@dataclass(frozen=True)
class DemandFit:
    """mu = (a + b sin(alpha))/cos(alpha): the demand of mere rolling, fitted to the same data.

    a stands for (m a + F_rail)/N, b for the rollers' drag.
    """

    a: float
    b: float
    rms: float


@dataclass(frozen=True, eq=False)
class Trend:
    """Friction over the angle by one source: ``paper``, ``better`` or ``published``."""

    source: str
    sets: tuple[str, ...]
    angle_deg: FloatArray
    mu: FloatArray
    u: FloatArray | None
    line: LineFit
    demand: DemandFit
    sentence: str
    coefficient: Coefficient = Coefficient.ROLLING

    def shape(self) -> dict[str, object]:
        """Return the fields of the JSON object; the source is the key of the whole."""
        return {
            "coefficient": self.coefficient,
            "sets": self.sets,
            "angle_deg": self.angle_deg,
            "mu": self.mu,
            "mu_u_k1": self.u,
            "line": self.line,
            "demand": self.demand,
            "sentence": self.sentence,
        }


@dataclass(frozen=True)
class SlipPoint:
    """Corrected slip of one set at one voltage: the mean over its loads, dimensionless.

    ``expanded`` is the half width of its 95 % interval, NaN without equal runs that show their
    spread. ``lowest_load`` and ``highest_load`` are the smallest and the largest mean of a load.
    """

    set_name: str
    wheel: str
    alpha_rad: float
    voltage_v: float
    slip: float
    expanded: float
    lowest_load: float
    highest_load: float
    loads_kg: tuple[float, ...]
    runs: int
    regimes: tuple[Regime, ...]  #: of the runs, each once

    def shape(self) -> dict[str, object]:
        """Return the fields of the JSON object."""
        return {
            "set": self.set_name,
            "wheel": self.wheel,
            "angle_deg": math.degrees(self.alpha_rad),
            "motor_voltage_V": self.voltage_v,
            "slip_corrected": self.slip,
            "U_95": self.expanded,
            "lowest_mean_of_a_load": self.lowest_load,
            "highest_mean_of_a_load": self.highest_load,
            "loads_kg": self.loads_kg,
            "runs": self.runs,
            "regimes": self.regimes,
        }


@dataclass(frozen=True)
class CampaignResult:
    """The whole campaign. ``trends`` by source; one is missing with less than three clean sets."""

    runs: tuple[RunResult, ...]
    sets: tuple[SetResult, ...]
    trends: Mapping[str, Trend]
    reference: str  #: origin of the published values; empty without
    statements: tuple[str, ...]  #: what was done to the data, in words
    warnings: tuple[str, ...] = ()
    slips: tuple[SlipPoint, ...] = ()  #: slip over the angle, by set and voltage
    shared: tuple[SharedError, ...] = ()  #: errors that the runs have in common

    def to_json(self) -> dict[str, object]:
        """Return an object ready for ``json.dump(..., allow_nan=False)``.

        Every coefficient is dimensionless and stands beside the name of its kind under
        ``coefficient``; other numbers carry their unit in the key. Signals are left out: they
        stand in the recording.
        """
        return plain_object(self)

    def shape(self) -> dict[str, object]:
        """Return the fields of the JSON object."""
        return {
            "model": "approach-angle",
            "coefficients": {item.value: meaning for item, meaning in _MEANING.items()},
            "sets": {item.name: item for item in self.sets},
            "trends": self.trends,
            "slip_over_angle": self.slips,
            "shared_errors": self.shared,
            "runs": self.runs,
            "reference": self.reference,
            "statements": self.statements,
            "warnings": self.warnings,
        }
