"""Defines the result of an identification as frozen data, from which reports and files are made.

Every reported number has its unit, its interval and a verdict beside it. If the data leave an end
of an interval open, that end is ``None``, never a large number.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from rigd.analysis.estimates import Estimate, Share
from rigd.analysis.plain_data import plain_object

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


class Verdict(Enum):
    """The degree to which the data determine a parameter."""

    IDENTIFIABLE = "identifiable"
    WEAK = "weakly identifiable"
    BIASED = "biased by this method"  #: a narrow interval whose place is wrong; see the sentence
    UNIDENTIFIABLE = "not identifiable from this excitation"
    MISFIT = "not given: the model does not fit"
    UNRESOLVED = "not identifiable by this method"  #: the data close it, the method moves it
    CONSTANTS = "not determined by these constants"  #: exact constants would make it known


#: Verdicts under which no number may be quoted.
_WITHOUT_NUMBER = (
    Verdict.UNIDENTIFIABLE,
    Verdict.UNRESOLVED,
    Verdict.CONSTANTS,
    Verdict.MISFIT,
)


@dataclass(frozen=True)
class ParameterEstimate:
    """One parameter: ``estimate`` with its interval in ``unit``, and its verdict.

    ``low`` and ``high`` bound the interval at the result's confidence; ``None`` if the data
    leave that end open, and both ``None`` when the parameter is not ``identifiable``. Only
    ``quoted`` is for people: ``estimate`` is the end of the fit, of any worth.
    ``source`` is the origin of the interval (``"covariance"`` or ``"profile"``).
    ``standard_error`` is in ``unit``; ``None`` if the curvature carries no information.
    """

    name: str
    symbol: str
    unit: str
    meaning: str
    estimate: float
    low: float | None
    high: float | None
    standard_error: float | None
    verdict: Verdict
    sentence: str
    source: str = "covariance"
    flags: tuple[str, ...] = ()
    advice: str = ""  #: which excitation would help, in one plain sentence; empty if none is needed
    shares: tuple[Share, ...] = ()  #: of the interval: those of stated constants, of the logarithm

    @property
    def identifiable(self) -> bool:
        """Whether an interval may be quoted: false when the data or the method do not allow one."""
        return self.verdict in (Verdict.IDENTIFIABLE, Verdict.WEAK)

    @property
    def quoted(self) -> float | None:
        """The estimate if a person may be shown it, None if only the fit may use it.

        An interval that is open on both sides, or a verdict that it is not identifiable, leaves
        none: table, report and JSON object agree.
        """
        if self.verdict in _WITHOUT_NUMBER:
            return None
        return self.estimate if self.low is not None or self.high is not None else None

    def as_estimate(self, group: str) -> Estimate:
        """Return it as a parameter of ``group``; no number if none may be quoted."""
        known = self.quoted is not None
        positive = self.estimate > 0.0 and (self.low is None or self.low > 0.0)
        return Estimate(
            group, self.name, self.unit, self.quoted,
            self.low if known else None, self.high if known else None,
            self.identifiable, self.verdict.value, f"{self.sentence} {self.advice}".strip(),
            self.meaning, self.symbol, self.shares if positive else (), positive,
        )  # fmt: skip

    def shape(self) -> dict[str, object]:
        """Return the fields of the JSON object, in ``unit``; no number if none may be quoted."""
        known = self.quoted is not None
        return {
            "estimate": self.quoted,
            "low": self.low if known else None,
            "high": self.high if known else None,
            "unit": self.unit,
            "identifiable": self.identifiable,
            "standard_error": self.standard_error if known else None,
            "verdict": self.verdict,
            "sentence": self.sentence,
            "advice": self.advice,
            "flags": self.flags,
            "interval_source": self.source,
            "meaning": self.meaning,
        }


@dataclass(frozen=True, eq=False)
class Seen:
    """What the data show of a curve in one range of ``x``: median and middle half of ``count``."""

    x: float
    median: float
    low: float
    high: float
    count: int


@dataclass(frozen=True, eq=False)
class Curve:
    """A fitted characteristic with its band, only over the range that the data cover.

    ``seen`` is what the data show of it, in ranges of ``x``.

    ``x``, ``y``, ``low``, ``high``: (n,) arrays. In JSON it is a list named ``name`` of objects
    with keys ``x_name``, ``y_name``, ``low``, ``high``.
    """

    name: str
    x_name: str
    x_unit: str
    y_name: str
    y_unit: str
    x: FloatArray
    y: FloatArray
    low: FloatArray
    high: FloatArray
    note: str = ""
    seen: tuple[Seen, ...] = ()

    def points(self) -> list[dict[str, float]]:
        """Return the points, each with its band."""
        rows = zip(self.x, self.y, self.low, self.high, strict=True)
        return [{self.x_name: x, self.y_name: y, "low": a, "high": b} for x, y, a, b in rows]


@dataclass(frozen=True, eq=False)
class Signal:
    """A signal of one trial to plot beside the fit: (n,) values in ``unit``."""

    unit: str
    values: FloatArray


@dataclass(frozen=True, eq=False)
class Track:
    """The way of a body in the plane: x and y in m, (n, 2), NaN while it was not seen."""

    body: str
    measured: FloatArray
    fitted: FloatArray


@dataclass(frozen=True, eq=False)
class TrialFit:
    """Measured and fitted output of one trial, sample by sample.

    ``t_s``, ``measured``, ``fitted``, ``used``: (n,); ``used`` marks samples that entered the cost.
    ``rms`` (in ``unit``) and ``r_squared`` are over the used samples.
    """

    label: str
    condition: str
    output: str
    unit: str
    t_s: FloatArray
    measured: FloatArray
    fitted: FloatArray
    used: BoolArray
    rms: float
    r_squared: float
    recording: str = ""  #: the file it is from
    signals: Mapping[str, Signal] = field(default_factory=dict)
    track: Track | None = None  #: where a body went, if the model has one that moves in a plane

    def shape(self) -> dict[str, object]:
        """Return the fields of the JSON object: samples stand in the recording."""
        return {
            "label": self.label,
            "recording": self.recording,
            "condition": self.condition,
            "rms": self.rms,
            "unit": self.unit,
            "r_squared": self.r_squared,
            "samples_used": np.count_nonzero(self.used),
        }


@dataclass(frozen=True, eq=False)
class Profile:
    """Profile likelihood of one parameter.

    ``values``: (n,) grid in ``unit``; ``cost``: (n,) rise of -2 ln L over its minimum after
    division by the inflation factor for coloured residuals, so that values below ``threshold``
    lie inside the interval. ``low``/``high`` are ``None`` if the profile never crosses.
    """

    name: str
    unit: str
    values: FloatArray
    cost: FloatArray
    threshold: float
    low: float | None
    high: float | None
    log_axis: bool = True

    def shape(self) -> dict[str, object]:
        """Return the fields of the JSON object."""
        return {
            "parameter": self.name,
            "unit": self.unit,
            "values": self.values,
            "cost": self.cost,
            "threshold": self.threshold,
            "low": self.low,
            "high": self.high,
        }


@dataclass(frozen=True)
class ResidualTest:
    """One test of the residuals: its statistic, p value if it has one, and what it means."""

    name: str
    statistic: float
    p_value: float | None
    passed: bool
    sentence: str


@dataclass(frozen=True, eq=False)
class Autocorrelation:
    """Residual autocorrelation: (n,) ``lag_s``, ``value``; white noise stays within ``±band``."""

    lag_s: FloatArray
    value: FloatArray
    band: float


@dataclass(frozen=True)
class StartOutcome:
    """The end of one start of a multi-start fit; parameters in their units, by name."""

    start: Mapping[str, float]
    end: Mapping[str, float]
    cost: float
    iterations: int
    converged: bool


@dataclass(frozen=True, eq=False)
class FittedPoint:
    """The point at which the fit ended, for a program that simulates the model with it.

    The values belong together: a single one means something only if its verdict allows it.
    ``values`` (p,) are natural, in ``units``. ``covariance`` (p, p) is that of noise and constants
    in scaled coordinates: of the logarithm if ``scaling`` is ``"log"``. ``alternatives`` (k, p)
    are other points: those of other choices of the method, and the ends of what profiles accept,
    which a covariance does not show.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    scaling: tuple[str, ...]
    values: FloatArray
    covariance: FloatArray
    alternatives: FloatArray


