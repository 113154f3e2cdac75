"""Fits F = F_c + (F_s - F_c) exp(-(v/v_s)²) + k_v v to force over speed of a moving body.

Coulomb friction, the Stribeck effect with a Gaussian, and viscous friction: see the survey of
Armstrong-Hélouvry, Dupont and Canudas de Wit, Automatica 30 (1994), section 2. The law holds for
steady motion: samples at rest, and where the speed changes fast, do not count.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from rigd.analysis import DataError, Options, quotient
from rigd.analysis.fitting.directions import NAME as DIRECTIONS
from rigd.analysis.fitting.model import FitParameter
from rigd.analysis.fitting.response import (
    Axis,
    ResponseModel,
    ResponseQuantity,
    ResponseTrial,
    Wording,
    identify_response,
    one_way,
)
from rigd.analysis.fitting.selection import VERY_STRONG, bic
from rigd.analysis.parameters import (
    Fitted,
    Group,
    ParameterEvaluation,
    complete_groups,
    each_group,
)
from rigd.analysis.recordings.source import RecordedSweep, TrialInfo
from rigd.analysis.result import (
    BoolArray,
    FloatArray,
    IdentificationResult,
    Preprocessing,
    Verdict,
)
from rigd_analyses.static.needs import NEEDS

_TINY: Final = float(np.finfo(np.float64).tiny)
#: Below this share of the highest speed of a trial the body may be at rest.
REST_SHARE: Final = 0.01
#: The speed changes fast if it changes by this share of the highest one, ...
CHANGE_SHARE: Final = 0.1
#: ... or by this share of itself, as it does while a drive settles after a stop, ...
OWN_SHARE: Final = 0.4
#: ... within this time in s.
CHANGE_S: Final = 0.1
#: Speeds that are further apart than this share are two; a sweep has one in each such share.
APART: Final = 0.05
#: How long noise may remember in s; the next one counts if the residuals correlate more after it.
#: Counted for 0.1 s alone, intervals hold 81 % beside noise that remembers 0.05 to 0.1 s.
MEMORIES_S: Final = (0.1, 0.2, 0.4)
FORGOTTEN: Final = 0.1
#: This share of the samples is at the slowest speeds.
SLOWEST: Final = 0.02
#: Of fewer speeds several laws go through all means exactly.
LEAST_SPEEDS: Final = 5
SLOWER: Final = "Play strokes from a hundredth of the speed on, in small steps."
FASTER: Final = "Play strokes at speeds of 1 to 10: only a range of speeds parts the two."
QUANTITIES: Final = (
    ResponseQuantity("F_c", "Coulomb friction", FASTER),
    ResponseQuantity("F_s", "friction just after breakaway", SLOWER),
    ResponseQuantity("v_s", "speed at which the Stribeck effect ends", SLOWER),
    ResponseQuantity("k_v", "friction in proportion to the speed", FASTER),
)
#: What the friction is in its unit, and the speed.
FRICTION: Final = {"N": "friction", "N m": "friction torque", "1": "friction coefficient"}
SPEED: Final = {"m/s": "speed", "rad/s": "angular speed"}


@dataclass(frozen=True)
class Pair:
    """The units of friction and speed, as the report states them."""

    force: str
    speed: str

    @property
    def wording(self) -> Wording:
        """The words of the report on a law of this pair."""
        return Wording(
            model="static-friction",
            method="static law on samples in steady motion",
            title="Static friction law",
            x=Axis(SPEED[self.speed], self.speed),
            y=Axis(FRICTION[self.force], self.force),
            quantities=QUANTITIES,
        )


def evaluate(
    sweeps: Sequence[RecordedSweep], options: Options, notify: Callable[[str], None]
) -> ParameterEvaluation:
    """Return the law of each group of trials; of one whose directions differ, that of each.

    Raises:
        DataError: a recording has no complete trial, or the data of no group can answer.
    """
    found, refused = each_group(
        complete_groups(sweeps, options, notify),
        lambda group: identify(group, options),
        options.processes,
    )
    fitted = [
        Fitted(replace(group, label=f"{group.label}{way}"), result)
        for group, results in found
        for way, result in results.items()
    ]
    return ParameterEvaluation.of(sweeps, fitted, options, refused=refused, bridged=False)


def identify(group: Group, options: Options) -> Mapping[str, IdentificationResult]:
    """Return the law of one group of trials, by what its label needs besides.

    If its directions differ it is a law of each: neither has the mean of both.

    Raises:
        DataError: a sample is not finite, or nothing moves.
    """
    pair = pair_of(group)
    found = [response(sweep, trial, pair) for sweep, trial in group.trials]
    trials = tuple(trial for trial, _ in found)
    rules = tuple(dict.fromkeys(rule for _, by_trial in found for rule in by_trial))
    if len(group.recordings) > 1:  # each begins with trial 1
        trials = tuple(replace(x, label=f"{x.label} of {x.recording}") for x in trials)
    force = np.concatenate([trial.measured[trial.used] for trial in trials])
    speed = np.concatenate([trial.x[trial.used] for trial in trials])
    if not len(speed):
        files = ", ".join(str(path) for path in group.recordings)
        raise DataError(
            f"{files}: in no trial the speed is steady: everywhere it changes by "
            f"{100 * CHANGE_SHARE:g} % of its highest value within {CHANGE_S:g} s",
            hint="hold each speed for 1 s or longer; `rigd report` draws the recording",
        )
    size = float(np.median(np.abs(force))) or 1.0
    model = ResponseModel(parameters(pair, size, speed, force), friction, trials, size)
    result = _identified(model, pair, options, rules)
    differ = [x for x in result.residual_tests if x.name == DIRECTIONS and not x.passed]
    if not differ:
        return {"": result}
    found_each = {}
    for way, sign in ((", forward", 1.0), (", backward", -1.0)):
        each = _identified(one_way(model, sign), pair, options, rules)
        said = [x.sentence for x in differ]
        found_each[way] = replace(each, warnings=(*said, *each.warnings))
    return found_each


def _identified(
    model: ResponseModel, pair: Pair, options: Options, rules: Sequence[str]
) -> IdentificationResult:
    """Return the law of ``model`` within the reach of its speeds; raises as :func:`identify`."""
    done = account(model.trials, rules)
    for memory_s in MEMORIES_S:
        result = identify_response(model, pair.wording, options, done, block_s=memory_s)
        if _correlation(result, memory_s) < FORGOTTEN:
            break
    return _within_reach(result, model)


def _correlation(result: IdentificationResult, lag_s: float) -> float:
    """Return the autocorrelation of the residuals, each trial about its mean, after ``lag_s``."""
    period_s = min(float(np.median(np.diff(trial.t_s))) for trial in result.trials)
    lag, above, below = max(1, round(lag_s / period_s)), 0.0, 0.0
    for trial in result.trials:
        left = (trial.fitted - trial.measured)[trial.used]
        left = left - np.mean(left)
        above += float(left[:-lag] @ left[lag:])
        below += float(left @ left)
    return above / max(below, _TINY)


def pair_of(group: Group) -> Pair:
    """Return the units of friction and speed that the trials of ``group`` have in common.

    Raises:
        DataError: they have several, or one that the model does not take.
    """
    sweeps = {sweep.path: sweep for sweep, _ in group.trials}
    pairs: dict[Pair, Path] = {}
    for path, sweep in sweeps.items():
        pairs.setdefault(
            Pair(*(sweep.unit(name, NEEDS.signals[name]) for name in ("force", "speed"))), path
        )
    if len(pairs) > 1:
        found = ", ".join(f"{path} has {x.force} over {x.speed}" for x, path in pairs.items())
        raise DataError(
            f"trials of one group are of different quantities: {found}",
            hint="identify each by itself, with a command each or with `--group-by recording`",
        )
    return next(iter(pairs))


def speeds(speed: FloatArray) -> int:
    """Return how many different speeds the samples (n,), all above 0, show."""
    sorted_logs = np.sort(np.log(speed))
    ends = np.flatnonzero(np.diff(sorted_logs) > APART)
    parts = np.split(sorted_logs, ends + 1)
    widths = [np.diff(np.quantile(part, [0.05, 0.95]))[0] for part in parts]  # less the noise
    return sum(1 + int(width / APART) for width in widths)


def _within_reach(result: IdentificationResult, model: ResponseModel) -> IdentificationResult:
    """Return ``result`` without what the speeds, or v_s beside them, leave open.

    F_s is the friction far below v_s. If the data do not limit v_s downwards, a refit that finds no
    other F_s has not looked far enough; if not upwards, F_s and F_c stand in for one another; and
    if all speeds are above v_s, what is left of the Stribeck effect there is extrapolated. Neither
    is known if a straight line fits the samples nearly as well.
    """
    speed = model.x[model.mask > 0.0]
    stribeck, count = result.parameter("v_s"), speeds(speed)
    reasons = {}
    for end, where in ((stribeck.low, "downwards"), (stribeck.high, "upwards")):
        if end is None:
            reasons["F_s"] = f"The data do not limit v_s {where}: this friction is extrapolated."
    if stribeck.estimate < float(np.quantile(speed, SLOWEST)):
        reasons["F_s"] = "All speeds are above v_s: this friction is extrapolated."
    if _gain_over_line(result, model) < VERY_STRONG:
        line = "A straight line fits nearly as well: no Stribeck effect is seen."
        reasons |= {"F_s": line, "v_s": line}
    if count < LEAST_SPEEDS:
        few = (
            f"{count} different speeds cannot contradict a law of {len(result.parameters)} "
            f"parameters: it needs {LEAST_SPEEDS}."
        )
        reasons = dict.fromkeys((item.name for item in result.parameters), few)
    advice = {item.symbol: item.advice for item in QUANTITIES}
    parameters = tuple(
        replace(
            item, low=None, high=None, standard_error=None, verdict=Verdict.UNIDENTIFIABLE,
            sentence=reasons[item.name], advice=advice[item.name],
        )
        if item.name in reasons and item.identifiable
        else item
        for item in result.parameters
    )  # fmt: skip
    return replace(result, parameters=parameters)


def _gain_over_line(result: IdentificationResult, model: ResponseModel) -> float:
    """Return by how much the BIC of the law is lower than that of a straight line."""
    used = model.mask > 0.0
    speed, force = model.x[used], np.concatenate([x.measured for x in model.trials])[used]
    columns = np.column_stack([np.ones_like(speed), speed]) / model.scale
    line = np.linalg.lstsq(columns, force / model.scale, rcond=None)[0]
    left = columns @ line - force / model.scale
    costs = {2: 0.5 * float(left @ left), len(result.parameters): result.cost}
    by_line, by_law = (
        bic(max(cost, _TINY), result.samples, max(result.effective_samples, 2.0), count)
        for count, cost in costs.items()
    )
    return by_line - by_law


def friction(theta: FloatArray, speed: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the friction (n,) at speeds above 0, in units of the pair, and derivatives (n, 4)."""
    coulomb, breakaway, stribeck, viscous = theta
    share = np.exp(-((speed / stribeck) ** 2))
    drop = breakaway - coulomb
    by_stribeck = drop * share * 2.0 * speed**2 / stribeck**3
    derivatives = np.stack([1.0 - share, share, by_stribeck, speed], axis=1)
    return coulomb + drop * share + viscous * speed, derivatives


