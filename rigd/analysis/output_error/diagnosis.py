"""Finds what explains a misfit: fits the best of many candidates with the rest, then the next.

The candidates are everything that a family of rigs defines
(:mod:`rigd.analysis.output_error.structure`), and each constant with an uncertainty, which is then
left to the data. The tests need no fit; only the best candidate is fitted, and one with a name that
promises nearly as much: what a score test shows is right to first order, and of two that promise
the same one may leave much once it is fitted. The better of the two fits stands. One that leaves a
large misfit nearly as it was, or would need a size that it cannot have, is not the cause: the next
is tried. The selection ends if no candidate is significant, or after ``MOST`` candidates: a refusal
is not to take long.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from rigd.analysis.fitting.model import FitParameter, Scaling, scaled_bounds, to_natural
from rigd.analysis.fitting.whiteness import (
    EXCESS,
    Jump,
    LoudBand,
    Shape,
    largest_jump,
    levels,
    loudest_band,
    shape_of,
)
from rigd.analysis.output_error.augmented_system import FAR, Extended, own_parameters
from rigd.analysis.output_error.estimator import OutputErrorFit, estimate
from rigd.analysis.output_error.jackknife import jackknife_sd, without_each_trial
from rigd.analysis.output_error.score import Columns, Score, Scores, holm
from rigd.analysis.output_error.structure import Suspect
from rigd.analysis.output_error.system import System, Unknown
from rigd.analysis.output_error.thresholds import THRESHOLDS
from rigd.analysis.result import Explanation, FloatArray, Meaning
from rigd.model.errors import DataError

MOST = 3  #: things that are added
MOST_OTHERS = 2

#: Returns the candidates at parameters (p,) of the system.
Suspects = Callable[[FloatArray], Iterable[Suspect]]
#: Returns the fit of a system from starts, each (p,), natural; it ends as :func:`.estimate` does.
Refit = Callable[[System, Sequence[FloatArray], int], OutputErrorFit]


@dataclass(frozen=True, eq=False)
class Tested:
    """A candidate, or a constant left to the data (its ``place`` among the shared unknowns)."""

    name: str
    unit: str
    score: Score
    candidate: Suspect | None = None
    place: int = -1

    @property
    def special(self) -> bool:
        """Whether it has a name of its own."""
        return self.candidate is None or self.candidate.special

    @property
    def meaning(self) -> Meaning:
        """What it would make of the parameters."""
        return Meaning.NUISANCE if self.candidate is None else self.candidate.meaning

    @property
    def worth(self) -> float:
        """Return the gain in -2 ln L less what its parameters would gain by chance."""
        return self.score.gain - 2.0 * self.score.dof


@dataclass(frozen=True, eq=False)
class Assumption:
    """What no file states and the data leave open; ``u`` is the standard uncertainty of its size.

    With a size of 1 u the scaled parameters move by ``step`` (p,). ``left`` is the root mean square
    size that the data and u leave open, over u.
    """

    name: str
    u: float
    step: FloatArray
    left: float


@dataclass(frozen=True, eq=False)
class _End:
    """The fit with ``last``, the best variant of ``first``; ``gone`` had no size in it."""

    first: Tested
    last: Tested
    fit: OutputErrorFit
    chosen: list[Tested]
    gone: list[Tested]


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """The last fit, what was added to it, and what is still wrong.

    ``left`` are the tests that are still significant, the worst first; ``levels`` (m,) the mean
    squares of the whitened outputs, which noise leaves at 1, ``worst`` (m,) those of each output's
    worst trial and ``trials`` (m,) which one that is. ``doubts`` (s,) are the steps of the shared
    parameters, scaled, from what was added to each other thing that explains as much, and to a law
    of friction that the data do not show. ``assumptions`` are what no file states.
    """

    fit: OutputErrorFit
    explanations: tuple[Explanation, ...]
    left: tuple[Tested, ...]
    levels: tuple[float, ...]
    worst: tuple[float, ...]
    trials: tuple[int, ...]
    band: LoudBand
    jump: Jump
    shape: Shape
    doubts: tuple[FloatArray, ...] = ()
    assumptions: tuple[Assumption, ...] = ()

    @property
    def coloured(self) -> bool:
        """Whether a band of frequencies, or a jump, shows more than noise."""
        return _coloured(self.band, self.jump)


def diagnose(
    found: OutputErrorFit, candidates: Suspects, starts: Sequence[FloatArray], block: int,
    period_s: float, refit: Refit = estimate,
) -> Diagnosis:  # fmt: skip
    """Return what would explain the misfit of ``found``; nothing if all is well.

    A large misfit may have led to a wrong optimum: then a fit with something more begins from
    ``starts`` (p,), the shared parameters of the first one, too. ``block`` is the longest
    correlation of the scores that is heeded, in samples of ``period_s``. ``refit`` is how a system
    is fitted, if not as others are.
    """
    system = found.model.system
    chosen: list[Tested] = []
    as_good: dict[str, list[Tested]] = {}
    vanished: set[str] = set()
    unfitted: set[str] = set()
    before: list[tuple[OutputErrorFit, list[Tested]]] = []
    while True:
        scores = Scores(found, block)
        tests = [
            *constants(found, scores.step),
            *_tested(scores, candidates(own_parameters(found))),
        ]
        left = sorted(_significant(tests), key=lambda item: -item.worth)
        state = _state(found, scores.white, period_s)
        tried = vanished | unfitted | {item.name for item in chosen}
        new = [item for item in tests if item.name not in tried]
        best = _best(new)
        wrong = bool(left) or state.wrong
        done = any(item.meaning is Meaning.LAW for item in chosen)
        most = max(len(chosen), len(vanished), len(unfitted)) >= MOST
        hopeless = max(state.levels) > THRESHOLDS.max_mean_square_explained
        if not wrong or best is None or most or done or hopeless:
            break
        ends, rivals = [], _rivals(new, best)
        for first in rivals:
            last = _refined(scores, first)
            try:
                with np.errstate(over="raise", invalid="raise"):
                    added = _added(system, found, chosen, last, candidates, starts, block, refit)
            except (DataError, FloatingPointError):  # no motion at all
                continue
            ends.append(_End(first, last, *added))
        if not ends:  # they stay in what is left
            unfitted |= {item.name for item in rivals}
            continue
        end = _preferred(ends)
        if not end.gone and _mean_square(end.fit) > max(
            THRESHOLDS.max_mean_square_right, THRESHOLDS.max_left_share * _mean_square(found)
        ):
            unfitted |= {item.name for item in rivals}
            continue
        before.append((found, chosen))
        found, chosen = end.fit, end.chosen
        vanished |= {item.name for item in end.gone if item is not end.last}
        vanished |= {other.first.name for other in ends if other.last in other.gone}
        near = _as_good(new, end.first)
        as_good[end.last.name] = [item for item in near if item.name not in vanished]
    picked = {item.name for item in chosen}  # what is picked later stands beside, not instead
    as_good = {
        name: [other for other in near if other.name not in picked]
        for name, near in as_good.items()
    }
    unseen = _unseen(new, left)
    assumptions = tuple(_assumptions(new, left))
    open_steps = [item.step * item.left for item in assumptions]
    moved = _Moved(
        before,
        [*(item.score.shift for item in left), *unseen, *open_steps],
        list(without_each_trial(found)) if chosen else [],
    )
    explained = tuple(
        _explanation(system, found, chosen, item, moved, _names(as_good[item.name]))
        for item in chosen
    )
    own = len(system.shared)
    doubts = [
        other.score.shift[:own] - item.score.shift[:own]
        for item in chosen
        for other in as_good[item.name]
    ]
    doubts += [shift[:own] for shift in unseen]
    return Diagnosis(
        found,
        explained,
        tuple(left),
        state.levels,
        state.worst,
        state.trials,
        state.band,
        state.jump,
        state.shape,
        tuple(doubts),
        assumptions,
    )


def _unseen(tests: Sequence[Tested], left: Sequence[Tested]) -> list[FloatArray]:
    """Return the step (p,) with the law of ``tests`` that explains most without being significant.

    What the data just cannot show is in no interval else. It is less by the share that chance would
    gain. A law whose size has an uncertainty of its own is an :class:`Assumption`.
    """
    laws = [item for item in tests if item.meaning is Meaning.LAW and item not in left]
    laws = [item for item in laws if item.candidate is None or item.candidate.u == math.inf]
    best = max(laws, key=lambda item: item.worth, default=None)
    if best is None or best.worth <= 0.0:
        return []
    return [best.score.shift * best.worth / best.score.gain]


def _assumptions(tests: Sequence[Tested], left: Sequence[Tested]) -> Iterator[Assumption]:
    """Yield what has an uncertainty that no file states and is not significant."""
    for item in tests:
        u = math.inf if item.candidate is None else item.candidate.u
        size, sd = item.score.size[0], item.score.sd[0]
        if item in left or u in (0.0, math.inf) or not (math.isfinite(sd) and size):
            continue
        share = u**2 / (u**2 + sd**2)
        open_size = math.hypot(size * share, sd * math.sqrt(share))
        name = item.name.removeprefix("another ")
        yield Assumption(name, u, item.score.shift * (u / size), open_size / u)


def _deviance(found: OutputErrorFit) -> float:
    """Return -2 ln L but for a constant: each fit has noise of its own."""
    noise = sum(whitener.log_scale for whitener in found.model.noise)
    return 2.0 * (found.fit.cost - noise)


def _mean_square(found: OutputErrorFit) -> float:
    """Return the mean square of whitened residuals, 1 if model and noise are right."""
    return 2.0 * found.fit.cost / len(found.model.mask)


@dataclass(frozen=True)
class _State:
    """What whitened residuals are like, without a candidate."""

    levels: tuple[float, ...]
    worst: tuple[float, ...]
    trials: tuple[int, ...]
    band: LoudBand
    jump: Jump
    shape: Shape

    @property
    def wrong(self) -> bool:
        return max(self.levels) > EXCESS or _coloured(self.band, self.jump)


def _coloured(band: LoudBand, jump: Jump) -> bool:
    """Return whether one of two tests, which share a level, shows more than noise (Bonferroni)."""
    return 2.0 * min(band.p_value, jump.p_value) < THRESHOLDS.max_p_value_cause


def _state(found: OutputErrorFit, white: Sequence[FloatArray], period_s: float) -> _State:
    noise, measured = found.model.noise, found.model.system.measured
    there = [item.there for item in noise]
    counted = [item.counted(*parts) for item, *parts in zip(noise, measured, white, strict=True)]
    by_trial = np.array([levels([part], [read]) for part, read in zip(white, there, strict=True)])
    return _State(
        tuple(levels(white, there)),
        tuple(float(x) for x in by_trial.max(axis=0)),
        tuple(int(x) for x in by_trial.argmax(axis=0)),
        loudest_band(white, period_s, counted),
        largest_jump(white, there),
        shape_of(white, int(np.argmax(levels(white, there)))),
    )


def constants(found: OutputErrorFit, step: FloatArray) -> Iterator[Tested]:
    """Yield each constant as if only the data determined it.

    ``step`` (p,) is what the fit has left to go: along a ridge, where parameters stand in for one
    another, it may end before its constants have come back to what is stated of them.

    A constant d from what is stated of it, with the uncertainty u and the variance c in the fit,
    would move on to d u^2/(u^2 - c); under the model d has the variance u^2 - c.
    """
    inverse, pulls = found.inverse, found.pulls
    for place, unknown in enumerate(found.model.system.shared):
        if not math.isfinite(unknown.u) or not unknown.wording:
            continue
        variance, u = float(inverse[place, place]), unknown.u
        share = 1.0 - variance / u**2
        if share < THRESHOLDS.min_determined_share:
            continue
        moved = float(pulls[place]) * u
        # Far from the optimum the step is no forecast: only one that comes back counts.
        moved = min(moved, moved + float(step[place]), key=abs)
        gain = (moved / u) ** 2 / share
        by_noise = variance - variance**2 / u**2
        excess = max(float(found.from_data[place, place]) - by_noise, 0.0)
        p_value = float(chi2.sf(moved**2 / (u**2 * share + excess), 1))
        # With it the others move along their covariance with it.
        shift = inverse[:, place] / variance * moved * (1.0 / share - 1.0)
        score = Score(
            gain, 1, p_value, np.array([moved / share]), np.array([math.sqrt(variance / share)]),
            shift,
        )  # fmt: skip
        name = unknown.wording
        yield Tested(name, unknown.parameter.unit, score, place=place)


def _tested(scores: Scores, candidates: Iterable[Suspect]) -> Iterator[Tested]:
    items = list(candidates)
    found = scores.tests((item.columns(), item.each_trial) for item in items)
    for item, score in zip(items, found, strict=True):
        yield Tested(item.name, item.unit, score, item)


def _significant(tests: Sequence[Tested]) -> list[Tested]:
    rejected = holm([item.score.p_value for item in tests], THRESHOLDS.max_p_value_cause)
    return [
        item
        for item, wrong in zip(tests, rejected, strict=True)
        if wrong and item.worth >= THRESHOLDS.min_gain_constant
    ]


def _best(tests: Sequence[Tested]) -> Tested | None:
    """Return what explains most; a thing with a name if it explains nearly as much."""
    tests = [
        item
        for item in tests
        if item.worth
        >= (THRESHOLDS.min_gain_constant if item.candidate is None else THRESHOLDS.min_gain_suspect)
    ]
    best = max(tests, key=lambda item: item.worth, default=None)
    if best is None:
        return None
    named = max((item for item in tests if item.special), key=lambda item: item.worth, default=best)
    return named if named.worth >= THRESHOLDS.min_named_share * best.worth else best


def _refined(scores: Scores, best: Tested) -> Tested:
    """Return ``best`` in the variant that explains most."""
    if best.candidate is None or best.candidate.near is None:
        return best
    return max(_tested(scores, best.candidate.near()), key=lambda item: item.worth)


def _rivals(tests: Sequence[Tested], best: Tested) -> list[Tested]:
    """Return ``best``, and behind it the thing with a name that promises nearly as much.

    Neighbours of what has variants are none: these are compared already. What is easily taken for
    ``best`` is a rival whatever it promises, and so is the best constant: far from the optimum that
    is no forecast.
    """
    near = [
        item
        for item in _as_good(tests, best)
        if item.special and (_variants(item) is None or _variants(best) is None)
    ]
    like = "" if best.candidate is None else best.candidate.like
    alike = [item for item in tests if item.candidate is not None and item.candidate.like == like]
    constants = [
        item
        for item in tests
        if item.candidate is None and item.worth >= THRESHOLDS.min_gain_constant
    ]
    constants = sorted(constants, key=lambda item: -item.worth)[:1]
    rivals = [best, *near[:1], *constants, *(alike if like else [])]
    return list({item.name: item for item in rivals}.values())


def _variants(item: Tested) -> Callable[[], Iterable[Suspect]] | None:
    return None if item.candidate is None else item.candidate.near


def _preferred(ends: Sequence[_End]) -> _End:
    """Return the end that fits best; of those that the data do not tell apart, a constant's.

    Each added parameter costs what it gains by chance.
    """

    def cost(end: _End) -> float:
        return _deviance(end.fit) + 2.0 * sum(item.score.dof for item in end.chosen)

    able = [end for end in ends if end.fit.converged] or list(ends)
    least = min(map(cost, able))
    near = [end for end in able if cost(end) - least < THRESHOLDS.min_gain_told_apart]
    return next((end for end in near if end.last.candidate is None), near[0])


def _as_good(tests: Sequence[Tested], best: Tested) -> list[Tested]:
    near = [
        item
        for item in tests
        if item.worth > THRESHOLDS.min_rival_share * best.worth and item is not best
    ]
    return sorted(near, key=lambda item: -item.worth)


def _names(tests: Sequence[Tested]) -> tuple[str, ...]:
    return tuple(item.name for item in tests if item.special)[:MOST_OTHERS]


def _added(
    system: System, found: OutputErrorFit, chosen: Sequence[Tested], last: Tested,
    candidates: Suspects, starts: Sequence[FloatArray], block: int, refit: Refit,
) -> tuple[OutputErrorFit, list[Tested], list[Tested]]:  # fmt: skip
    """Return the fit with ``last`` too, what is in it, and what had no size in it and was removed.

    A score test is right close to the optimum only. From far away, a wrong candidate may promise
    most, and have no size once the parameters have moved.
    """
    more = [*chosen, last]
    promised = np.zeros(0) if last.candidate is None else last.score.size
    sizes = np.concatenate([*(_sizes(found, chosen, item) for item in chosen), promised])
    fitted = _refitted(system, found, more, sizes, candidates, starts, block, refit)
    gone = [item for item in more if _vanishes(fitted, more, item)]
    if last in gone:  # beside it, what is right may have no size
        gone = [last]
    if gone:
        kept = [item for item in more if item not in gone]
        sizes = np.concatenate([np.zeros(0), *(_sizes(fitted, more, item) for item in kept)])
        again = _refitted(system, fitted, kept, sizes, candidates, starts, block, refit)
        fitted, more = again, kept
    return fitted, more, gone


def _refitted(
    system: System, found: OutputErrorFit, chosen: Sequence[Tested], sizes: FloatArray,
    candidates: Suspects, starts: Sequence[FloatArray], block: int, refit: Refit,
) -> OutputErrorFit:  # fmt: skip
    """Return the fit with all that was chosen, from ``sizes`` (c,); effects are taken twice.

    A fit from there may end beside the optimum, where slip turns its sign: the better of the two
    is returned.

    Raises:
        DataError: with the fitted motion one of them has more or fewer values than before.
    """
    others = [] if _mean_square(found) < THRESHOLDS.max_mean_square_right else list(starts)
    base = own_parameters(found)
    released = frozenset(item.place for item in chosen if item.candidate is None)
    own = len(system.shared)
    ends: list[OutputErrorFit] = []
    for _ in range(2):
        columns = _side_by_side(_again(chosen, candidates, base), system)
        if columns[0].shape[2] != sizes.size:
            raise DataError("what explains the misfit is another thing once the motion is refitted")
        extended = Extended(system, _unknowns(chosen, sizes), columns, released)
        points = [np.concatenate([start, sizes]) for start in (base[:own], *others)]
        fitted = refit(extended, points, block)
        ends.append(fitted)
        base, others = extended.theta_of_system(fitted.fit.theta), []
        sizes = fitted.fit.theta[own : own + sizes.size]
    able = [end for end in ends if end.converged] or ends[-1:]
    return min(able, key=_deviance)


def _sizes(found: OutputErrorFit, chosen: Sequence[Tested], item: Tested) -> FloatArray:
    """Return the values (c,) of ``item``, one of ``chosen``, in the fit with all of these."""
    return found.fit.theta[_places(found, chosen, item)]


def _unknowns(chosen: Sequence[Tested], sizes: FloatArray) -> tuple[Unknown, ...]:
    found: list[Unknown] = []
    for item in chosen:
        if item.candidate is None:
            continue
        for sd in item.score.sd:
            reach = FAR * float(sd) if math.isfinite(sd) else 1.0
            reach = max(reach, FAR * abs(float(sizes[len(found)])))
            name = f"{item.name} ({len(found)})"
            parameter = FitParameter(name, item.unit, -reach, reach, 0.0, Scaling.LINEAR)
            found.append(Unknown(parameter))
    return tuple(found)


def _again(chosen: Sequence[Tested], candidates: Suspects, theta: FloatArray) -> list[Suspect]:
    """Return what was chosen, taken at the motion of ``theta``; variants as they were."""
    now = {item.name: item for item in candidates(theta)}
    return [
        now.get(item.candidate.name, item.candidate)
        for item in chosen
        if item.candidate is not None
    ]


def _side_by_side(added: Sequence[Suspect], system: System) -> Columns:
    """Return the columns of all that is added, (n, m, c) of each trial."""
    trials = len(system.measured)
    parts = [[np.zeros((*measured.shape, 0))] for measured in system.measured]
    for item in added:
        for trial, columns in enumerate(item.columns()):
            width = columns.shape[2]
            if item.each_trial:
                spread = np.zeros((*columns.shape[:2], width * trials))
                spread[:, :, width * trial : width * (trial + 1)] = columns
                columns = spread
            parts[trial].append(columns)
    return [np.concatenate(part, axis=2) for part in parts]


def _vanishes(fitted: OutputErrorFit, chosen: Sequence[Tested], item: Tested) -> bool:
    """Whether ``item``, one of ``chosen``, has no size in the fit, or one that cannot be."""
    if item.candidate is None:
        stated = fitted.model.system.shared[item.place].parameter
        moved = fitted.fit.scaled[item.place] - stated.scaled(stated.start)
        return bool(
            abs(moved)
            < THRESHOLDS.min_size_sd * math.sqrt(fitted.covariance[item.place, item.place])
        )
    here = _places(fitted, chosen, item)
    sizes = fitted.fit.theta[here]
    least, most = item.candidate.possible
    if np.min(sizes) < least or np.max(sizes) > most:
        return True
    variance = np.maximum(np.diag(fitted.covariance)[here], np.finfo(float).tiny)
    return bool(np.mean(sizes**2 / variance) < THRESHOLDS.min_size_sd**2)


def _places(found: OutputErrorFit, chosen: Sequence[Tested], item: Tested) -> slice:
    """Return the places of the values of ``item``, one of ``chosen``; none of a constant."""
    counts = [0 if other.candidate is None else other.score.size.size for other in chosen]
    place = next(k for k, other in enumerate(chosen) if other is item)
    begin = len(found.model.system.shared) - sum(counts[place:])
    return slice(begin, begin + counts[place])


@dataclass(frozen=True, eq=False)
class _Moved:
    """How far another set of explanations, or fewer trials, move the last fit.

    ``before`` are the fits with fewer explanations, each with these. ``by_more`` (k, p) are the
    steps of the scaled parameters with one more, ``without`` (trials, p) those without each trial.
    """

    before: Sequence[tuple[OutputErrorFit, Sequence[Tested]]]
    by_more: Sequence[FloatArray]
    without: Sequence[FloatArray]

    def sd(self, found: OutputErrorFit, chosen: Sequence[Tested], item: Tested) -> float:
        """Return the standard deviation of the size of ``item`` that they make."""
        size = _size(found, chosen, item)
        more = [_size(found, chosen, item, step) - size for step in self.by_more]
        fewer = [_size(*end, item) - size for end in self.before if item in end[1]]
        trials = [_size(found, chosen, item, step) - size for step in self.without]
        return math.hypot(
            max(map(abs, [*more, *fewer]), default=0.0), jackknife_sd(np.array(trials))
        )


def _explanation(
    system: System, found: OutputErrorFit, chosen: Sequence[Tested], item: Tested, moved: _Moved,
    others: tuple[str, ...],
) -> Explanation:  # fmt: skip
    """Return ``item``, one of ``chosen``, as the fit with all of these has it.

    ``system`` is the rig's own: of its constants none is left to the data. The standard error of
    its size is at least what ``moved`` makes of it.
    """
    sds = np.sqrt(np.maximum(np.diag(found.covariance), 0.0))
    size, by_moved = _size(found, chosen, item), moved.sd(found, chosen, item)
    if item.candidate is None:
        unknown = system.shared[item.place]
        parameter = unknown.parameter
        pull = unknown.pull(size)
        if found.on_bound[item.place]:  # the data ask for more
            pull = math.copysign(max(abs(pull), abs(float(item.score.size[0]) / unknown.u)), pull)
        sd = max(float(sds[item.place]) * parameter.slope(size), by_moved)
        return Explanation(
            item.name, item.unit, size, sd, item.score.gain, "", parameter.start, pull, others,
        )  # fmt: skip
    sd = max(float(np.sqrt(np.mean(sds[_places(found, chosen, item)] ** 2))), by_moved)
    return Explanation(
        item.name, item.unit, size, sd, item.score.gain, item.candidate.look, others=others,
        meaning=item.candidate.meaning,
    )  # fmt: skip


def _size(
    found: OutputErrorFit, chosen: Sequence[Tested], item: Tested, step: FloatArray | None = None
) -> float:
    """Return the size of ``item``, one of ``chosen``, a scaled ``step`` (p,) farther on.

    Of a wave it is the amplitude.
    """
    constant = item.candidate is None
    here = slice(item.place, item.place + 1) if constant else _places(found, chosen, item)
    parameters, scaled = found.model.parameters[here], found.fit.scaled[here]
    if step is not None:
        scaled = np.clip(scaled + step[here], *scaled_bounds(parameters))
    sizes = to_natural(parameters, scaled)
    if sizes.size == 1:
        return float(sizes[0])
    return _amplitude(sizes, 0 if item.candidate is None else item.candidate.harmonics)


def _amplitude(sizes: FloatArray, harmonics: int) -> float:
    """Return the amplitude of the largest harmonic, of all trials the mean; or of any wave."""
    if not harmonics:
        return float(np.sqrt(2.0 * np.mean(sizes**2)))
    power = np.sum(np.reshape(sizes, (-1, 2, harmonics)) ** 2, axis=1)
    return float(np.sqrt(np.max(np.mean(power, axis=0))))