@dataclass(frozen=True)
class TrialRejection:
    """A trial that was left out of the fit, and why."""

    label: str
    reason: str
    rows: int = 0  #: how many it has, if the analysis counts them


@dataclass(frozen=True)
class RowsUsed:
    """How many rows of a trial enter a fit, and how many do not, by the reason."""

    used: int
    not_used: Mapping[str, int]


@dataclass(frozen=True)
class Preprocessing:
    """The processing of the data before the fit, in words and numbers that can be repeated."""

    statements: tuple[str, ...]
    settings: Mapping[str, float | str]
    per_trial: Mapping[str, Mapping[str, float]]
    rejected: tuple[TrialRejection, ...] = ()
    rows: Mapping[str, RowsUsed] = field(default_factory=dict)  #: by trial; of those in the fit

    @property
    def rows_in_words(self) -> str:
        """How many rows count and why the others do not; empty if the analysis counts none."""
        if not self.rows:
            return ""
        used = sum(item.used for item in self.rows.values())
        others: Counter[str] = Counter()
        for item in self.rows.values():
            others.update(item.not_used)
        others["in trials left out"] += sum(item.rows for item in self.rejected)
        reasons = ", ".join(f"{count} {why}" for why, count in others.items() if count)
        total = used + others.total()
        return f"{used} of {total} rows used" + (f"; {reasons}" if reasons else "")


