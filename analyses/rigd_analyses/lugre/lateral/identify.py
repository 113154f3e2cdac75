"""Identifies the friction of the passive rollers by output error on a lateral sweep.

The longitudinal friction and the constants of the drive are fitted too, the latter with their
uncertainties. Every sweep is also fitted with the opposite sign of the lateral speed, and with the
other law for the friction of a lifted row of rollers. The likelihoods, for the same noise, show
which the data support.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import product

import numpy as np

from rigd.analysis import DataError
from rigd.analysis.fitting.fit import Fit, fit
from rigd.analysis.output_error.augmented_system import same_with
from rigd.analysis.output_error.diagnosis import diagnose
from rigd.analysis.output_error.estimator import (
    ROUGH,
    Branch,
    OutputErrorFit,
    diverged,
    retried,
    settled,
)
from rigd.analysis.output_error.gate import judge_fit, settled_gate, strained_gate
from rigd.analysis.output_error.jackknife import without_each_trial
from rigd.analysis.output_error.system import Diverged, System
from rigd.analysis.output_error.whitened_residuals import OutputErrorModel, noise_at
from rigd.analysis.result import FitOutcome, FloatArray, Gate, ResidualTest, TrialRejection
from rigd_analyses.lugre.identify import Settings
from rigd_analyses.lugre.lateral.agreement import agreement, with_agreement
from rigd_analyses.lugre.lateral.carried import Carried
from rigd_analyses.lugre.lateral.constants import LateralConstants, LateralTrial
from rigd_analyses.lugre.lateral.coupled import (
    MOST_ENDS,
    Coupled,
    couple,
    coupled,
    fitted,
    reduced,
)
from rigd_analyses.lugre.lateral.coupling import LiftedRows
from rigd_analyses.lugre.lateral.extensions import candidates
from rigd_analyses.lugre.lateral.intervals import Intervals, intervals
from rigd_analyses.lugre.lateral.loads import (
    FreeLoads,
    Loads,
    loads_at,
    loads_of,
    plain,
    with_free_loads,
)
from rigd_analyses.lugre.lateral.reduced import RESTS_ON, optima, strained
from rigd_analyses.lugre.lateral.speeds import Cell, Speeds, all_speeds, cell, lacking_force
from rigd_analyses.lugre.lateral.starts import starts
from rigd_analyses.lugre.lateral.system import STRAIGHT_M_S, LateralSystem
from rigd_analyses.lugre.model import PARAMETERS
from rigd_analyses.lugre.rig.constants import RigConstants
from rigd_analyses.lugre.rig.family import described, rig_system
from rigd_analyses.lugre.rig.identification import WINDOW_S
from rigd_analyses.lugre.rig.parts import sort_out
from rigd_analyses.lugre.rig.ridge import along_ridge
from rigd_analyses.lugre.rig.system import GUIDE, LEAD, RigSystem
from rigd_analyses.lugre.trial import LugreTrial, sampling_period_s

OTHER_WINDOWS_S = (0.013, 0.041)  #: filters of the current: by how much the choice moves a value
LEAST_CURRENTS = 2  #: the longitudinal friction is fitted along, and needs them
SAME_CURRENT_A = 0.02
UNSTEADY = 0.25  #: share of its mean by which the lateral speed may differ during a drive
#: ln L that a turned lateral speed must gain to be accepted, and by which one of two couplings is
#: preferred: a factor of 150 in the likelihood.
CLEAR_GAIN = 5.0
SCORES_S = 0.05  #: longest correlation of the scores that is accounted for
ITERATIONS = 40  #: of one fit
FAR_OFF = 30.0  #: in ln L: another choice, or optimum, that is so much worse is not fitted
ONE_SPEED = 1.1  #: fastest over slowest lateral speed below which both are one
BLOCK_S = 0.02  #: means over this time are what the lateral speed is taken from
TURNED = (
    "The lateral speed's sign would have to be turned: encoder or belt direction. The same data "
    "follow from a guide_lever (d - e) of the other sign."
)
TURNED_GATE = Gate(
    FitOutcome.MISFIT, f"The model does not fit these data: {TURNED}", (TURNED,)
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class LateralFound:
    """The fit that the data support most, and what other choices make of it.

    ``gains`` is by how much ln L of each choice of the coupling lies below that of the fit.
    ``others`` (8,) are guide friction and coupling with other filters of the current, ``ends`` what
    the data allow of the rollers' friction; none if no number is given. ``alike`` is the test
    whether all recordings agree, None for only one. ``shifts`` (p,), scaled,
    are of what is left unexplained, and of what explains as much as that which was added;
    ``without`` (trials, p) are the steps without each trial, if something was.
    """

    system: LateralSystem
    whole: OutputErrorFit
    gains: dict[tuple[LiftedRows, bool], float]
    gate: Gate
    trials: tuple[LateralTrial, ...]
    block: int
    speeds: tuple[Speeds, ...]
    cells: tuple[Cell, ...]
    friction: Carried | None = None
    alike: ResidualTest | None = None
    shifts: tuple[FloatArray, ...] = ()
    others: tuple[FloatArray, ...] = ()
    ends: Intervals | None = None
    without: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    rejected: tuple[TrialRejection, ...] = ()

    @property
    def shared(self) -> FloatArray:
        """Return the fitted parameters that all trials share, (p,)."""
        return self.whole.fit.theta[: len(self.system.shared)]

    @property
    def range_m_s(self) -> tuple[float, ...]:
        """Return the slowest and the fastest lateral speed; one, if both are the same."""
        means = [abs(float(np.mean(speed))) for speed in self.system.speeds]
        slow = min(value for value in means if value >= 0.5 * min(max(means), 0.1))
        fast = max(means)
        return (slow, fast) if fast > ONE_SPEED * slow else (fast,)

    @property
    def forces_n(self) -> FloatArray:
        """Return the force in the direction of motion that each trial has and the model has not."""
        return np.array(
            [
                lacking_force(item.measured - item.included, self.system, trial)
                for trial, item in enumerate(self.speeds)
            ]
        )

    @property
    def rival(self) -> tuple[LiftedRows, bool]:
        """Return the choice with the same sign in which a lifted row rubs the other way."""
        rows = LiftedRows.PHYSICAL if self.system.rows is LiftedRows.PRINTED else LiftedRows.PRINTED
        return rows, self.system.turned

    @property
    def rows_known(self) -> bool:
        """Whether the data show how a lifted row of rollers rubs."""
        return self.gains[self.rival] > CLEAR_GAIN


def find_lateral(
    trials: Sequence[LateralTrial],
    rig: RigConstants,
    lateral: LateralConstants,
    settings: Settings | None = None,
    friction: Carried | None = None,
) -> LateralFound:
    """Return the rollers' friction from ``trials``, by simulating the rig.

    ``friction`` is that along the guide, if another identification has found it.

    Raises:
        DataError: no trial moves sideways, too few currents, or a recording cannot answer.
    """
    settings = Settings() if settings is None else settings
    used, parts, rejected = _usable(trials, settings, 1 if friction else LEAST_CURRENTS)
    try:
        found = _found(used, parts, rig, lateral, friction)
    except Diverged as error:
        raise Diverged(error.trial, described(used[error.trial].trial)) from error
    return replace(found, rejected=tuple(rejected))


def _found(
    used: Sequence[LateralTrial],
    parts: Sequence[tuple[LugreTrial, slice]],
    rig: RigConstants,
    lateral: LateralConstants,
    friction: Carried | None,
) -> LateralFound:
    """Return what ``used`` trials, each with the part that is simulated, show.

    Raises:
        Diverged: the cost of a trial is not finite at any start.
    """
    period = sampling_period_s(parts[0][0])
    block = max(1, round(SCORES_S / period))
    smooth = np.array([parameter.start for parameter in PARAMETERS])

    def rig_with(window_s: float) -> RigSystem:
        return rig_system(parts, rig, smooth, window_s)

    straight = rig_with(WINDOW_S)

    def system(rows: LiftedRows, *, turned: bool, straight: RigSystem = straight) -> LateralSystem:
        speeds = tuple(
            _block_means(item.speed_m_s[part][LEAD:], round(BLOCK_S / period))
            for item, (_, part) in zip(used, parts, strict=True)
        )
        return LateralSystem(
            straight, speeds, lateral, rig.bearing_torque.value, rows, turned,
            friction.unknowns if friction else (),
        )  # fmt: skip

    with np.errstate(over="ignore", invalid="ignore"):  # a start may be far from any motion
        loads = _free_loads(system(LiftedRows.PRINTED, turned=False), block)
    coarse = {
        choice: optima(reduced(loads, part, part))
        for choice in product(LiftedRows, (False, True))
        for part in [system(choice[0], turned=choice[1])]
    }
    least = min(ends[0].cost for ends in coarse.values())
    fits: dict[tuple[LiftedRows, bool], Coupled] = {}
    for choice, ends in coarse.items():
        if ends[0].cost < least + FAR_OFF:
            part = system(choice[0], turned=choice[1])
            near = [end.theta for end in ends if end.cost < ends[0].cost + FAR_OFF][:MOST_ENDS]
            fits[choice] = couple(part, part, loads, near, block)
    best = min(fits, key=lambda choice: fits[choice].whole.fit.cost)
    lowest = fits[best].whole.fit.cost
    # A choice that is far off needs no fit: the frictions of the trials alone refuse it.
    gains = {
        choice: fits[choice].whole.fit.cost - lowest if choice in fits else ends[0].cost - least
        for choice, ends in coarse.items()
    }
    as_recorded = min(((rows, False) for rows in LiftedRows), key=lambda choice: gains[choice])
    if gains[as_recorded] < CLEAR_GAIN:
        best = as_recorded
    chosen = system(best[0], turned=best[1])
    whole, gate, shifts = (
        (fits[best].whole, TURNED_GATE, ())
        if chosen.turned
        else _judged(chosen, fits[best], block, [item.trial.label for item in used])
    )
    alike = agreement(reduced(loads, chosen, chosen), coarse[best][0].theta)
    gate = with_agreement(gate, alike)
    speeds = tuple(all_speeds(chosen, whole))
    cells = tuple(
        cell(item, float(np.mean(lateral_speed)), speed)
        for item, lateral_speed, speed in zip(used, chosen.speeds, speeds, strict=True)
    )
    found = LateralFound(
        chosen, whole, gains, gate, tuple(used), block, speeds, cells, friction, alike, shifts,
    )  # fmt: skip
    if gate.outcome is FitOutcome.MISFIT:
        return found
    end = coupled(whole, block)
    laws = [end]
    if gains[found.rival] < FAR_OFF:
        other = system(found.rival[0], turned=chosen.turned)
        extended = same_with(whole, other)
        near = [item.theta for item in optima(reduced(end.loads, other, extended))[:MOST_ENDS]]
        if found.rival in fits:
            near.append(fits[found.rival].coupling)
        laws.append(couple(other, extended, end.loads, near, block))
    others = []
    for window in OTHER_WINDOWS_S:
        filtered = same_with(
            whole, system(best[0], turned=chosen.turned, straight=rig_with(window))
        )
        model = replace(whole.model, system=filtered)
        problem = reduced(loads_at(model, whole.fit.theta, block), chosen, filtered)
        others.append(fitted(problem, end.coupling).theta)
    found = replace(found, others=tuple(others), ends=intervals(laws, found.range_m_s))
    if gate.outcome is FitOutcome.CORRECTED:
        found = replace(found, without=without_each_trial(whole))
    return found


def _free_loads(system: LateralSystem, block: int) -> Loads:
    """Return what the data know of the friction of the guide in each trial.

    Raises:
        Diverged: the cost of a trial is not finite at any start.
    """
    free, branches = FreeLoads.of(system), []
    points = starts(system)
    for start in points:
        try:
            branches.append(_branch(free, start))
        except Diverged:
            if start is points[-1] and not branches:
                raise
    model, begun = min(branches, key=lambda branch: _likelihood(*branch))
    whole = settled(model, begun, block)
    return loads_of(retried(whole, along_ridge(whole), block))


def _branch(system: System, theta: FloatArray) -> Branch:
    """Return the fit from ``theta`` (p,), natural, with the noise as at this start.

    Raises:
        Diverged: the cost of a trial is not finite there.
    """
    model = OutputErrorModel(system, noise_at(system, theta))
    try:
        return model, fit(model, theta, max_iterations=ITERATIONS, relative_decrease=ROUGH)
    except DataError as error:
        raise Diverged(diverged(model, theta)) from error


def _likelihood(model: OutputErrorModel, found: Fit) -> float:
    """Return -ln L up to a constant: costs under different noise do not compare."""
    return found.cost - sum(noise.log_scale for noise in model.noise)


def _refit(whole: System, points: Sequence[FloatArray], block: int) -> OutputErrorFit:
    """Return the fit of a system with something added, from the best of ``points`` (p + c,)."""
    system, ends = plain(whole), []
    local = np.array([item.parameter.start for item in system.local])
    free = with_free_loads(whole, FreeLoads.of(system))
    own, count = len(system.shared), len(system.rig.shared)
    for point in points:
        forces = [system.mean_force(k, point[:own]) for k in range(len(system.speeds))]
        of_trials = np.column_stack([np.tile(local, (len(forces), 1)), forces])
        theta = np.concatenate([point[:count], point[own:], of_trials.ravel()])
        ends.append(_branch(free, theta))
    model, begun = min(ends, key=lambda branch: _likelihood(*branch))
    loads = loads_of(settled(model, begun, block))
    coupling = np.concatenate([points[0][[GUIDE]], points[0][count:own]])
    near = [end.theta for end in optima(reduced(loads, system, whole))[:MOST_ENDS]]
    return couple(system, whole, loads, [*near, coupling], block).whole


def _judged(
    system: LateralSystem, found: Coupled, block: int, labels: Sequence[str]
) -> tuple[OutputErrorFit, Gate, tuple[FloatArray, ...]]:
    """Return the fit with what explains a misfit, whether numbers may be given, and shifts.

    The shifts (p,), scaled, are as in :class:`LateralFound`.
    """
    period, whole = system.rig.period_s, found.whole
    begun = [whole.fit.theta[: len(system.shared)]]
    with np.errstate(over="ignore", invalid="ignore"):
        diagnosis = diagnose(whole, partial(candidates, system), begun, block, period, _refit)
    whole = diagnosis.fit
    gate = settled_gate(judge_fit(diagnosis, labels, period), whole.unsettled)
    if gate.outcome is not FitOutcome.MISFIT:
        end = coupled(whole, block)
        other = LiftedRows.PHYSICAL if system.rows is LiftedRows.PRINTED else LiftedRows.PRINTED
        laws = [end.reduced(part) for part in (system, replace(system, rows=other))]
        rests = {laws[0].unknowns[place].wording for place in RESTS_ON}
        named = next((item for item in gate.explanations if item.name in rests), None)
        gate = strained_gate(gate, named or strained(laws, end.coupling))
    return whole, gate, (*(item.score.shift for item in diagnosis.left), *diagnosis.doubts)


def _block_means(values: FloatArray, block: int) -> FloatArray:
    """Return the means of blocks of ``values`` (n,): their mean is that of all but the last few."""
    block = max(1, min(block, len(values)))
    return np.asarray(np.mean(values[: len(values) // block * block].reshape(-1, block), axis=1))


def _usable(
    trials: Sequence[LateralTrial], settings: Settings, least_currents: int
) -> tuple[list[LateralTrial], list[tuple[LugreTrial, slice]], list[TrialRejection]]:
    """Return the trials that can be fitted, each with the part that is simulated, and the others.

    Raises:
        DataError: they cannot answer.
    """
    periods = [sampling_period_s(item.trial) for item in trials]
    parts, rejected = sort_out([item.trial for item in trials], periods, settings)
    of_trial = {id(item.trial): item for item in trials}
    used, kept = [], []
    for trial, part in parts:
        item = of_trial[id(trial)]
        if reason := _unsteady(item.speed_m_s[part][LEAD:]):
            rejected.append(TrialRejection(trial.label, reason))
        else:
            used.append(item)
            kept.append((trial, part))
    if not used:
        raise DataError(
            f"the lateral speed is constant in none of {len(trials)} trials "
            f"({rejected[0].label}: {rejected[0].reason})",
            hint="drive the wheel once the bridge has reached its speed",
        )
    fastest = max(
        abs(float(np.mean(item.speed_m_s[part][LEAD:])))
        for item, (_, part) in zip(used, kept, strict=True)
    )
    if fastest < STRAIGHT_M_S:
        raise DataError(
            f"no trial moves sideways: the lateral speed is {1e3 * fastest:.1f} mm/s at most, need "
            f"{1e3 * STRAIGHT_M_S:.0f} mm/s",
            hint="identify recordings without lateral motion by a procedure with `model: lugre`; "
            "else check the signal lateral_speed",
        )
    currents = sorted(item.trial.current_a for item in used)
    distinct = 1 + int(np.count_nonzero(np.diff(currents) > SAME_CURRENT_A))
    if distinct < least_currents:
        raise DataError(
            f"all {len(used)} trials that can be fitted have {currents[0]:.2f} A: the friction "
            f"along the guide is fitted too, and needs at least {LEAST_CURRENTS} currents",
            hint="record the lateral sweep with more currents, or give the friction along the "
            "guide: `--model MODEL.json`",
        )
    return used, kept, rejected


def _unsteady(speed_m_s: FloatArray) -> str:
    """Return why the lateral speed of a drive cannot be taken as constant; empty if it can."""
    if not np.all(np.isfinite(speed_m_s)):
        return "the lateral speed has samples that are not numbers"
    mean = float(np.mean(speed_m_s))
    low, high = (float(x) for x in np.quantile(speed_m_s, [0.01, 0.99]))
    if max(high - mean, mean - low) <= max(UNSTEADY * abs(mean), STRAIGHT_M_S):
        return ""
    return f"the lateral speed runs from {low:+.3f} to {high:+.3f} m/s while the wheel is driven"
