"""Fits several groups of trials with the constants of one rig in common.

Each group has unknowns of its own (friction of its floor, local values of its trials); constants
of the rig are shared. The information of all groups together is then an arrow: a block for each
group, and the shared constants that border them. A group whose block is eliminated leaves what its
data show of the shared constants (Schur complement; Triggs et al., Bundle adjustment, 2000, sec.
6.3). Each group is fitted again with what all the others leave as known, from where it was. That is
repeated until the groups agree on the constants: the gradient of the joint cost is then zero, as of
one large fit, but no fit is larger than that of one group. With one group nothing is left, and the
fit stays as it is.

Constants are compared in their own uncertainties, so that one which is stated for each group in
proportion to something (the friction of a guide to the mass that it carries) is shared as well.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from rigd.analysis.fitting.fit import fit
from rigd.analysis.fitting.uncertainty import scaled_pinv
from rigd.analysis.joint_account import ConstantAccount
from rigd.analysis.output_error.estimator import NEAR, OutputErrorFit, conclude
from rigd.analysis.output_error.score import holm
from rigd.analysis.output_error.system import Unknown
from rigd.analysis.output_error.thresholds import THRESHOLDS
from rigd.analysis.output_error.whitened_residuals import Knowledge
from rigd.analysis.result import FloatArray

ROUNDS = 4


@dataclass(frozen=True, eq=False)
class Left:
    """What the data of a group show of shared constants, in their own uncertainties.

    ``information`` (k, k) is that of the constants with all else eliminated, ``aim`` (k,) its
    product with where the data have them, and ``scores`` (k, k) the covariance of ``aim``.
    """

    information: FloatArray
    aim: FloatArray
    scores: FloatArray


@dataclass(frozen=True)
class SharedConstant:
    """A constant that all groups have in common; ``moved`` in its stated uncertainties, ``u`` too.

    ``p_value`` is the chance of such differences between the groups if they have one value.
    """

    name: str
    wording: str
    moved: float
    u: float
    p_value: float


@dataclass(frozen=True, eq=False)
class Joint:
    """The fits (g,) of all groups, and the constants that they share.

    ``differing`` are those on which the groups disagree: ``fits`` are then as they were given.
    """

    fits: tuple[OutputErrorFit, ...]
    constants: tuple[SharedConstant, ...]
    differing: tuple[SharedConstant, ...] = ()

    def constants_account(self) -> dict[str, ConstantAccount]:
        """Return the shared constants by name, in their units."""
        first = self.fits[0].model.system.shared
        stated = {item.parameter.name: item for item in first}
        return {item.name: _account(stated[item.name], item) for item in self.constants}


def join(fits: Sequence[OutputErrorFit], names: Collection[str], blocks: Sequence[int]) -> Joint:
    """Return ``fits`` of the groups of one rig, fitted again with the constants ``names`` shared.

    A constant that some group has left to its data is not shared. ``blocks`` (g,) are the longest
    correlations of the scores that are accounted for, in samples.

    Raises:
        DataError: the cost of a group is not finite where its first fit ended.
    """
    common = [name for name in _stated(fits[0]) if name in names]
    common = [name for name in common if all(name in _stated(item) for item in fits)]
    if len(fits) < 2 or not common:
        return Joint(tuple(fits), ())
    left = [left_by(item, common) for item in fits]
    wordings = {item.parameter.name: item.wording for item in fits[0].model.system.shared}
    p_values = [_chance_of_differences(left, index) for index in range(len(common))]
    differ = holm(p_values, THRESHOLDS.max_p_value_shared)
    known, _, covariance = together(left)
    sds = np.sqrt(np.diag(covariance))
    constants = tuple(
        SharedConstant(name, wordings[name], float(x), float(sd), p)
        for name, x, sd, p in zip(common, known, sds, p_values, strict=True)
    )
    if any(differ):
        found = [item for item, wrong in zip(constants, differ, strict=True) if wrong]
        found.sort(key=lambda item: item.p_value)
        return Joint(tuple(fits), constants, tuple(found))
    current = list(fits)
    for _ in range(ROUNDS):
        current = [
            _with_others(item, left[:k] + left[k + 1 :], common, block)
            for k, (item, block) in enumerate(zip(current, blocks, strict=True))
        ]
        values = np.array([_moved(item, common) for item in current])
        if np.all(np.ptp(values, axis=0) < THRESHOLDS.max_apart_sd * sds):
            break
        left = [left_by(item, common) for item in current]
    known, _, covariance = together([left_by(item, common) for item in current])
    sds = np.sqrt(np.diag(covariance))
    final = [
        replace(item, moved=float(x), u=float(sd))
        for item, x, sd in zip(constants, known, sds, strict=True)
    ]
    return Joint(tuple(current), tuple(final))


def left_by(found: OutputErrorFit, names: Sequence[str]) -> Left:
    """Return what the data of a group show of the constants ``names``, all others eliminated.

    The covariance is from block sums of the scores, as that of the group itself.
    """
    model, places = found.model, _places(found, names)
    others = np.setdiff1d(np.arange(len(found.slope)), places)
    u = 1.0 / np.sqrt(model.precision[places])
    stated = np.diag(model.precision[others])
    own = found.information[np.ix_(others, others)] + stated
    border = found.information[np.ix_(places, others)]
    through = border @ scaled_pinv(own)
    offset = model.precision * (found.fit.scaled - model.prior)
    slope = found.slope[places] - through @ (found.slope + offset)[others]
    reduced = (found.information[np.ix_(places, places)] - through @ border.T) * np.outer(u, u)
    turned = np.zeros((len(places), len(found.slope)))
    turned[:, places], turned[:, others] = np.eye(len(places)), -through
    varied = turned @ found.scores @ turned.T + through @ stated @ through.T
    # Rounding must not leave information that is below none.
    values, vectors = np.linalg.eigh(0.5 * (reduced + reduced.T))
    seen = vectors[:, values > THRESHOLDS.min_shown_share]
    information = (seen * values[values > THRESHOLDS.min_shown_share]) @ seen.T
    aim = information @ _moved(found, names) - seen @ (seen.T @ (slope * u))
    project = seen @ seen.T
    return Left(information, aim, project @ (varied * np.outer(u, u)) @ project)


def together(left: Sequence[Left]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the constants (k,) by all groups and what is stated, inverse and covariance (k, k)."""
    stated = np.eye(len(left[0].aim))
    inverse = scaled_pinv(stated + np.sum([item.information for item in left], axis=0))
    scores = stated + np.sum([item.scores for item in left], axis=0)
    known = inverse @ np.sum([item.aim for item in left], axis=0)
    return known, inverse, np.asarray(inverse @ scores @ inverse)