class FitOutcome(Enum):
    """The outcome of the gate for a fit."""

    FITS = "fits"
    CORRECTED = "fits with what is named"
    MISFIT = "does not fit"


class Meaning(Enum):
    """What something that is added to a model makes of the model's parameters."""

    NUISANCE = "they stand"
    VARIES = "they are means of what varies"
    LAW = "they are not those of the law that holds"
    CONFUSED = "they cannot be told from it"


@dataclass(frozen=True)
class Explanation:
    """Something that explains a misfit and was fitted: its size in ``unit`` with standard error.

    Of a wave the size is the amplitude. ``stated`` is what was stated of a constant, None for
    anything else; ``pull`` by how many of its uncertainties ``size`` is above it, or the data ask
    for if that is out of its bounds. ``gain`` is the fall of -2 ln L; ``others`` explain nearly as
    much. ``look`` is what to check on the rig.
    """

    name: str
    unit: str
    size: float
    sd: float
    gain: float
    look: str = ""
    stated: float | None = None
    pull: float = 0.0
    others: tuple[str, ...] = ()
    meaning: Meaning = Meaning.NUISANCE


@dataclass(frozen=True)
class Gate:
    """The outcome, the first sentence of the report, and the findings, the worst first.

    ``explanations`` are in the fit whose numbers are given, or would explain why none are.
    """

    outcome: FitOutcome
    sentence: str
    findings: tuple[str, ...] = ()
    explanations: tuple[Explanation, ...] = ()


@dataclass(frozen=True)
class FurtherTest:
    """What more tests would make of ``target``, a parameter or a curve at a place, if it is open.

    ``sentence`` says so. ``test`` is the one that determines it, taken ``count`` times, to the
    predicted ``half_width`` of its logarithm at 95 %; without one there is no count and no width.
    ``certain``: it does so with all values that the data accept, else with those of the best fit.
    """

    target: str
    sentence: str
    test: str = ""
    count: int = 0
    half_width: float | None = None
    certain: bool = False


@dataclass(frozen=True, eq=False)
class ModelScore:
    """How well one model explains the data, beside others.

    ``parameters`` is their number, ``delta_bic`` the rise of the Bayesian information criterion
    over the best model that fits, ``cv_error`` the rms error on trials that were left out of the
    fit, in the unit of the residuals. ``fits``: the residuals remember no longer than the
    processing explains. ``on_bound`` are parameters that ended on a bound of their box. ``curve``
    (n,) is the characteristic at the ``x`` of the comparison.
    """

    name: str
    title: str
    parameters: int
    delta_bic: float
    cv_error: float
    fits: bool
    on_bound: tuple[str, ...]
    estimates: Mapping[str, float]
    curve: FloatArray

    def shape(self) -> dict[str, object]:
        """Return the fields of the JSON object; estimates of a model that does not fit are null."""
        return {
            "name": self.name,
            "title": self.title,
            "parameters": self.parameters,
            "delta_bic": self.delta_bic,
            "cv_error": self.cv_error,
            "fits": self.fits,
            "on_bound": self.on_bound,
            "estimates": self.estimates if self.fits else None,
        }


