"""What an identification hands on: plain frozen data that a report or a file is made from.

Every number a person reads stands beside its unit, its interval and a verdict. An end of an
interval that the data leave open is ``None``, never a large number.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from rigd.analysis.plain import plain_object

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


class Verdict(Enum):
    """How far the data determine a parameter."""

    IDENTIFIABLE = "identifiable"
    WEAK = "weakly identifiable"
    BIASED = "biased by this method"  #: a narrow interval whose place is wrong; see the sentence
    UNIDENTIFIABLE = "not identifiable from this excitation"
    UNRESOLVED = "not identifiable by this method"  #: the data close it, the method moves it


@dataclass(frozen=True)
class ParameterEstimate:
    """One parameter: ``estimate`` with its interval in ``unit``, and what to think of it.

    ``low`` and ``high`` bound the interval at the result's confidence; ``None`` where the data
    leave that end open, and both ``None`` when the parameter is not ``identifiable``. Only
    ``quoted`` is for people: ``estimate`` is where the fit ended, whatever that is worth.
    ``source`` says where the interval comes from (``"covariance"`` or ``"profile"``).
    ``standard_error`` is in ``unit``; ``None`` where the curvature carries no information.
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

    @property
    def identifiable(self) -> bool:
        """Whether an interval may be quoted: false when the data or the method do not allow one."""
        return self.verdict in (Verdict.IDENTIFIABLE, Verdict.WEAK)

    @property
    def quoted(self) -> float | None:
        """The estimate where a person may be shown it, None where only the fit may use it.

        An interval that is open on both sides, or a verdict that it is not identifiable, leaves
        none: table, report and JSON object agree.
        """
        if self.verdict in (Verdict.UNIDENTIFIABLE, Verdict.UNRESOLVED):
            return None
        return self.estimate if self.low is not None or self.high is not None else None

    def shape(self) -> dict[str, object]:
        """Return the keys of the JSON object; no number where none may be quoted."""
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
    """A fitted characteristic with its band, on the range the data visited and no further.

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

    def shape(self) -> dict[str, object]:
        """Return the keys of the JSON object: samples stand in the recording."""
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
    lie inside the interval. ``low``/``high`` are ``None`` where the profile never crosses.
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
        """Return the keys of the JSON object."""
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
    """Residual autocorrelation: (n,) ``lag_s`` and ``value``; white stays within ``±band``."""

    lag_s: FloatArray
    value: FloatArray
    band: float


@dataclass(frozen=True)
class StartOutcome:
    """Where one start of a multi-start fit went; parameters in their units, by name."""

    start: Mapping[str, float]
    end: Mapping[str, float]
    cost: float
    iterations: int
    converged: bool


@dataclass(frozen=True)
class TrialRejection:
    """A trial that was left out of the fit, and why."""

    label: str
    reason: str


@dataclass(frozen=True)
class Preprocessing:
    """What was done to the data before the fit, in words and numbers that can be repeated."""

    statements: tuple[str, ...]
    settings: Mapping[str, float | str]
    per_trial: Mapping[str, Mapping[str, float]]
    rejected: tuple[TrialRejection, ...] = ()


@dataclass(frozen=True, eq=False)
class IdentificationResult:
    """Parameters with honest uncertainties, and all that is needed to doubt them.

    ``correlation``: (p, p) of the fitted parameters ``correlation_names``. ``cost`` is half the
    sum of squared residuals in units of ``residual_scale`` squared. ``inflation`` is the factor
    by which the coloured residuals widen a white-noise standard error, over all parameters.
    ``visited`` says which range of the input the data cover, beyond which all is extrapolation.
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
        """Return the keys of the JSON object."""
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
            },
            "starts": self.starts,
            "trials": self.trials,
            "profiles": self.profiles,
            "residual_tests": self.residual_tests,
            "preprocessing": self.preprocessing,
            "warnings": self.warnings,
        }
