"""Identifies the friction of the passive rollers by output error on a lateral sweep.

The longitudinal friction and the constants of the drive are fitted too, the latter with their
uncertainties. Every sweep is also fitted with the opposite sign of the lateral speed, and with the
other law for the friction of a lifted row of rollers. The likelihoods, for the same noise, show
which the data support.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product

import numpy as np

from rigd.analysis import DataError
from rigd.analysis.fitting.agreement import MAX_P_VALUE_RECORDINGS
from rigd.analysis.fitting.fit import Fit, fit
from rigd.analysis.output_error.augmented_system import same_with
from rigd.analysis.output_error.estimator import (
    Branch,
    OutputErrorFit,
    diverged,
    drawn,
    retried,
    settled,
)
from rigd.analysis.output_error.gate import settled_gate, strained_gate
from rigd.analysis.output_error.pipeline import Family, Identification, identify
from rigd.analysis.output_error.structure import Suspect
from rigd.analysis.output_error.system import Diverged, System
from rigd.analysis.output_error.thresholds import THRESHOLDS
from rigd.analysis.output_error.whitened_residuals import OutputErrorModel, noise_at
from rigd.analysis.result import FitOutcome, FloatArray, Gate, ResidualTest, TrialRejection
from rigd_analyses.lugre.lateral.agreement import agreement, with_agreement
from rigd_analyses.lugre.lateral.constants import LateralConstants, LateralTrial
from rigd_analyses.lugre.lateral.coupling import LiftedRows
from rigd_analyses.lugre.lateral.coupling_fit.fit import (
    MOST_ENDS,
    Coupled,
    couple,
    coupled,
    coupling_of,
    fitted,
    reduced,
)
from rigd_analyses.lugre.lateral.coupling_fit.loads import (
    FreeLoads,
    Loads,
    loads_at,
    loads_of,
    plain,
    with_free_loads,
)
from rigd_analyses.lugre.lateral.coupling_fit.problem import RESTS_ON, optima, strained
from rigd_analyses.lugre.lateral.extensions import candidates
from rigd_analyses.lugre.lateral.intervals import Intervals, intervals
from rigd_analyses.lugre.lateral.saved_friction import Carried
from rigd_analyses.lugre.lateral.speeds.errors import Cell, Speeds, all_speeds, cell, lacking_force
from rigd_analyses.lugre.lateral.starts import starts
from rigd_analyses.lugre.lateral.system import LateralSystem
from rigd_analyses.lugre.lateral.thresholds import LATERAL
from rigd_analyses.lugre.model import PARAMETERS
from rigd_analyses.lugre.rig.family import described, rig_system
from rigd_analyses.lugre.rig.parts import sort_out
from rigd_analyses.lugre.rig.ridge import along_ridge
from rigd_analyses.lugre.rig.system import GUIDE, LEAD
from rigd_analyses.lugre.slip_force.identify import Settings
from rigd_analyses.lugre.trials.known_constants import RigConstants
from rigd_analyses.lugre.trials.trial import LugreTrial, sampling_period_s

OTHER_WINDOWS_S = (0.013, 0.041)  #: filters of the current: by how much the choice moves a value
LEAST_CURRENTS = 2  #: the longitudinal friction is fitted along, and needs them
SCORES_S = 0.05  #: longest correlation of the scores that is accounted for
ITERATIONS = 40  #: of one fit
BLOCK_S = 0.02  #: means over this time are what the lateral speed is taken from
TURNED = (
    "The lateral speed's sign would have to be turned: encoder or belt direction. The same data "
    "follow from a guide_lever (d - e) of the other sign."
)
TURNED_GATE = Gate(
    FitOutcome.MISFIT, f"The model does not fit these data: {TURNED}", (TURNED,)
)  # fmt: skip


#: How a lifted row of rollers rubs, and whether the sign of the lateral speed is turned.
Choice = tuple[LiftedRows, bool]


@dataclass(frozen=True, eq=False, kw_only=True)
class LateralFamily(Family[LateralSystem]):
    """A lateral sweep: the choice of the coupling that the data support most, and the others.

    ``parts`` are the trials along the guide, each with the part that is simulated, ``friction`` is
    that along the guide, if another identification has found it. ``loads`` are what the data know
    of the friction of the guide in each trial, ``optimum`` (8,) the coupling that fits them best.
    ``fits`` are the choices that are not far off, and ``gains`` is by how much ln L of each choice
    lies below that of the best.
    """

    trials: tuple[LateralTrial, ...]
    parts: tuple[tuple[LugreTrial, slice], ...]
    friction: Carried | None
    loads: Loads
    optimum: FloatArray
    fits: Mapping[Choice, Coupled]
    gains: Mapping[Choice, float]

    @property
    def rival(self) -> Choice:
        """The choice with the same sign in which a lifted row rubs the other way."""
        return _other(self.system.rows), self.system.turned

    def described(self, trial: int) -> str:
        """Return which trial it is, and how large its signals are."""
        return described(self.trials[trial].trial)

    def fitted(self) -> OutputErrorFit:
        """Return the fit of the choice that the data support most."""
        return self.fits[self.system.rows, self.system.turned].whole

    def elsewhere(self) -> tuple[FloatArray, ...]:
        """Return nothing: the frictions of the trials were sought from other starts."""
        return ()

    def refitted(self, system: System, starts: Sequence[FloatArray], block: int) -> OutputErrorFit:
        """Return the fit of a system with something added, from the best of ``starts`` (p + c,)."""
        return _refit(system, starts, block)

    def refusal(self, whole: OutputErrorFit) -> Gate | None:
        """Return that the sign of the lateral speed would have to be turned, if it would."""
        return TURNED_GATE if self.system.turned else None

    def suspects(self, theta: FloatArray) -> Iterator[Suspect]:
        """Return what may be wrong with rig, sensors, law and coupling."""
        return candidates(self.system, theta)

    def agreement(self, whole: OutputErrorFit, gate: Gate) -> tuple[ResidualTest, ...]:
        """Return the test whether all recordings have one coupling, if there are several."""
        test = agreement(reduced(self.loads, self.system, self.system), self.optimum)
        return () if test is None else (test,)

    def alarms(self, tests: Sequence[ResidualTest]) -> dict[str, float]:
        """Return the levels of all tests that are made, those of the coupling included."""
        levels = super().alarms(()) if not self.system.turned else {}
        levels |= {test.name: MAX_P_VALUE_RECORDINGS for test in tests}
        return levels | {"constants of the coupling": LATERAL.max_p_value_coupling}

    def findings(self, whole: OutputErrorFit, gate: Gate, tests: tuple[ResidualTest, ...]) -> Gate:
        """Return ``gate``, without numbers if a constant that they rest on is strained."""
        gate = settled_gate(gate, whole.unsettled)
        if gate.outcome is not FitOutcome.MISFIT:
            end = coupled(whole, self.block)
            rows = (self.system, replace(self.system, rows=self.rival[0]))
            laws = [end.reduced(part) for part in rows]
            rests = {laws[0].unknowns[place].wording for place in RESTS_ON}
            named = next((item for item in gate.explanations if item.name in rests), None)
            gate = strained_gate(gate, named or strained(laws, end.coupling))
        return with_agreement(gate, *tests)

    def variants(self) -> Iterator[LateralSystem]:
        """Yield the trials with other filters of the current."""
        rig = self.system.rig
        for window_s in OTHER_WINDOWS_S:
            filtered = rig_system(self.parts, rig.constants, rig.start, window_s)
            yield replace(self.system, rig=filtered)

    def fit_of_variant(self, whole: OutputErrorFit, system: LateralSystem) -> FloatArray:
        """Return guide friction and coupling (8,) with another filter of the current."""
        filtered = same_with(whole, system)
        model = replace(whole.model, system=filtered)
        problem = reduced(loads_at(model, whole.fit.theta, self.block), self.system, filtered)
        return fitted(problem, coupling_of(whole)).theta


@dataclass(frozen=True, eq=False)
class LateralIdentification(Identification[LateralFamily]):
    """What a lateral sweep shows.

    ``variants`` (8,) are guide friction and coupling with other filters of the current, ``ends``
    what the data allow of the rollers' friction; None if no number is given.
    """

    speeds: tuple[Speeds, ...] = ()
    cells: tuple[Cell, ...] = ()
    ends: Intervals | None = None

    @property
    def system(self) -> LateralSystem:
        """The trials with the choice of the coupling that the data support most."""
        return self.family.system

    @property
    def shared(self) -> FloatArray:
        """Return the fitted parameters that all trials share, (p,)."""
        return self.theta[: len(self.system.shared)]

    @property
    def range_m_s(self) -> tuple[float, ...]:
        """Return the slowest and the fastest lateral speed; one, if both are the same."""
        return range_of(self.system)

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
    def rows_known(self) -> bool:
        """Whether the data show how a lifted row of rollers rubs."""
        return self.family.gains[self.family.rival] > LATERAL.min_gain_ln_l


def find_lateral(
    trials: Sequence[LateralTrial],
    rig: RigConstants,
    lateral: LateralConstants,
    settings: Settings | None = None,
    friction: Carried | None = None,
) -> LateralIdentification:
    """Return the rollers' friction from ``trials``, by simulating the rig.

    ``friction`` is that along the guide, if another identification has found it.

    Raises:
        DataError: no trial moves sideways, too few currents, or a recording cannot answer.
    """
    settings = Settings() if settings is None else settings
    used, parts, rejected = _usable(trials, settings, 1 if friction else LEAST_CURRENTS)
    try:
        family = _family(used, parts, rig, lateral, friction)
        return _with_intervals(identify(replace(family, rejected=tuple(rejected))))
    except Diverged as error:
        raise Diverged(error.trial, described(used[error.trial].trial)) from error


def _family(
    used: Sequence[LateralTrial],
    parts: Sequence[tuple[LugreTrial, slice]],
    rig: RigConstants,
    lateral: LateralConstants,
    friction: Carried | None,
) -> LateralFamily:
    """Return the fits of ``used`` trials, each with the part that is simulated.

    Raises:
        Diverged: the cost of a trial is not finite at any start.
    """
    smooth = np.array([parameter.start for parameter in PARAMETERS])
    straight = rig_system(parts, rig, smooth)
    period = straight.period_s
    block = max(1, round(SCORES_S / period))
    speeds = tuple(
        _block_means(item.speed_m_s[part][LEAD:], round(BLOCK_S / period))
        for item, (_, part) in zip(used, parts, strict=True)
    )

    def system(rows: LiftedRows, turned: bool) -> LateralSystem:
        return LateralSystem(
            straight, speeds, lateral, rig.bearing_torque.value, rows, turned,
            friction.unknowns if friction else (),
        )  # fmt: skip

    with np.errstate(over="ignore", invalid="ignore"):  # a start may be far from any motion
        loads = _free_loads(system(LiftedRows.PRINTED, turned=False), block)
    coarse = {
        choice: optima(reduced(loads, part, part))
        for choice in product(LiftedRows, (False, True))
        for part in [system(*choice)]
    }
    least = min(ends[0].cost for ends in coarse.values())
    fits: dict[Choice, Coupled] = {}
    for choice, ends in coarse.items():
        if ends[0].cost < least + LATERAL.max_behind_ln_l:
            part = system(*choice)
            near = [end.theta for end in ends if end.cost < ends[0].cost + LATERAL.max_behind_ln_l][
                :MOST_ENDS
            ]
            fits[choice] = couple(part, part, loads, near, block)
    best = min(fits, key=lambda choice: fits[choice].whole.fit.cost)
    lowest = fits[best].whole.fit.cost
    # A choice that is far off needs no fit: the frictions of the trials alone refuse it.
    gains = {
        choice: fits[choice].whole.fit.cost - lowest if choice in fits else ends[0].cost - least
        for choice, ends in coarse.items()
    }
    as_recorded = min(((rows, False) for rows in LiftedRows), key=lambda choice: gains[choice])
    if gains[as_recorded] < LATERAL.min_gain_ln_l:
        best = as_recorded
    return LateralFamily(
        system=system(*best),
        labels=tuple(item.trial.label for item in used),
        period_s=period,
        block=block,
        trials=tuple(used),
        parts=tuple(parts),
        friction=friction,
        loads=loads,
        optimum=coarse[best][0].theta,
        fits=fits,
        gains=gains,
    )


def _with_intervals(found: Identification[LateralFamily]) -> LateralIdentification:
    """Return ``found`` with the speeds that follow, and what the data allow if they fit."""
    family, whole = found.family, found.whole
    speeds = tuple(all_speeds(family.system, whole))
    cells = tuple(
        cell(item, float(np.mean(lateral_speed)), speed)
        for item, lateral_speed, speed in zip(
            family.trials, family.system.speeds, speeds, strict=True
        )
    )
    ends = None
    if found.gate.outcome is not FitOutcome.MISFIT:
        ends = intervals(_laws(family, whole), range_of(family.system))
    return LateralIdentification(
        family, whole, found.gate, found.tests, found.shifts, found.assumptions, found.scans,
        found.variants, found.without, speeds=speeds, cells=cells, ends=ends,
    )  # fmt: skip


def _laws(family: LateralFamily, whole: OutputErrorFit) -> list[Coupled]:
    """Return the fit, and that with the other law of a lifted row unless it is far off."""
    end = coupled(whole, family.block)
    laws = [end]
    if family.gains[family.rival] < LATERAL.max_behind_ln_l:
        other = replace(family.system, rows=family.rival[0])
        extended = same_with(whole, other)
        near = [item.theta for item in optima(reduced(end.loads, other, extended))[:MOST_ENDS]]
        if family.rival in family.fits:
            near.append(family.fits[family.rival].coupling)
        laws.append(couple(other, extended, end.loads, near, family.block))
    return laws


def range_of(system: LateralSystem) -> tuple[float, ...]:
    """Return the slowest and the fastest lateral speed in m/s; one, if both are the same."""
    means = [abs(float(np.mean(speed))) for speed in system.speeds]
    slow = min(value for value in means if value >= 0.5 * min(max(means), 0.1))
    fast = max(means)
    return (slow, fast) if fast > LATERAL.max_speed_ratio * slow else (fast,)


def _other(rows: LiftedRows) -> LiftedRows:
    return LiftedRows.PHYSICAL if rows is LiftedRows.PRINTED else LiftedRows.PRINTED


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
    return loads_of(retried(whole, along_ridge, block, partial(drawn, free)))


def _branch(system: System, theta: FloatArray) -> Branch:
    """Return the fit from ``theta`` (p,), natural, with the noise as at this start.

    Raises:
        Diverged: the cost of a trial is not finite there.
    """
    model = OutputErrorModel(system, noise_at(system, theta))
    try:
        return model, fit(
            model, theta, max_iterations=ITERATIONS, relative_decrease=THRESHOLDS.min_decrease_rough
        )
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
    if fastest < LATERAL.min_speed_m_s:
        raise DataError(
            f"no trial moves sideways: the lateral speed is {1e3 * fastest:.1f} mm/s at most, need "
            f"{1e3 * LATERAL.min_speed_m_s:.0f} mm/s",
            hint="identify recordings without lateral motion by a procedure with `model: lugre`; "
            "else check the signal lateral_speed",
        )
    currents = sorted(item.trial.current_a for item in used)
    distinct = 1 + int(np.count_nonzero(np.diff(currents) > LATERAL.max_apart_a))
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
    if max(high - mean, mean - low) <= max(
        LATERAL.max_unsteady_share * abs(mean), LATERAL.min_speed_m_s
    ):
        return ""
    return f"the lateral speed runs from {low:+.3f} to {high:+.3f} m/s while the wheel is driven"