@dataclass(frozen=True, eq=False)
class ModelComparison:
    """What the data support: ``scores`` with the lowest BIC first, and the sentences on it.

    ``effective_samples`` is the sample size of the BIC; ``x`` (n,) are the points of the curves.
    """

    sentences: tuple[str, ...]
    scores: tuple[ModelScore, ...]
    effective_samples: float
    unit: str
    x: FloatArray
    x_name: str
    x_unit: str
    y_name: str

    def shape(self) -> dict[str, object]:
        """Return the fields of the JSON object."""
        return {
            "sentences": self.sentences,
            "models": self.scores,
            "effective_samples": self.effective_samples,
            "cv_error_unit": self.unit,
        }


@dataclass(frozen=True, eq=False)
class IdentificationResult:
    """Parameters with their uncertainties, and all that a reader needs to check them.

    ``correlation``: (p, p) of the fitted parameters ``correlation_names``. ``cost`` is half the
    sum of squared residuals in units of ``residual_scale`` squared. ``inflation`` is the factor
    by which the coloured residuals widen a white-noise standard error, over all parameters.
    ``visited`` is the range of the input that the data cover, beyond which all is extrapolation.
    ``point`` is given by an analysis whose models can be validated.
    """

    model: str
    method: str
    title: str
    parameters: tuple[ParameterEstimate, ...]
    derived: tuple[ParameterEstimate, ...]
    confidence: float
    correlation_names: tuple[str, ...]
    correlation: FloatArray
    cost: float
    samples: int
    effective_samples: float
    inflation: float
    starts: tuple[StartOutcome, ...]
    curve: Curve
    trials: tuple[TrialFit, ...]
    profiles: tuple[Profile, ...]
    residual_tests: tuple[ResidualTest, ...]
    autocorrelation: Autocorrelation
    preprocessing: Preprocessing
    visited: str
    warnings: tuple[str, ...] = ()
    gate: Gate | None = None
    point: FittedPoint | None = None
    comparison: ModelComparison | None = None
    further: tuple[FurtherTest, ...] = ()  #: of what is open, if the analysis predicts tests
    #: Relative standard uncertainty (of the logarithm) of a parameter by its sources, by name.
    budget: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    #: Chance that a test names or refuses something of a right rig, by its name.
    alarms: Mapping[str, float] = field(default_factory=dict)

    @property
    def false_alarm(self) -> float:
        """Return the largest chance that anything is named or refused of a right rig.

        It is the sum over all tests that were made (Bonferroni), whatever they depend on.
        """
        return min(1.0, sum(self.alarms.values()))

    def parameter(self, name: str) -> ParameterEstimate:
        """Return the fitted or derived parameter ``name``; raise KeyError if there is none."""
        for entry in (*self.parameters, *self.derived):
            if entry.name == name:
                return entry
        raise KeyError(name)

    def to_json(self) -> dict[str, object]:
        """Return an object ready for ``json.dump(..., allow_nan=False)``; open ends are null.

        Sample arrays of the trials are left out: they stand in the recording.
        """
        return plain_object(self)

    def shape(self) -> dict[str, object]:
        """Return the fields of the JSON object."""
        return {
            "model": self.model,
            "method": self.method,
            "title": self.title,
            "confidence": self.confidence,
            "parameters": {parameter.name: parameter for parameter in self.parameters},
            "derived": {item.name: item for item in self.derived},
            self.curve.name: self.curve.points(),
            "visited": self.visited,
            "correlation": {"names": self.correlation_names, "matrix": self.correlation},
            "fit": {
                "cost": self.cost,
                "samples": self.samples,
                "effective_samples": self.effective_samples,
                "inflation": self.inflation,
                **({} if self.point is None else {"point": self.point}),
            },
            "starts": self.starts,
            "trials": self.trials,
            "profiles": self.profiles,
            "residual_tests": self.residual_tests,
            "preprocessing": self.preprocessing,
            "warnings": self.warnings,
            **({"further_tests": self.further} if self.further else {}),
            **({"budget": self.budget} if self.budget else {}),
            **({} if self.gate is None else {"gate": self.gate}),
            **({} if self.comparison is None else {"comparison": self.comparison}),
        }
