"""Holds measures of trials, and judges their mean over equal trials by its interval."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Final

from rigd.analysis.measures.mean import EQUAL
from rigd.analysis.measures.trend import Trend, trend_of
from rigd.procedure.program import Measure

#: Coverage probability of every interval.
COVERAGE: Final = 0.95
#: More repeats than these are no advice.
_MOST_REPEATS: Final = 100


class Judgement(Enum):
    """Whether a result is what it must be."""

    ACCEPTED = "accepted"  #: the whole interval lies within the bounds
    REJECTED = "rejected"  #: the whole interval lies outside
    UNDECIDED = "not decided"  #: neither, or there is no interval


@dataclass(frozen=True)
class TrialReading:
    """A measure of one trial, in SI; ``value`` is None if it could not be read: see ``reason``.

    ``u`` is the standard uncertainty of a mean within the trial, from its correlated samples; None
    if it is not a mean, or if it is not determined: see ``note``. ``hidden`` is the part of it in
    what a step of the sensor hides, which equal trials share. ``start_ns`` is when the trial began.
    """

    recording: Path
    trial: int
    value: float | None
    u: float | None = None
    reason: str = ""
    note: str = ""
    start_ns: int = 0
    hidden: float = 0.0


@dataclass(frozen=True)
class Summary:
    """A measure over the trials with equal ``conditions`` (name to text); numbers in SI.

    ``conditions`` are all parameters of the trials, ``setpoints`` those that differ between trials;
    ``point`` has the conditions in SI, to be compared.
    ``mean`` and ``std`` are over the trials that could be read. ``low`` and ``high`` bound the mean
    with a probability of 95 %: repeatability (type A, Student's t), and ``systematic``, the stated
    standard uncertainty of what measures it, which no repeat makes smaller. None: not determined.
    ``runs`` is the number of recordings if there are several with more than one trial: ``mean`` and
    the interval are then those of their means. ``u`` is the standard uncertainty of ``mean`` from
    repeatability, with ``freedom`` degrees of freedom, and from a step of the sensor that hides
    it; 0 if all are equal. ``trend`` is the drift over the trials in their order of play, if there
    is one.
    """

    measure: Measure
    setpoints: Mapping[str, str]
    readings: tuple[TrialReading, ...]
    mean: float | None
    std: float | None
    systematic: float | None
    low: float | None
    high: float | None
    judgement: Judgement | None  #: None if nothing is demanded
    why: str = ""  #: why there is no interval, or no decision
    trend: Trend | None = None
    runs: int | None = None
    u: float | None = None
    freedom: int = 0
    conditions: Mapping[str, str] = field(default_factory=dict)
    point: Mapping[str, str] = field(default_factory=dict)

    @property
    def is_within_run(self) -> bool:
        """Whether all is of one run: then ``u`` does not hold how runs differ."""
        return len({item.recording for item in self.readings if item.value is not None}) == 1

    @property
    def count(self) -> int:
        """Number of trials that could be read."""
        return sum(reading.value is not None for reading in self.readings)


@dataclass(frozen=True)
class UsedConstants:
    """The constants of the rig in the formulas behind a measure: with a stated `u`, and without."""

    measure: str
    uncertain: tuple[str, ...]
    exact: tuple[str, ...]


@dataclass(frozen=True)
class MeasureResult:
    """Everything that was measured in some recordings.

    ``formulas`` are those of the derived channels behind each measure, by channel.
    """

    summaries: tuple[Summary, ...]
    constants: tuple[UsedConstants, ...] = ()
    formulas: Mapping[str, Mapping[str, str]] = field(default_factory=dict)

    @property
    def judgement(self) -> Judgement | None:
        """The verdict on all results together; None if nothing is demanded of any."""
        return outcome_of([item.judgement for item in self.summaries])

    @property
    def unread(self) -> tuple[str, ...]:
        """The measures that could be read in no trial at all."""
        read = {item.measure.name for item in self.summaries if item.count}
        return tuple(dict.fromkeys(
            item.measure.name for item in self.summaries if item.measure.name not in read
        ))  # fmt: skip

    @property
    def is_right(self) -> bool:
        """Whether every measure was read, and no result is rejected or left undecided."""
        return not self.unread and self.judgement in (None, Judgement.ACCEPTED)


def outcome_of(judgements: Sequence[Judgement | None]) -> Judgement | None:
    """Return the verdict on several: rejected if one is, accepted if all are."""
    given = [item for item in judgements if item is not None]
    for outcome in (Judgement.REJECTED, Judgement.UNDECIDED):
        if outcome in given:
            return outcome
    return Judgement.ACCEPTED if given else None


def summary_of(
    measure: Measure,
    setpoints: Mapping[str, str],
    readings: Sequence[TrialReading],
    conditions: Mapping[str, str] | None = None,
    point: Mapping[str, str] | None = None,
) -> Summary:
    """Return ``measure`` over the trials with the same setpoints.

    The interval is that of the mean: mean ± t u, with u^2 = s^2 / n + systematic^2 and the degrees
    of freedom of Welch and Satterthwaite (JCGM 100:2008, 4.2, 5.1 and G.4.1); those of the
    systematic part count as infinite. s and n are those of the trials of one run. Trials of one
    run share what differs from run to run, hence those of several count through the mean of their
    run: s^2 / n is the variance of the mean of a one-way layout with random effects, for runs of
    equal length (Scheffe, The Analysis of Variance, 1959, 7.2). What a step of the sensor hides
    of the scatter counts beside it.
    """
    values = [item.value for item in readings if item.value is not None]
    by_run: dict[Path, list[float]] = {}
    for item in readings:
        if item.value is not None:
            by_run.setdefault(item.recording, []).append(item.value)
    runs = len(by_run) if 1 < len(by_run) < len(values) else None
    independent = [math.fsum(run) / len(run) for run in by_run.values()] if runs else values
    n = len(independent)
    mean = math.fsum(independent) / n if n else None
    systematic = None
    if measure.systematic is not None and mean is not None:
        systematic = measure.systematic.of(mean)
    std = low = high = None
    why = "" if n else "it could be read in no trial"
    if n == 1:
        why = "one trial shows no repeatability: "
        why += (
            f"the other {len(readings) - 1} could not be read"
            if len(readings) > 1
            else "give 'repeats: 2' or more"
        )
    spread, u, fixed = 0.0, None, systematic or 0.0
    if n > 1 and mean is not None:
        std, spread = _std(values), _std(independent)
        if spread <= EQUAL * abs(mean):
            spread = 0.0
        hidden = max(_hidden(values), _hidden_within(readings, _std(values)))
        fixed = math.hypot(fixed, hidden)
        u = spread / math.sqrt(n)
        if spread or fixed:
            half = _half_width(u, n - 1, fixed)
            low, high = mean - half, mean + half
            u = math.hypot(u, hidden)
        else:
            std = std if runs else 0.0
            which = "runs gave the same mean" if runs else "trials gave the same value"
            why = f"all {which}: a step of the sensor hides their scatter, or nothing scatters"
    judgement = None
    if measure.is_judged:
        judgement, why = _judge(measure, readings, low, high, why)
        if judgement is Judgement.UNDECIDED and not why and mean is not None and std is not None:
            why = _advice(measure, mean, spread, n, fixed, "runs" if runs else "trials")
    trend = trend_of([item.value for item in _played(readings) if item.value is not None])
    return Summary(
        measure, setpoints, tuple(readings), mean, std, systematic, low, high, judgement, why,
        trend, runs, u, max(n - 1, 0), conditions or {}, point or {},
    )  # fmt: skip


def _played(readings: Sequence[TrialReading]) -> list[TrialReading]:
    """Return ``readings`` in the order of play.

    Runs in virtual time may begin at one moment: they follow one another as they were given.
    """
    begun: dict[Path, int] = {}
    for item in readings:
        begun[item.recording] = min(item.start_ns, begun.get(item.recording, item.start_ns))
    runs = sorted(begun, key=begun.__getitem__)
    return sorted(readings, key=lambda item: (runs.index(item.recording), item.start_ns))


def _std(values: Sequence[float]) -> float:
    """Return the standard deviation of a sample of two values or more."""
    mean = math.fsum(values) / len(values)
    # No square is made: those of values beyond 1e154 are no numbers.
    return math.hypot(*(value - mean for value in values)) / math.sqrt(len(values) - 1)


def _hidden(values: Sequence[float]) -> float:
    """Return the standard uncertainty in what a step of the sensor hides; 0 if scatter shows.

    Values that come again are rounded. If they scatter by less than half the step between them,
    their mean may be off by up to half of it, as one value may (JCGM 100:2008, F.2.2.1).
    """
    ordered = sorted(values)
    apart = [after - value for value, after in itertools.pairwise(ordered)]
    steps = [gap for gap in apart if gap > EQUAL * max(abs(ordered[0]), abs(ordered[-1]))]
    if not steps or len(steps) == len(apart) or not _std(values) < 0.5 * min(steps):
        return 0.0
    return min(steps) / math.sqrt(12.0)


def _hidden_within(readings: Sequence[TrialReading], std: float) -> float:
    """Return the standard uncertainty in what a step hides within each trial; 0 if they scatter.

    ``std`` is the scatter of the trials: by half a step or more, it is no longer the same in all.
    """
    hidden = max(item.hidden for item in readings)
    return hidden if std < 0.5 * math.sqrt(12.0) * hidden else 0.0


def _advice(measure: Measure, mean: float, std: float, n: int, systematic: float, what: str) -> str:
    """Return whether more of ``what`` would decide, and how many, if mean and ``std`` stay."""
    across = "the interval lies across a bound"
    apart = min(abs(mean - measure.low), abs(mean - measure.high))
    if apart <= _half_width(0.0, n - 1, systematic):
        nearly = "the mean lies at the bound" if not systematic else "'u' alone reaches the bound"
        return f"{across}: {nearly}, and more repeats do not help"
    # The smallest n whose half width is below the distance to the bound; it falls with n.
    enough = n
    while enough <= _MOST_REPEATS:
        if _half_width(std / math.sqrt(enough), enough - 1, systematic) < apart:
            return f"{across}: about {enough} {what} would decide it, if mean and s stay so"
        enough = max(enough + 1, round(1.05 * enough))
    return (
        f"{across}: the mean lies so near to the bound that {_MOST_REPEATS} {what} would not "
        "decide it"
    )


def _half_width(u: float, freedom: int, systematic: float) -> float:
    from scipy.stats import norm, t

    together = math.hypot(u, systematic)
    if together == 0.0:
        return 0.0
    share = u / together
    tail = 0.5 + COVERAGE / 2
    if share**4 < 1e-9:  # t is that of the normal distribution
        return float(norm.ppf(tail)) * together
    return float(t.ppf(tail, freedom / share**4)) * together


def _judge(
    measure: Measure,
    readings: Sequence[TrialReading],
    low: float | None,
    high: float | None,
    why: str,
) -> tuple[Judgement, str]:
    missing = sum(item.value is None for item in readings)
    if low is None or high is None:
        return Judgement.UNDECIDED, why
    if missing:
        return Judgement.UNDECIDED, f"{missing} of {len(readings)} trials could not be read"
    if measure.low <= low and high <= measure.high:
        return Judgement.ACCEPTED, ""
    if high < measure.low or low > measure.high:
        return Judgement.REJECTED, "the whole interval lies outside"
    return Judgement.UNDECIDED, ""  # across a bound
