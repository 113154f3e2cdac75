"""Identifies the parameters of one friction law, and compares laws, from slip and force."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Final

import numpy as np

from rigd.analysis.analysis import Options
from rigd.analysis.fitting.fit import Fit, fit
from rigd.analysis.fitting.identification import FittedSubject, Rival, identify_model
from rigd.analysis.fitting.interval_width import Spread
from rigd.analysis.fitting.model import to_natural, to_scaled
from rigd.analysis.fitting.selection import Contender, compare
from rigd.analysis.friction.law import FrictionLaw
from rigd.analysis.friction.model import STEP, LawModel, SlipForce
from rigd.analysis.report.rounding import span
from rigd.analysis.result import (
    Curve,
    FloatArray,
    IdentificationResult,
    ModelComparison,
    Preprocessing,
    TrialFit,
)

POINTS: Final = 60
#: The lowest and highest shares of the used samples are noise of the slip, not visited slip.
TRIM: Final = 0.01
#: Longest memory of residuals that is tested, in s.
BLOCK_S: Final = 0.15


@dataclass(frozen=True, eq=False)
class SlipData:
    """Slip and force of the trials of one group, and what a report states and draws of them.

    ``window_s`` is the length of the filter that slip and force went through. ``others`` are the
    same trials processed in other ways. ``least_slip_m_s`` is the slip that the sensors resolve.
    ``shown`` makes of F/F_N (n,), all trials one after the other, the trials of a report.
    ``biases`` are sentences on parameters, by name, whose place the processing moves. A law that
    one of the laws ``rivals`` beats by far gives no numbers.
    """

    trials: Sequence[SlipForce]
    title: str
    method: str
    account: Preprocessing
    window_s: float
    least_slip_m_s: float
    shown: Callable[[FloatArray], tuple[TrialFit, ...]]
    others: Sequence[Sequence[SlipForce]] = ()
    biases: Mapping[str, str] = field(default_factory=dict)
    rivals: Mapping[str, type[FrictionLaw]] = field(default_factory=dict)

    @property
    def period_s(self) -> float:
        """Return the sampling period."""
        return self.trials[0].period_s

    @property
    def visited(self) -> tuple[float, float]:
        """Return the least and the greatest slip in m/s that samples in the fit have."""
        used = np.concatenate([np.abs(t.slip_m_s[t.mask > 0.0]) for t in self.trials])
        low, high = (float(x) for x in np.quantile(used, [TRIM, 1.0 - TRIM]))
        return min(max(low, self.least_slip_m_s), high), high

    @property
    def rolling_m_s(self) -> float:
        """Return the median speed at which the contact moves through the body."""
        rolling = [t.rolling_m_s[t.mask > 0.0] for t in self.trials if t.rolling_m_s is not None]
        return float(np.median(np.abs(np.concatenate(rolling)))) if rolling else 0.0


def identify_law(
    name: str, law: type[FrictionLaw], data: SlipData, options: Options
) -> IdentificationResult:
    """Return the parameters of ``law`` with 95 % intervals, verdicts and its steady curve.

    Raises:
        DataError: the cost is not finite at the start.
    """
    model = LawModel(law, data.trials)
    low, high = data.visited

    def refits(law: type[FrictionLaw], best: Fit) -> tuple[FloatArray, ...]:
        return tuple(fit(LawModel(law, other), best.theta).theta for other in data.others)

    def as_rival(law: type[FrictionLaw]) -> Rival:
        return Rival(LawModel(law, data.trials), partial(_curve, law, data), partial(refits, law))

    subject = FittedSubject(
        model=model,
        name=name,
        method=data.method,
        title=f"{data.title}: {law.title()}",
        words=law.parameters,
        account=data.account,
        period_s=data.period_s,
        visited=f"slip from {span(low, high, 'm/s')}; beyond it every statement is extrapolation",
        curve=partial(_curve, law, data),
        trials=lambda theta: data.shown(model.predict(theta)),
        block_s=BLOCK_S,
        jackknife=True,
        others=partial(refits, law),
        biases=data.biases,
        memory_s=data.window_s,
        rivals={other: as_rival(item) for other, item in data.rivals.items() if other != name},
    )
    return identify_model(subject, options)


def compare_laws(
    laws: Mapping[str, type[FrictionLaw]], data: SlipData, options: Options
) -> ModelComparison:
    """Return which of ``laws`` the data support, by name.

    Raises:
        DataError: the cost of a law is not finite at its start.
    """
    slip = np.geomspace(*data.visited, POINTS)
    rolling = data.rolling_m_s

    def contender(name: str, law: type[FrictionLaw]) -> Contender:
        model = LawModel(law, data.trials)
        return Contender(name, law.title(), model, lambda theta: law.steady(theta, slip, rolling))

    contenders = [contender(name, law) for name, law in laws.items()]
    window = max(1, round(data.window_s / data.period_s))
    scores, sentences = compare(
        contenders, starts=options.starts, seed=options.seed, window=window,
        max_lag=round(BLOCK_S / data.period_s),
    )  # fmt: skip
    used = sum(int(np.count_nonzero(trial.mask)) for trial in data.trials)
    return ModelComparison(
        sentences=sentences,
        scores=scores,
        effective_samples=used / window,
        unit="F/F_N",
        x=slip,
        x_name="V_r",
        x_unit="m/s",
        y_name="steady_friction",
    )


def _curve(law: type[FrictionLaw], data: SlipData, spread: Spread) -> Curve:
    """Return the steady force on the visited slip with its band (pointwise)."""
    low, high = data.visited
    slip, rolling = np.geomspace(low, high, POINTS), data.rolling_m_s

    def steady(theta: FloatArray) -> FloatArray:
        return law.steady(theta, slip, rolling)

    columns = []
    for index in range(len(spread.theta)):
        ends = []
        for side in (1.0, -1.0):
            point = to_scaled(law.parameters, spread.theta)
            point[index] += side * STEP
            ends.append(steady(to_natural(law.parameters, point)))
        columns.append((ends[0] - ends[1]) / (2.0 * STEP))
    ends_of_band = spread.band(steady, np.stack(columns, axis=1) / spread.slopes)
    return Curve(
        "friction_curve", "V_r", "m/s", "steady_friction", "1",
        slip, steady(spread.theta), *ends_of_band,
        note=f"Visited slip: {span(low, high, 'm/s')}; beyond it the curve would "
        "be extrapolation and is not drawn. Band: 95 %, pointwise.",
    )  # fmt: skip
