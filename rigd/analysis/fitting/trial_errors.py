"""Finds errors that last for whole trials, or long parts of them, in residuals of a model.

Load, temperature, wear or another law move the output of a whole trial. Samples of one trial then
share an error, and intervals that count the samples are too narrow. With m_j the mean residual of
block j of n_j samples, s^2 the variance within blocks and t its autocorrelation time, the sum of
n_j m_j^2 / (s^2 t) is a chi-square number if nothing lasts, with as many degrees of freedom as
blocks less parameters (lack of fit against pure error: Draper and Smith, Applied Regression
Analysis, 3rd ed. 1998, 2.1). Blocks are trials, and parts of trials.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2, t

from rigd.analysis.fitting.uncertainty import autocorrelation_time
from rigd.analysis.result import FitOutcome, FloatArray, Gate

PARTS = (1, 2, 4, 6, 8)  #: of each trial
LEVEL = 0.005  #: chance of a false alarm in all of these
FEWEST = 8  #: samples of a block
LEAST = 1e-9  #: of the size of the output: less is of the arithmetic
QUANTILE = float(chi2.ppf(0.95, 1))
LONGER = 5  #: times the longest correlation that is accounted for: least length of a part


@dataclass(frozen=True)
class Lasting:
    """An error that lasts: its ``rms``, and ``ratio`` of it to what noise within blocks leaves.

    ``inflation`` of the variance, relative to independent samples, holds it in profiles, and
    ``spread`` in standard errors: both with Student's t for so few blocks.
    """

    inflation: float
    spread: float
    rms: float
    ratio: float
    parts: int

    def gate(self, unit: str, scale: float) -> Gate:
        """Return what is said of it; ``scale`` times a residual is in ``unit``."""
        where = "trials" if self.parts == 1 else f"parts of trials ({self.parts} of each)"
        size = f"{self.rms * scale:.2g}" + ("" if unit == "1" else f" {unit}")
        finding = (
            f"{where} lie {size} off it (rms), {self.ratio:.2g} times what "
            "the noise within them leaves. The intervals are widened for that. Compare load, "
            "temperature, wear, zero and range of the sensors, or fit another law."
        )
        sentence = f"The model fits these data only beside an error that lasts: {finding}"
        return Gate(FitOutcome.CORRECTED, sentence, (finding,))


def lasting(
    residuals: FloatArray, mask: FloatArray, trials: Sequence[slice], parameters: int, block: int
) -> Lasting | None:
    """Return the error that lasts longest and counts most; None if chance makes as much.

    ``block`` is the longest correlation, in samples, that is accounted for anyway.
    """
    pieces = [residuals[part][mask[part] > 0.0] for part in trials]
    found = []
    for parts in PARTS:
        blocks = [x for piece in pieces for x in np.array_split(piece, parts)]
        freedom = len(blocks) - parameters
        if freedom < 1 or min(map(len, blocks)) < max(FEWEST, LONGER * block if parts > 1 else 0):
            continue
        counts = np.array([len(item) for item in blocks])
        means = np.array([np.mean(item) for item in blocks])
        within = np.concatenate([x - m for x, m in zip(blocks, means, strict=True)])
        ends = np.cumsum([0, *counts])
        slices = [slice(a, b) for a, b in itertools.pairwise(ends)]
        time = autocorrelation_time(within, np.ones(len(within)), slices, block)
        # The mean that is subtracted takes a share of each covariance away (:mod:`.measures.mean`).
        time *= 1.0 + (2 * block + 1) / int(np.min(counts))
        pure = float(within @ within) / max(len(within) - len(blocks), 1) * time
        pure = max(pure, float(np.finfo(np.float64).tiny))
        between = float(np.sum(counts * means**2))
        if not between > np.sum(counts) * LEAST**2 or not chi2.sf(
            between / pure, freedom
        ) < LEVEL / len(PARTS):
            continue
        whole = np.concatenate(blocks)
        variance = between / freedom / float(np.mean(whole**2))
        student = float(t.ppf(0.975, freedom)) ** 2
        # A profile compares n/t ln(S/S_min): that alone makes it wider for few blocks.
        profile = freedom * math.log1p(student / freedom) / QUANTILE
        found.append(
            Lasting(
                variance * profile, variance * student / QUANTILE,
                math.sqrt(between / float(np.sum(counts))), math.sqrt(between / freedom / pure),
                parts,
            )
        )  # fmt: skip
    return max(found, key=lambda item: item.inflation, default=None)
