"""Tests whether all trials, and all recordings, share one level of a parameter (score test).

Each recording gets an offset of its own from the fitted value, the first 0. With the whitened
Jacobian J, the column c of the parameter restricted to some trials and innovations e, the score c'e
has the variance c'c - c'J (J'J + P)^-1 J'c, with the precision P of the constants (Rao, Proc. Camb.
Phil. Soc. 44, 1948). Nothing is refitted. A trend over the trials in their order is an offset that
grows from the first to the last.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from rigd.analysis.model import slopes
from rigd.analysis.output_error import OutputErrorFit
from rigd.analysis.report.rounding import probability
from rigd.analysis.result import FloatArray, ResidualTest
from rigd.analysis.uncertainty import scaled_pinv

#: A change is named below this chance, if none were there.
LEVEL = 1e-4
LEAST_SHARE = 1e-9  #: of an offset's information that no other parameter takes


@dataclass(frozen=True, eq=False)
class Offsets:
    """Result of a score test: ``size`` (g,) in scaled coordinates is what a first step gives."""

    statistic: float
    p_value: float
    size: FloatArray

    @property
    def found(self) -> bool:
        """Whether chance does not explain the offsets."""
        return self.p_value < LEVEL


class Levels:
    """The level of the scaled parameter ``index`` in each trial of a fit."""

    def __init__(self, fit: OutputErrorFit, index: int) -> None:
        """Whiten ``fit`` once more, and keep the products that the tests need."""
        model, theta = fit.model, fit.fit.theta
        scale = slopes(model.parameters, theta)
        self._fit = fit
        self._scores = np.zeros(model.trials)
        self._squares = np.zeros(model.trials)
        self._mixed = np.zeros((model.trials, len(scale)))
        for trial in range(model.trials):
            error, jacobian = model.linearise(trial, theta)
            here = model.columns(trial)
            column = jacobian[:, index] * scale[index]
            self._scores[trial] = column @ error
            self._squares[trial] = column @ column
            self._mixed[trial, here] = (column @ jacobian) * scale[here]

    def differ(self, groups: Sequence[int]) -> Offsets:
        """Return whether groups have levels of their own; ``groups`` (trials,) numbers them."""
        numbers = np.asarray(groups)
        members = [(numbers == number).astype(float) for number in np.unique(numbers)[1:]]
        return self._test(np.array(members))

    def trend(self) -> Offsets:
        """Return whether the level rises or falls steadily; the size is last minus first."""
        count = len(self._scores)
        return self._test((np.arange(count) / max(count - 1, 1) - 0.5)[None, :])

    def _test(self, shares: FloatArray) -> Offsets:
        """Return the test of offsets that trial k has with ``shares`` (g, trials).

        One for which other parameters stand in is none: its size is 0.
        """
        mixed = shares @ self._mixed
        direct = (shares * self._squares) @ shares.T
        variance = direct - mixed @ self._fit.inverse @ mixed.T
        used = np.flatnonzero(np.diag(variance) > LEAST_SHARE * np.diag(direct))
        sizes = np.zeros(len(shares))
        if not used.size:
            return Offsets(0.0, 1.0, sizes)
        scores = shares[used] @ self._scores
        inverse = scaled_pinv(variance[np.ix_(used, used)])
        sizes[used] = -inverse @ scores
        statistic = float(scores @ inverse @ scores)
        return Offsets(statistic, float(chi2.sf(statistic, used.size)), sizes)


@dataclass(frozen=True)
class TrialParts:
    """Parts of trials that should share a parameter; ``names`` (trials,) has that of each trial.

    ``kind`` is what the parts are, such as recordings; ``advice`` is given if they disagree.
    """

    kind: str
    names: Sequence[str]
    advice: str


def homogeneity(
    fit: OutputErrorFit, index: int, what: str, parts: Sequence[TrialParts]
) -> tuple[ResidualTest, ...]:
    """Return the tests of the level of parameter ``index``, which a person calls ``what``.

    The trials are in the order in which they were played; ``parts`` of only one name are no test.
    """
    levels = Levels(fit, index)
    trend = levels.trend()
    way = "rises" if trend.size[0] > 0.0 else "falls"
    found = [
        ResidualTest(
            f"steady {what}",
            trend.statistic,
            trend.p_value,
            not trend.found,
            f"The {what} {way} from trial to trial ({probability(trend.p_value)}): wear, warming "
            "or dirt? Clean the contact, let it warm up, record again."
            if trend.found
            else f"The {what} neither rises nor falls over the trials.",
        )
    ]
    for part in parts:
        names = list(dict.fromkeys(part.names))
        if len(names) < 2:
            continue
        apart = levels.differ([names.index(name) for name in part.names])
        found.append(
            ResidualTest(
                f"agreement of {part.kind}",
                apart.statistic,
                apart.p_value,
                not apart.found,
                f"{', '.join(names)} disagree on the {what} ({probability(apart.p_value)}). "
                f"{part.advice}"
                if apart.found
                else f"{', '.join(names)} agree on the {what}.",
            )
        )
    return tuple(found)


def changes(tests: Sequence[ResidualTest]) -> tuple[str, ...]:
    """Return the sentences of ``tests`` of :func:`homogeneity` that found a change, last first."""
    return tuple(test.sentence for test in reversed(tests) if not test.passed)