def _with_others(
    found: OutputErrorFit, others: Sequence[Left], names: Sequence[str], block: int
) -> OutputErrorFit:
    """Return ``found`` fitted on, with what the other groups leave as known."""
    places, count = _places(found, names), len(found.slope)
    roots = np.sqrt(found.model.precision[places])
    information = np.sum([item.information for item in others], axis=0)
    values, vectors = np.linalg.eigh(information)
    seen = vectors[:, values > THRESHOLDS.min_shown_share]
    size = np.sqrt(values[values > THRESHOLDS.min_shown_share])
    rows, scores = np.zeros((len(size), count)), np.zeros((count, count))
    rows[:, places] = size[:, None] * seen.T * roots
    aim = (seen.T @ np.sum([item.aim for item in others], axis=0)) / size
    scores[np.ix_(places, places)] = np.sum([item.scores for item in others], axis=0) * np.outer(
        roots, roots
    )
    known = Knowledge(rows, aim + rows @ found.model.prior, scores)
    model = replace(found.model, elsewhere=known)
    again = fit(
        model,
        found.fit.theta,
        relative_decrease=THRESHOLDS.min_decrease,
        damping=NEAR,
        thorough=True,
    )
    return replace(conclude(model, again, block), others=found.others)


def _chance_of_differences(left: Sequence[Left], index: int) -> float:
    """Return the chance of such differences in one constant if all groups have the same value.

    A score test: each group but the first gets an offset of its own (:mod:`.homogeneity`), if its
    data show one. The variance of the scores is that of all groups' own, and of what is stated.
    """
    known, inverse, _ = together(left)
    scores = np.array([(item.aim - item.information @ known)[index] for item in left[1:]])
    shares = -np.array([item.information[index] @ inverse for item in left[1:]])
    variance = shares @ shares.T
    for number, item in enumerate(left):
        by_group = shares.copy()
        if number > 0:
            by_group[number - 1, index] += 1.0
        variance += by_group @ item.scores @ by_group.T
    direct = np.array([item.scores[index, index] for item in left[1:]])
    used = np.flatnonzero(
        np.diag(variance)
        > THRESHOLDS.min_own_share * np.maximum(direct, THRESHOLDS.min_shown_share)
    )
    if not used.size:
        return 1.0
    statistic = scores[used] @ scaled_pinv(variance[np.ix_(used, used)]) @ scores[used]
    return float(chi2.sf(statistic, used.size))


def _account(stated: Unknown, found: SharedConstant) -> ConstantAccount:
    parameter = stated.parameter
    at_start = parameter.slope(parameter.start)
    value = parameter.natural(parameter.scaled(parameter.start) + found.moved * stated.u)
    return ConstantAccount(
        stated.wording, parameter.unit, parameter.start, stated.u * at_start, value,
        found.u * stated.u * parameter.slope(value),
    )  # fmt: skip


def _stated(found: OutputErrorFit) -> list[str]:
    """Return the names of the shared unknowns of which something is stated."""
    return [item.parameter.name for item in found.model.system.shared if math.isfinite(item.u)]


def _places(found: OutputErrorFit, names: Sequence[str]) -> NDArray[np.intp]:
    every = [item.parameter.name for item in found.model.system.shared]
    return np.array([every.index(name) for name in names], dtype=np.intp)


def _moved(found: OutputErrorFit, names: Sequence[str]) -> FloatArray:
    """Return by how many of its stated uncertainties each constant is moved, (k,)."""
    return np.asarray(found.pulls[_places(found, names)])