def parameters(
    pair: Pair, size: float, speed: FloatArray, force: FloatArray
) -> tuple[FitParameter, ...]:
    """Return the parameters with wide bounds around the ``size`` of the force and the speeds.

    All are in units of the pair. The first start is the straight line through all samples.
    """
    low, usual = (float(x) for x in np.quantile(speed, [0.01, 0.5]))
    viscous = size / usual
    centre = float(np.mean(speed))
    spread = float(np.sum((speed - centre) ** 2)) or 1.0
    slope = float(np.sum((speed - centre) * force)) / spread
    constant = float(np.mean(force)) - slope * centre
    coulomb = float(np.clip(constant, 0.01 * size, size))
    return (
        FitParameter("F_c", pair.force, 1e-3 * size, 1e2 * size, coulomb),
        FitParameter("F_s", pair.force, 1e-3 * size, 1e2 * size, 1.2 * coulomb),
        FitParameter("v_s", pair.speed, 1e-2 * low, 1e1 * usual, min(2.0 * low, usual)),
        FitParameter(
            "k_v", quotient(pair.force, pair.speed), 1e-5 * viscous, 1e1 * viscous,
            float(np.clip(slope, 1e-3 * viscous, viscous)),
        ),
    )  # fmt: skip


def response(
    sweep: RecordedSweep, trial: TrialInfo, pair: Pair
) -> tuple[ResponseTrial, tuple[str, ...]]:
    """Return speed and friction of one trial, both in the direction of motion.

    With them sentences on how signals of several streams came to the same rows.

    Raises:
        DataError: a signal is missing, a sample is not finite, or the body does not move.
    """
    rows = sweep.rows(trial)
    speed, force = rows.signals["speed"], rows.signals["force"]
    for name, values in (("speed", speed), ("force", force)):
        if not np.all(np.isfinite(values)):
            raise DataError(
                f"{sweep.path}: in trial {trial.number} samples of the {name} are not finite",
                hint="`rigd report` draws the recording; a derived channel has no value where its "
                "`where` does not hold or where it divides by 0: write 'hold(x, condition)'",
            )
    top = float(np.max(np.abs(speed), initial=0.0))
    if len(speed) < 2 or top == 0.0:
        raise DataError(f"{sweep.path}: in trial {trial.number} the body does not move")
    x, measured = _folded(speed, force)
    bent = {**rows.signals, **rows.curved}
    found = ResponseTrial(
        label=f"trial {trial.number}",
        condition=f"up to {top:.3g} {pair.speed}",
        recording=str(sweep.path),
        t_s=rows.t_s,
        x=x,
        measured=measured,
        used=(np.abs(speed) > REST_SHARE * top) & steady(rows.t_s, speed, top),
        direction=np.where(speed < 0.0, -1.0, 1.0),
        otherwise=_folded(bent["speed"], bent["force"]) if rows.curved else None,
    )
    return found, rows.rules


