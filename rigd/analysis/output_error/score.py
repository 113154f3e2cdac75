"""Tests whether an addition to the model would improve the fit, and estimates its size.

The test is a score test.

A candidate is a change of the predicted outputs for each unit of something that the model does not
have: one more column d of the Jacobian, whitened as the residuals e are. With the whitened Jacobian
J and the precision P of the constants, the part of d that J cannot represent is
d - J (J'J + P)^-1 J'd. The product of this part with e is the score (Rao, Proc. Camb. Phil. Soc.
44, 1948; Engle, Handbook of Econometrics II, 1984, ch. 13). No candidate is refitted.

The variance of the score is that of white residuals, or that of its block sums (HAC; Newey and
West, Econometrica 55, 1987) if that is larger: other errors colour the residuals, so that every
candidate would look significant. The blocks are those of the residuals that the candidate leaves.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2
from scipy.stats import f as f_distribution

from rigd.analysis.fitting.model import slopes
from rigd.analysis.fitting.uncertainty import scaled_pinv
from rigd.analysis.output_error.estimator import OutputErrorFit
from rigd.analysis.output_error.thresholds import THRESHOLDS
from rigd.analysis.result import FloatArray

Columns = Sequence[FloatArray]  #: of each trial, (n, m, c): change of its outputs for each unit
#: Columns, and whether their amounts differ from trial to trial: c columns become c for each.
Candidate = tuple[Columns, bool]

CLEAR = 0.01  #: p value from which no other covariance can make a test significant
BATCH = 32  #: columns that are whitened at once


@dataclass(frozen=True, eq=False)
class Score:
    """Evidence of the residuals on a candidate with c columns.

    ``gain`` is the fall of -2 ln L that it promises, ``p_value`` the chance of such a gain without
    it. ``size`` (c,) is its amount as a first step gives it, ``sd`` (c,) how well that is known,
    and ``shift`` (p,) the step that the parameters take with it, scaled.
    """

    gain: float
    dof: int
    p_value: float
    size: FloatArray
    sd: FloatArray
    shift: FloatArray


class Scores:
    """A fit, whitened once, against which candidates are tested.

    ``white`` are its whitened residuals, (n, m) for each trial.
    """

    def __init__(self, fit: OutputErrorFit, block: int) -> None:
        """Whiten ``fit``; ``block`` is the longest correlation that is heeded, in samples."""
        model, theta = fit.model, fit.fit.theta
        scale = slopes(model.parameters, theta)
        self._fit, self._rows = fit, block * len(model.system.outputs)
        self._errors: list[FloatArray] = []
        self._jacobians: list[FloatArray] = []
        gradient = model.known.rows.T @ model.prior_residuals(fit.fit.scaled)
        for trial in range(model.trials):
            error, jacobian = model.linearise(trial, theta)
            here = model.columns(trial)
            self._errors.append(error)
            self._jacobians.append(jacobian * scale[here])
            gradient[here] += self._jacobians[-1].T @ error
        self._gradient = gradient

    @property
    def white(self) -> list[FloatArray]:
        """Return the whitened residuals (n, m) of each trial."""
        outputs = len(self._fit.model.system.outputs)
        return [error.reshape(-1, outputs) for error in self._errors]

    @property
    def step(self) -> FloatArray:
        """Return the step (p,) of the scaled parameters to the optimum; bounds push nothing."""
        gradient = np.where(self._fit.on_bound, 0.0, self._gradient)
        return np.asarray(-self._fit.inverse @ gradient)

    def tests(self, candidates: Iterable[Candidate]) -> Iterator[Score]:
        """Yield the evidence of the residuals on each candidate.

        Columns for which the parameters can stand in do not count. Many columns are whitened at
        once: one by one they take five times as long.
        """
        batch: list[Candidate] = []
        wide = 0
        for item in candidates:
            batch.append(item)
            wide += item[0][0].shape[2]
            if wide >= BATCH:
                yield from self._tests(batch)
                batch, wide = [], 0
        if batch:
            yield from self._tests(batch)

    def offsets(self, index: int, shares: FloatArray) -> Score:
        """Return the evidence on offsets of the scaled parameter ``index`` of single trials.

        Trial k has the offsets with ``shares[:, k]``, (c, trials).
        """
        model, width = self._fit.model, len(shares)
        white = [
            jacobian[:, index, None] * shares[:, trial]
            for trial, jacobian in enumerate(self._jacobians)
        ]
        common = np.zeros((len(model.parameters), width))
        information, score = np.zeros((width, width)), np.zeros(width)
        for trial, part in enumerate(white):
            common[model.columns(trial)] += self._jacobians[trial].T @ part
            information += part.T @ part
            score += self._errors[trial] @ part
        places = [slice(0, width)] * model.trials
        return self._score(white, places, common, information, score)

    def _tests(self, batch: Sequence[Candidate]) -> Iterator[Score]:
        model = self._fit.model
        white, by_jacobian, by_error, grams = [], [], [], []
        for trial, (error, jacobian) in enumerate(zip(self._errors, self._jacobians, strict=True)):
            together = np.concatenate([columns[trial] for columns, _ in batch], axis=2)
            part = model.noise[trial].whiten(together).reshape(-1, together.shape[2])
            white.append(part)
            by_jacobian.append(jacobian.T @ part)
            by_error.append(error @ part)
            grams.append(part.T @ part)
        begin = 0
        for columns, each_trial in batch:
            width = columns[0].shape[2]
            own = slice(begin, begin + width)
            begin += width
            count = width * model.trials if each_trial else width
            places = [slice(width * k, width * (k + 1)) if each_trial else slice(0, width)
                      for k in range(model.trials)]  # fmt: skip
            common = np.zeros((len(model.parameters), count))
            information, score = np.zeros((count, count)), np.zeros(count)
            for trial, at in enumerate(places):
                common[model.columns(trial), at] += by_jacobian[trial][:, own]
                information[at, at] += grams[trial][own, own]
                score[at] += by_error[trial][own]
            yield self._score([part[:, own] for part in white], places, common, information, score)

    def _score(
        self, white: Columns, places: Sequence[slice], common: FloatArray, information: FloatArray,
        score: FloatArray,
    ) -> Score:  # fmt: skip
        """Return the evidence on one candidate with c amounts in all.

        ``white`` are its columns, of which those of each trial belong to the amounts at ``places``;
        ``common`` (p, c), ``information`` (c, c) and ``score`` (c,) are their products with the
        Jacobian, with one another and with the residuals.
        """
        fit, model, count = self._fit, self._fit.model, score.size
        step = fit.inverse @ common
        own = information - common.T @ step
        score = score - step.T @ self._gradient
        tiny = np.finfo(np.float64).tiny
        used = np.flatnonzero(
            np.diag(own) > THRESHOLDS.min_own_share * np.maximum(np.diag(information), tiny)
        )
        size, sd = np.zeros(count), np.full(count, np.inf)
        if used.size == 0:
            return Score(0.0, 0, 1.0, size, sd, np.zeros(len(model.parameters)))
        inverse = scaled_pinv(own[np.ix_(used, used)])
        size[used] = -inverse @ score[used]
        gain = float(score[used] @ inverse @ score[used])
        p_value = float(chi2.sf(gain, used.size))
        sd[used] = np.sqrt(np.maximum(np.diag(inverse), 0.0))
        if p_value > CLEAR:
            return Score(gain, int(used.size), p_value, size, sd, -step @ size)
        blocks = self._blocks(white, places, step, size)[:, used]
        coloured = blocks.T @ blocks
        coloured += step[:, used].T @ model.known.scores @ step[:, used]
        inflation = max(1.0, float(np.trace(inverse @ coloured)) / used.size)
        sd *= np.sqrt(inflation)
        p_value = _p_value(gain / inflation, used.size, len(blocks), inflation)
        return Score(gain, int(used.size), p_value, size, sd, -step @ size)

    def _blocks(
        self, white: Columns, places: Sequence[slice], step: FloatArray, size: FloatArray
    ) -> FloatArray:
        """Return the block sums of the scores that are left with ``size``, (blocks, c)."""
        found = []
        for trial, (part, error) in enumerate(zip(white, self._errors, strict=True)):
            own = -self._jacobians[trial] @ step[self._fit.model.columns(trial)]
            own[:, places[trial]] += part
            left = error + own @ size
            edges = np.arange(0, len(error), self._rows)
            found.append(np.add.reduceat(own * left[:, None], edges, axis=0))
        return np.concatenate(found)


def _p_value(statistic: float, dof: int, blocks: int, inflation: float) -> float:
    """Return the chance of ``statistic``; a variance from blocks has the doubt of their number."""
    left = blocks - dof
    if inflation <= 1.0 or left < 1:
        return float(chi2.sf(statistic, dof))
    return float(f_distribution.sf(statistic / dof, dof, left))


def holm(p_values: Sequence[float], level: float) -> list[bool]:
    """Return which hypotheses are rejected so that one false alarm in all has chance ``level``.

    Holm, Scandinavian Journal of Statistics 6 (1979): no assumption on how they depend.
    """
    rejected = [False] * len(p_values)
    for rank, index in enumerate(np.argsort(p_values)):
        if p_values[index] > level / (len(p_values) - rank):
            break
        rejected[index] = True
    return rejected
