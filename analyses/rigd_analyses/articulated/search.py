"""Fits the contacts of the robot in two stages: first without sliding, then with all trials."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from rigd.analysis import DataError
from rigd.analysis.fitting.fit import Fit, fit
from rigd.analysis.fitting.identifiability import Z_95
from rigd.analysis.fitting.model import slopes, to_natural, to_scaled
from rigd.analysis.fitting.uncertainty import scaled_pinv
from rigd.analysis.output_error.estimator import NEAR, Branch, OutputErrorFit, conclude
from rigd.analysis.output_error.system import SomeTrials, System
from rigd.analysis.output_error.thresholds import THRESHOLDS
from rigd.analysis.output_error.whitened_residuals import OutputErrorModel, noise_at
from rigd.analysis.result import FloatArray
from rigd_analyses.articulated.reading import RobotTrial
from rigd_analyses.articulated.system import RATIO, SHARED, RobotSystem
from rigd_analyses.articulated.thresholds import ROBOT

SCORES: Final = 10  #: frames, 0.4 s: longest correlation of the scores that is accounted for
ROUNDS: Final = 2  #: of choosing trials without sliding and fitting them roughly
ITERATIONS: Final = 30  #: of a fit; 10 end one in five before its optimum
FRICTION: Final = (SHARED.index("mu_d"), SHARED.index(RATIO))
FIRST_S: Final = 8.0  #: of each trial without sliding that the first fit takes
SLIDING_S: Final = 2.0  #: of each other trial that mu_s and mu_d are first sought in
#: s of these trials in which that is done, one after the other while the fit is wrong; a coarse
#: mu_d is sought in the first.
SOUGHT_S: Final = (1.0, 2.0, 4.0, math.inf)
CLOSE: Final = tuple(np.exp(0.02 * np.arange(-4, 5)))  #: shares of it that are tried
CLOSE_RATIOS: Final = tuple(np.exp(0.02 * np.arange(1, 47)))  #: with as many mu_s over it
LONGER: Final = 1.25  #: times: by how much the next begin of the sliding trials is longer
AROUND: Final = tuple(np.exp(0.005 * np.arange(-12, 13)))  #: shares of the mu_s of the one before
KINETIC: Final = (0.1, 0.15, 0.22, 0.33, 0.45, 0.55, 0.65, 0.8, 1.0, 1.4)  #: sought mu_d
RATIOS: Final = (1.05, 1.2, 1.35, 1.5, 1.7, 2.0, 2.5)  #: and mu_s over it
#: Shares of the mu_s that a fit has found, which are tried besides.
AGAIN: Final = tuple(
    1.0 + sign * off
    for off in (0.0025, 0.005, 0.0075, 0.01, 0.015, 0.02, 0.03, 0.05, 0.08, 0.15)
    for sign in (-1.0, 1.0)
)
MOST_BETTER: Final = 3
MOST_FURTHER: Final = 3  #: fits after one that has not converged
#: Shares of mu_s N over which contacts may let go gradually, half of each; and by how many of these
#: mu_s is larger then.
WIDTHS: Final = (0.02, 0.035, 0.05, 0.075, 0.1, 0.15)
UP: Final = (0.1, 0.25, 0.4, 0.55, 0.7, 0.9, 1.2)
NO_SLIDING: Final = (5.0, 4.0)  #: mu_d and its ratio at which nothing slides
CHORD_S: Final = 0.4  #: of the way by the camera: noise would lengthen shorter ones


@dataclass(frozen=True, eq=False)
class RobotFit:
    """The fit of all trials, and which of them have contacts that may slide."""

    system: RobotSystem
    whole: OutputErrorFit
    sliding: tuple[int, ...]
    sd: float = 0.0  #: standard error of the logarithm of mu_s / mu_d, by the shape of its cost

    def refitted(self, system: System, starts: Sequence[FloatArray], _: int) -> OutputErrorFit:
        """Return the fit of a system with something more, from the first start (p,).

        It ends as the fit of the robot does: the cost has steps if contacts slide, at which no
        number of iterations brings an exact end.
        """
        local = [item.parameter.start for item in system.local]
        theta = np.concatenate([starts[0], np.tile(local, len(system.measured))])
        return _widened(conclude(*_fitted(system, theta), SCORES), self.sd)


def find(system: RobotSystem, grip: float, notify: Callable[[str], None]) -> RobotFit:
    """Return the fit of all trials, in two stages; ``grip`` is the share that certainly grips.

    The first takes the trials in which no contact slides; the second all, with all parameters.

    Raises:
        DataError: every trial slides, or the data cannot answer.
    """
    check_way(system)
    point, sliding = _first_stage(system, grip, notify)
    if sliding:
        notify(f"contacts slide in {len(sliding)} of {len(system.trials)} trials")
        gripping = point
        point = _begin_sliding(system, sliding, gripping, SLIDING_S)
    branch = _fitted(system, _theta(system, point))
    counted = _counted(system)

    def is_wrong(ended: Fit) -> bool:
        return 2.0 * ended.cost > ROBOT.max_mean_square * counted

    def is_elsewhere(branch: Branch) -> bool:
        """Whether the optimum may be another: a contact that slides as it grips is none."""
        return is_wrong(branch[1]) or branch[1].theta[FRICTION[1]] < ROBOT.min_ratio

    if sliding and is_elsewhere(branch):
        kinetic = _begin_sliding(system, sliding, gripping, SOUGHT_S[0])[FRICTION[0]]
        close, points = kinetic * np.array(CLOSE), list[FloatArray]()
        for seconds in SOUGHT_S:
            point = _begin_sliding(system, sliding, gripping, seconds, close, CLOSE_RATIOS)
            points.append(point)
            other = _fitted(system, _theta(system, point))
            branch = min(branch, other, key=lambda item: item[1].cost)
            if not is_elsewhere(branch):
                break
        else:
            other = _lengthened(system, sliding, points[0], branch)
            branch = min(branch, other, key=lambda item: item[1].cost)
    if not sliding:
        return RobotFit(system, conclude(*branch, SCORES), ())
    for _ in range(MOST_FURTHER):
        model, ended, sd = _rescanned(system, sliding, branch)
        ended_at = _widened(conclude(model, ended, SCORES), sd)
        # Small steps along a ridge end before its lowest place; a step of the cost may be beside.
        if ended_at.converged or is_wrong(ended):
            break
        starts = (ended.theta, _beyond(ended_at))
        further = [(model, ended), *(_fitted(system, start) for start in starts)]
        branch = min(further, key=lambda item: item[1].cost)
        if branch[1].cost > ended.cost - ROBOT.min_decrease * ended.cost:
            break
    if not is_wrong(ended):
        ended_at = _with_step(ended_at)
    return RobotFit(system, ended_at, tuple(sliding), sd)


def sliding_trials(system: RobotSystem, grip: float) -> list[int]:
    """Return the trials in which contacts that are known carry more than ``grip`` of their load."""
    point = np.array([item.parameter.start for item in system.shared])
    point[list(FRICTION)] = NO_SLIDING
    return _sliding(system, point, grip)


def tried(system: RobotSystem, sliding: Sequence[int]) -> OutputErrorFit:
    """Return the fit of trials to a system whose contacts are known.

    The instants at which contacts slide make steps in its cost: close values of mu_s are tried.
    """
    point = np.array([item.parameter.start for item in system.shared])
    if not sliding:
        point[list(FRICTION)] = np.where(
            [SHARED[k] in system.known for k in FRICTION], point[list(FRICTION)], NO_SLIDING
        )
    branch = _fitted(system, _theta(system, point))
    if sliding:
        branch, _ = _scanned(system, sliding, branch)
    return conclude(*branch, SCORES)


def fitted_from(system: System, theta: FloatArray) -> OutputErrorFit:
    """Return the fit from ``theta`` (p,). The noise is that of the sensors, the same everywhere."""
    return conclude(*_fitted(system, theta), SCORES)


def _fitted(system: System, theta: FloatArray) -> Branch:
    model = OutputErrorModel(system, noise_at(system, theta))
    ended = fit(
        model, theta, max_iterations=ITERATIONS, relative_decrease=ROBOT.min_decrease, damping=NEAR,
        thorough=True, ridges=True,
    )  # fmt: skip
    return model, ended


def check_way(system: RobotSystem) -> None:
    """Check that the wheels go as far as the camera sees the robot go.

    Slip is some per cent at most, but while contacts slide.

    Raises:
        DataError: in the median trial they do not.
    """
    radius, n = system.constants["wheel_radius"][0], system.gear_ratio
    refuse_wrong_way(way_share(system.trials, radius / n, (0, 1), 0), radius, n)


def way_share(
    trials: Sequence[RobotTrial], lever_m: float, motors: Sequence[int], marker: int
) -> float:
    """Return the way by the camera over that by the wheels, in the median trial.

    ``lever_m`` is the way for each radian of a motor; ``motors`` are the columns of the speeds of
    one module, ``marker`` the first one of its poses.
    """
    ratios = []
    for item in trials:
        ways = np.sum(np.abs(item.speeds[item.at][:, motors]), axis=0) * item.period_s
        turned = lever_m * float(np.mean(ways))
        last = len(item.poses) - 1
        at = np.append(np.arange(0, last, max(1, round(CHORD_S / item.period_s))), last)
        steps = np.hypot(*np.diff(item.poses[at, marker : marker + 2], axis=0).T)
        if turned > 0.0:
            ratios.append(float(np.sum(steps)) / turned)
    return float(np.median(ratios)) if ratios else 1.0


def refuse_wrong_way(ratio: float, radius: float, n: float) -> None:
    """Refuse a way by the camera that is ``ratio`` times that of wheels with a ``radius`` in m.

    ``n`` is the gear ratio.

    Raises:
        DataError: the way is another one.
    """
    if abs(ratio - 1.0) <= ROBOT.max_way_share:
        return
    if abs(ratio / n - 1.0) < ROBOT.max_way_share:
        guess = f"that is the gear ratio {n:g}: the speeds are those of the wheels, not the motors"
    else:
        guess = (
            f"compare wheel_radius ({radius:g} m), gear_ratio ({n:g}; {n / ratio:.3g} would fit), "
            "the camera's unit of length, and on which side of the gear speeds are taken"
        )
    raise DataError(
        f"the camera sees the robot go {ratio:.3g} times as far as its wheels turn", hint=guess
    )


def _first_stage(
    system: RobotSystem, grip: float, notify: Callable[[str], None]
) -> tuple[FloatArray, list[int]]:
    """Return shared parameters (p,) from the trials without sliding, and the other trials.

    Raises:
        DataError: a contact may slide in each trial.
    """
    point = np.array([item.parameter.start for item in system.shared])
    point[list(FRICTION)] = NO_SLIDING
    chosen: list[int] = []
    for _ in range(ROUNDS):
        shares = [system.share(k, point) for k in range(len(system.trials))]
        before, chosen = chosen, [k for k, share in enumerate(shares) if share <= grip]
        if not chosen:
            raise DataError(
                f"a contact carries more than {grip:g} times its load in each trial",
                hint="record slower circles, and straight runs with a ramp; if the contacts grip "
                "better, state a higher certain_grip",
            )
        if chosen != before:
            notify(f"{len(chosen)} of {len(shares)} trials without sliding are fitted first")
            part = replace(system, trials=tuple(system.trials[k].first(FIRST_S) for k in chosen))
            point = _rough(part, point)
    return point, _sliding(system, point, grip)


def _sliding(system: RobotSystem, point: FloatArray, grip: float) -> list[int]:
    shares = [system.share(k, point) for k in range(len(system.trials))]
    return [k for k, share in enumerate(shares) if share > grip]


def _rough(system: RobotSystem, point: FloatArray) -> FloatArray:
    """Return the shared parameters (p,) of a rough fit from ``point``."""
    theta = _theta(system, point)
    model = OutputErrorModel(system, noise_at(system, theta))
    ended = fit(model, theta, max_iterations=ITERATIONS, relative_decrease=ROBOT.min_decrease_first)
    return ended.theta[: len(SHARED)]


def _theta(system: RobotSystem, point: FloatArray) -> FloatArray:
    local = [item.parameter.start for item in system.local]
    return np.concatenate([point, np.tile(local, len(system.trials))])


def _begin_sliding(
    system: RobotSystem, sliding: Sequence[int], point: FloatArray, seconds: float,
    kinetic: Iterable[float] = KINETIC, ratios: Iterable[float] = RATIOS,
) -> FloatArray:  # fmt: skip
    """Return ``point`` with the best of some mu_d and mu_s for the begin of the sliding trials.

    Whether a contact slides for a moment more or less decides over the rest of the way: between two
    coarse steps the cost of the right ones may not be seen, but for the first second.
    """
    part = replace(system, trials=tuple(system.trials[k].first(seconds) for k in sliding))
    model = OutputErrorModel(part, noise_at(part, _theta(part, point)))
    best, least = point, math.inf
    for pair in itertools.product(kinetic, ratios):
        other = point.copy()
        other[list(FRICTION)] = pair
        if (cost := _cost(model, _theta(part, other), least)) < least:
            best, least = other, cost
    return best


def _lengthened(
    system: RobotSystem, sliding: Sequence[int], point: FloatArray, found: Branch
) -> Branch:
    """Return the fit by longer and longer begins of the sliding trials, each from the one before.

    A contact that slides a little earlier moves the end of a long trial by more than its slopes
    tell: a fit of all of it leaves a good point. So mu_s is sought again before each. It is
    ``found`` if the model does not fit one of these parts.
    """
    theta, seconds = _theta(system, point), SLIDING_S
    longest = max(float(system.trials[k].t_s[-1]) for k in sliding)
    while True:
        part = replace(system, trials=tuple(
            item.first(seconds) if k in sliding else item for k, item in enumerate(system.trials)
        ))  # fmt: skip
        model, best, least = OutputErrorModel(part, noise_at(part, theta)), theta, math.inf
        for share in AROUND:
            other = theta.copy()
            other[FRICTION[1]] = max(theta[FRICTION[1]] * share, 1.0)
            if (cost := _cost(model, other, least)) < least:
                best, least = other, cost
        branch = _fitted(part, best)
        if 2.0 * branch[1].cost > ROBOT.max_mean_square * _counted(part):
            return found
        if seconds >= longest:
            return branch
        theta, seconds = branch[1].theta, LONGER * seconds


def _counted(system: RobotSystem) -> int:
    """Return how many samples count."""
    return sum(
        int(2 * np.count_nonzero(system.torque_counts(k)) + np.count_nonzero(item.seen))
        for k, item in enumerate(system.trials)
    )


def _rescanned(
    system: RobotSystem, sliding: Sequence[int], branch: Branch
) -> tuple[OutputErrorModel, Fit, float]:
    """Return the fit at the mu_s of least cost, and a standard error by the shape of its cost.

    The instants at which contacts slide or grip make steps in the cost of mu_s. No derivative has
    them: the smallest of many close values is the optimum, and the values that cost too little to
    be ruled out widen the interval.
    """
    branch, allowed = _scanned(system, sliding, branch)
    return *branch, max(allowed, _by_other_laws(system, sliding, branch)) / Z_95


def _scanned(system: RobotSystem, sliding: Sequence[int], branch: Branch) -> tuple[Branch, float]:
    """Return the fit at the mu_s of least cost, and over how many e-folds others are as good."""
    place, gains = FRICTION[1], np.zeros(0)
    for _ in range(MOST_BETTER):
        whole, theta, count = branch[0], branch[1].theta, len(SHARED)
        kept = [theta[whole.columns(k)[count:]] for k in sliding]
        model = OutputErrorModel(
            SomeTrials(system, tuple(sliding)), tuple(whole.noise[k] for k in sliding)
        )
        rows = np.concatenate([theta[:count], *kept])
        here, costs = model.cost(rows), []
        for share in AGAIN:
            rows[place] = max(theta[place] * share, 1.0)
            costs.append(_cost(model, rows, here + ROBOT.max_cost))
        gains = np.array(costs) - here
        best = int(np.argmin(gains))
        if gains[best] > -THRESHOLDS.min_cost_gained:
            break
        moved = theta.copy()
        moved[place] = max(theta[place] * AGAIN[best], 1.0)
        branch = _fitted(system, moved)
    allowed = np.abs(np.log(AGAIN))[gains < ROBOT.max_cost]
    return branch, float(np.max(allowed, initial=0.0))


def _by_other_laws(system: RobotSystem, sliding: Sequence[int], branch: Branch) -> float:
    """Return by how much, in e-folds, mu_s may be larger because contacts let go gradually.

    Over how much of the force they do so is not known: each width counts that the data do not rule
    out beside the jump. All other parameters move with it as the linearised model lets them.
    """
    model, theta, place = branch[0], branch[1].theta, FRICTION[1]
    count, farthest = len(SHARED), 0.0
    scale = slopes(model.parameters, theta)
    known = model.known.rows
    pulls = model.prior_residuals(to_scaled(model.parameters, theta))
    information, gradient = known.T @ known, known.T @ pulls
    white, moved = {}, {}
    for k in range(model.trials):
        here = model.columns(k)
        white[k], slope = model.linearise(k, theta)
        moved[k] = slope * scale[here]
        information[np.ix_(here, here)] += moved[k].T @ moved[k]
        gradient[here] += moved[k].T @ white[k]
    others = np.delete(np.arange(len(gradient)), place)
    inverse = scaled_pinv(information[np.ix_(others, others)])

    def gained(gradient: FloatArray) -> float:
        return 0.5 * float(gradient[others] @ inverse @ gradient[others])

    most = ROBOT.max_cost_rough - gained(gradient)
    order = sorted(sliding, key=lambda k: len(system.trials[k].poses))  # short ones rule out soon
    for width in WIDTHS:
        other, allowed = replace(system, width=width), 0.0
        for up in UP:
            rows, slope, worse = theta[:count].copy(), gradient.copy(), 0.0
            rows[place] *= 1.0 + up * width
            for k in order:
                here = model.columns(k)
                shown = other.simulate(k, rows, theta[here[count:]])
                part = model.noise[k].whiten_errors(shown - system.measured[k]).ravel()
                worse += 0.5 * float(part @ part - white[k] @ white[k])
                slope[here] += moved[k].T @ (part - white[k])
                if not worse < ROBOT.max_cost_hopeless:
                    break
            if worse < ROBOT.max_cost_hopeless and worse - gained(slope) < most:
                allowed = 1.0 + up * width
        if not allowed:
            break
        farthest = max(farthest, math.log(allowed))
    return farthest


def _cost(model: OutputErrorModel, theta: FloatArray, most: float) -> float:
    """Return the cost; infinite as soon as some of the trials together are beyond ``most``."""
    pulls = model.prior_residuals(to_scaled(model.parameters, theta))
    total, shared = 0.5 * float(pulls @ pulls), len(model.system.shared)
    for trial, noise in enumerate(model.noise):
        local = theta[model.columns(trial)[shared:]]
        shown = model.system.simulate(trial, theta[:shared], local)
        white = noise.whiten_errors(shown - model.system.measured[trial])
        total += 0.5 * float(np.sum(white**2))
        if not total < most:
            return math.inf
    return total


def _to_go(found: OutputErrorFit) -> FloatArray:
    """Return the step (p,), scaled, that is left."""
    return np.nan_to_num(found.left * np.sqrt(np.maximum(np.diag(found.covariance), 0.0)))


def _beyond(found: OutputErrorFit) -> FloatArray:
    """Return the parameters (p,) at which nothing would be left to go."""
    return to_natural(found.model.parameters, found.fit.scaled + _to_go(found))


def _with_step(found: OutputErrorFit) -> OutputErrorFit:
    """Return a fit that ended at a step of the cost, with intervals that hold what is left to go.

    The slopes on one side of a step point across it, and the cost behind it is higher. Where it is
    not, or if more is left than chance allows, the fit has not converged.
    """
    if found.converged or not np.all(np.abs(found.left) <= Z_95):
        return found
    if found.model.cost(_beyond(found)) < found.fit.cost:
        return found
    covariance = found.covariance + np.outer(_to_go(found), _to_go(found))
    return replace(found, covariance=covariance, left=np.zeros_like(found.left))


def _widened(found: OutputErrorFit, sd: float) -> OutputErrorFit:
    """Return ``found`` with a ratio mu_s / mu_d that is known to ``sd`` (of its logarithm)."""
    place, covariance = FRICTION[1], found.covariance.copy()
    if not found.inverse[place, place] > 0.0:  # nothing is known of it
        return found
    covariance[place, place] = max(covariance[place, place], sd**2)
    # What is left to go while mu_s stays: its own slope is that of a single step of the cost.
    sds = np.sqrt(np.maximum(np.diag(found.covariance), np.finfo(float).tiny))
    along = found.inverse[:, place] / found.inverse[place, place]
    left = found.left - along * found.left[place] * sds[place] / sds
    # The begin of a trial that slides has such steps too, and is no number of the result.
    left[len(found.model.system.shared) :] = 0.0
    return replace(found, covariance=covariance, left=left)