def _folded(speed: FloatArray, force: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return speed, above 0, and force (n,) in the direction of motion."""
    return np.maximum(np.abs(speed), np.finfo(np.float64).tiny), force * np.sign(speed)


def steady(t_s: FloatArray, speed: FloatArray, top: float) -> BoolArray:
    """Return at which samples (n,) the speed changes slowly, before and after.

    Each sample is compared with the one next to ``CHANGE_S`` later, and with that before; at the
    ends of a trial with one of them. The times in s may be uneven, and n is 2 at least.
    """
    # Half a step, and what the times in s are rounded by: of two samples as near it is the nearer.
    near = CHANGE_S - 0.5 * float(np.median(np.diff(t_s))) * (1.0 + 1e-6)
    at = np.arange(len(t_s))
    both = np.ones(len(t_s), np.bool_)
    for other in (
        np.maximum(np.searchsorted(t_s, t_s + near), at + 1),
        np.minimum(np.searchsorted(t_s, t_s - near, side="right") - 1, at - 1),
    ):
        there = (other >= 0) & (other < len(t_s))
        first, last = np.abs(speed[at[there]]), np.abs(speed[other[there]])
        change = np.abs(speed[at[there]] - speed[other[there]])
        both[there] &= (change < CHANGE_SHARE * top) & (
            change < OWN_SHARE * np.maximum(first, last)
        )
    return both


def account(trials: Sequence[ResponseTrial], rules: Sequence[str]) -> Preprocessing:
    """Return the processing of the samples before the fit, for the report.

    ``rules`` are sentences on how signals of several streams came to the same rows.
    """
    return Preprocessing(
        statements=(
            f"Samples count while the speed is above {100 * REST_SHARE:g} % of its highest value "
            f"and changes by less than {100 * CHANGE_SHARE:g} % of it, and less than "
            f"{100 * OWN_SHARE:g} % of itself, within {CHANGE_S:g} s.",
            "Force and speed are taken in the direction of motion.",
            *rules,
        ),
        settings={
            "rest_share": REST_SHARE,
            "change_share": CHANGE_SHARE,
            "own_share": OWN_SHARE,
            "change_s": CHANGE_S,
        },
        per_trial={trial.label: {} for trial in trials},
    )
