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
from rigd.analysis.diagnosis import diagnose
from rigd.analysis.extended import same_with
from rigd.analysis.fit import Fit, fit
from rigd.analysis.gate import judge_fit, settled_gate, strained_gate
from rigd.analysis.kinks import along_kinks
from rigd.analysis.left_out import without_each_trial
from rigd.analysis.output_error import ENOUGH, NEAR, ROUGH, Branch, OutputErrorFit, retried, settled
from rigd.analysis.result import FitOutcome, FloatArray, Gate, TrialRejection
from rigd.analysis.strained import strained
from rigd.analysis.whitened import OutputErrorModel, noise_at
from rigd_analyses.lugre.identify import Settings
from rigd_analyses.lugre.lateral.carried import Carried
from rigd_analyses.lugre.lateral.constants import LateralConstants, LateralTrial
from rigd_analyses.lugre.lateral.coupling import DRY, LEVER, NAMES, VISCOUS, LiftedRows
from rigd_analyses.lugre.lateral.extensions import candidates
from rigd_analyses.lugre.lateral.speeds import Cell, Speeds, all_speeds, cell, lacking_force
from rigd_analyses.lugre.lateral.starts import starts, with_rollers
from rigd_analyses.lugre.lateral.system import STRAIGHT_M_S, LateralSystem
from rigd_analyses.lugre.model import PARAMETERS
from rigd_analyses.lugre.rig.constants import RigConstants
from rigd_analyses.lugre.rig.found import WINDOW_S
from rigd_analyses.lugre.rig.identify import rig_system
from rigd_analyses.lugre.rig.parts import sort_out
from rigd_analyses.lugre.rig.ridge import along_ridge
from rigd_analyses.lugre.rig.system import GUIDE, LEAD
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
OTHER_LEVERS = (0.5, 2.0)  #: of the fitted one, from which the data may find another
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
    ``shifts`` (p,), scaled, are of what is left unexplained, and of what explains as much as that
    which was added; ``without`` (trials, p) are the steps without each trial, if something was.
    """

    system: LateralSystem
    whole: OutputErrorFit
    others: tuple[FloatArray, ...]
    gains: dict[tuple[LiftedRows, bool], float]
    gate: Gate
    trials: tuple[LateralTrial, ...]
    rejected: tuple[TrialRejection, ...]
    block: int
    speeds: tuple[Speeds, ...]
    cells: tuple[Cell, ...]
    friction: Carried | None = None
    shifts: tuple[FloatArray, ...] = ()
    without: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))

    @property
    def shared(self) -> FloatArray:
        """Return the fitted parameters that all trials share, (p,)."""
        return self.whole.fit.theta[: len(self.system.shared)]

    @property
    def forces_n(self) -> FloatArray:
        """Return the constant force along the guide that each trial has and the model has not."""
        return np.array(
            [lacking_force(item.measured - item.included, self.system.rig) for item in self.speeds]
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
    period = sampling_period_s(parts[0][0])
    block = max(1, round(SCORES_S / period))
    smooth = np.array([parameter.start for parameter in PARAMETERS])

    def system(rows: LiftedRows, *, turned: bool, window_s: float = WINDOW_S) -> LateralSystem:
        straight = rig_system(parts, rig, smooth, window_s)
        speeds = tuple(
            _block_means(item.speed_m_s[part][LEAD:], round(BLOCK_S / period))
            for item, (_, part) in zip(used, parts, strict=True)
        )
        return LateralSystem(
            straight, speeds, lateral, rig.bearing_torque.value, rows, turned,
            friction.unknowns if friction else (),
        )  # fmt: skip

    # The friction along the guide first: far from it, a fit would take the rollers elsewhere. With
    # both signs: held at the wrong one, the friction along the guide would take up the difference.
    branches = []
    for turned in (False, True):
        candidate = system(LiftedRows.PRINTED, turned=turned)
        point = with_rollers(
            candidate, np.array([item.parameter.start for item in candidate.shared])
        )
        branches += [
            (candidate, *_branch(candidate.held(point), start))
            for start in starts(point, known=friction is not None)
        ]
    first, model, begun = min(branches, key=lambda branch: _likelihood(*branch[1:]))
    shared = len(first.shared)
    begin = begun.theta.copy()
    begin[:shared] = with_rollers(first, begin[:shared])
    model = OutputErrorModel(first, model.noise)
    whole = settled(model, _damped(model, begin), block)
    model, begun = whole.model, whole.fit
    fits = {(LiftedRows.PRINTED, first.turned): begun}
    for choice in product(LiftedRows, (False, True)):
        if choice not in fits:
            other = system(choice[0], turned=choice[1])
            begin = begun.theta.copy()
            begin[:shared] = with_rollers(other, begin[:shared])
            fits[choice] = _damped(OutputErrorModel(other, model.noise), begin)
    best = min(fits, key=lambda choice: fits[choice].cost)
    as_recorded = min(((rows, False) for rows in LiftedRows), key=lambda choice: fits[choice].cost)
    if fits[as_recorded].cost - fits[best].cost < CLEAR_GAIN:
        best = as_recorded
    chosen = system(best[0], turned=best[1])
    if best != (LiftedRows.PRINTED, first.turned):
        whole = settled(OutputErrorModel(chosen, model.noise), fits[best], block)
    whole, gate, shifts = (
        (whole, TURNED_GATE, ())
        if chosen.turned
        else _judged(chosen, whole, block, [item.trial.label for item in used])
    )
    others = [
        fit(
            replace(
                whole.model,
                system=same_with(whole, system(best[0], turned=best[1], window_s=window)),
            ),
            whole.fit.theta, relative_decrease=ENOUGH, damping=NEAR,
        ).theta
        for window in OTHER_WINDOWS_S
    ]  # fmt: skip
    speeds = tuple(all_speeds(chosen, whole))
    cells = tuple(
        cell(item, float(np.mean(lateral_speed)), speed)
        for item, lateral_speed, speed in zip(used, chosen.speeds, speeds, strict=True)
    )
    found = LateralFound(
        chosen, whole, tuple(others),
        {choice: item.cost - fits[best].cost for choice, item in fits.items()},
        gate, tuple(used), tuple(rejected), block, speeds, cells, friction, shifts,
    )  # fmt: skip
    if not found.rows_known:
        found = replace(found, others=(*others, fits[found.rival].theta))
    if gate.outcome is FitOutcome.CORRECTED:
        found = replace(found, without=without_each_trial(whole))
    return found


def _branch(system: LateralSystem, start: FloatArray) -> Branch:
    """Return the fit from the shared parameters ``start`` (p,), with the noise as at its start."""
    local = [item.parameter.start for _ in system.measured for item in system.local]
    theta = np.concatenate([start, local])
    model = OutputErrorModel(system, noise_at(system, theta))
    return model, _damped(model, theta)


def _likelihood(model: OutputErrorModel, found: Fit) -> float:
    """Return -ln L up to a constant: costs under different noise do not compare."""
    return found.cost - sum(noise.log_scale for noise in model.noise)


def _damped(model: OutputErrorModel, theta: FloatArray) -> Fit:
    return fit(model, theta, max_iterations=ITERATIONS, relative_decrease=ROUGH)


def _judged(
    system: LateralSystem, whole: OutputErrorFit, block: int, labels: Sequence[str]
) -> tuple[OutputErrorFit, Gate, tuple[FloatArray, ...]]:
    """Return the fit with what explains a misfit, whether numbers may be given, and shifts.

    The shifts (p,), scaled, are as in :class:`LateralFound`.
    """
    period = system.rig.period_s
    with np.errstate(over="ignore", invalid="ignore"):  # a start may be far from any motion
        whole = along_kinks(retried(whole, along_ridge(whole), block), block)  # of |M_D| and |F_r|
    begun = [whole.fit.theta[: len(system.shared)]]
    diagnosis = diagnose(whole, partial(candidates, system), begun, block, period)
    with np.errstate(over="ignore", invalid="ignore"):
        whole = along_kinks(diagnosis.fit, block)
    gate = settled_gate(judge_fit(diagnosis, labels, period), whole)
    if gate.outcome is not FitOutcome.MISFIT:
        places, levers = _rests_on(system, whole)
        rests = {system.shared[place].wording for place in places}
        named = next((item for item in gate.explanations if item.name in rests), None)
        gate = strained_gate(gate, named or strained(whole, places, levers, block))
    return whole, gate, (*(item.score.shift for item in diagnosis.left), *diagnosis.doubts)


def _rests_on(
    system: LateralSystem, whole: OutputErrorFit
) -> tuple[list[int], dict[int, list[FloatArray]]]:
    """Return the places of the constants that the rollers' friction rests on, and more starts.

    Lever and friction of the rollers stand in for one another: another lever begins with as much
    more of it.
    """
    first = len(system.rig.shared)
    lever, rollers = first + LEVER, [first + DRY, first + VISCOUS]
    begun = []
    for factor in OTHER_LEVERS:
        theta = whole.fit.theta.copy()
        theta[lever] *= factor
        theta[rollers] *= factor
        begun.append(theta)
    return [GUIDE, *range(lever, first + len(NAMES))], {lever: begun}


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
