"""Brings the omni-wheel rig to output error: current in; slip, travel, acceleration out."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import spearmanr

from rigd.analysis import DataError
from rigd.analysis.fitting.fit import Fit, fit, multi_start
from rigd.analysis.fitting.model import scaled_bounds
from rigd.analysis.fitting.profile import ProfileScan, axis, follow
from rigd.analysis.output_error.augmented_system import without_added
from rigd.analysis.output_error.estimator import OutputErrorFit
from rigd.analysis.output_error.gate import sentence
from rigd.analysis.output_error.homogeneity import TrialParts, changes, homogeneity
from rigd.analysis.output_error.pipeline import (
    DiagnosedFit,
    Family,
    concluded,
    diagnosed,
    fitted,
)
from rigd.analysis.output_error.structure import Suspect
from rigd.analysis.output_error.thresholds import THRESHOLDS
from rigd.analysis.result import (
    FitOutcome,
    FloatArray,
    Gate,
    ResidualTest,
    TrialRejection,
)
from rigd_analyses.lugre.curve import HARDLY, SLIDING, slid_range
from rigd_analyses.lugre.model import (
    MU_C,
    PARAMETERS,
    RATIO,
    V_S,
    LugreModel,
    friction,
)
from rigd_analyses.lugre.rig import kernel
from rigd_analyses.lugre.rig.extensions import BETWEEN, BY_TRIAL, candidates
from rigd_analyses.lugre.rig.parts import sort_out
from rigd_analyses.lugre.rig.ridge import (
    along_ridge,
    bent,
    effect_shown,
    on_ridge,
    unseen,
    without_effect,
)
from rigd_analyses.lugre.rig.standard_errors import (
    FRICTION,
    HEIGHT,
    WINDOW_S,
    RigIdentification,
    all_states,
    beside,
    slip,
)
from rigd_analyses.lugre.rig.system import (
    DELAY_S,
    LATE_SENSORS,
    RigSystem,
    driven_trial,
)
from rigd_analyses.lugre.slip_force.identify import Settings
from rigd_analyses.lugre.trials.identical_trials import refuse_alike
from rigd_analyses.lugre.trials.known_constants import RigConstants
from rigd_analyses.lugre.trials.slip_and_traction import process
from rigd_analyses.lugre.trials.trial import LugreConstants, LugreTrial, sampling_period_s

#: Longest correlation of the scores that is accounted for; those of innovations remember little,
#: and longer blocks would be too few.
SCORES_S = 0.05
OTHER_WINDOWS_S = (0.013, 0.041)  #: by how much the choice moves a parameter
SPEEDS_M_S = (2e-4, 5e-3, 0.1, 2.0)  #: V_s of starts besides those of method A
OTHER_RADIUS = 0.2  #: relative difference that slip does not explain
BASINS = 3  #: optima of method A that output error starts from
OTHER_BASIN = 0.3  #: in scaled coordinates
MONOTONIC, IN_ORDER = 4, 0.9  #: trials, and rank correlation, of which the order is one of currents
LN_2 = math.log(2.0)


@dataclass(frozen=True, eq=False, kw_only=True)
class RigFamily(Family[RigSystem]):
    """The omni-wheel rig: its trials, each with the part that is simulated."""

    parts: tuple[tuple[LugreTrial, slice], ...]

    @property
    def trials(self) -> list[LugreTrial]:
        """The trials that are fitted."""
        return [trial for trial, _ in self.parts]

    @property
    def advice(self) -> str:
        """What to do if a fit has not converged."""
        return "More trials, or --starts, may help."

    def described(self, trial: int) -> str:
        """Return which trial it is, and how large its signals are."""
        return described(self.trials[trial])

    def retries(self, whole: OutputErrorFit) -> list[FloatArray]:
        """Return points along the ridge of V_s, mu_c and mu_s."""
        return along_ridge(whole)

    def suspects(self, theta: FloatArray) -> Iterable[Suspect]:
        """Return what may be wrong with rig, sensors and law."""
        return candidates(self.system, theta)

    def agreement(self, whole: OutputErrorFit, gate: Gate) -> tuple[ResidualTest, ...]:
        """Return the tests whether trials, recordings and masses have one friction.

        Without what was added every trial disagrees: the tests count so only if that is by trial.
        """
        explained = without_added(whole, self.block) if _is_by_trial(gate) else whole
        parts = _parts(self.trials, self.system.constants)
        return homogeneity(explained, MU_C, "friction", parts, self.block, BETWEEN)

    def findings(self, whole: OutputErrorFit, gate: Gate, tests: tuple[ResidualTest, ...]) -> Gate:
        """Return ``gate``, a misfit if the trials need something of their own each."""
        if not _is_by_trial(gate):
            return replace(gate, sentence=" ".join([gate.sentence, *_late_together(gate)]))
        changed = changes(tests)
        why = (*changed, sentence(gate.explanations[0]))[0]
        text = " ".join([f"The model does not fit these data: {why}", *_confounded(self.trials)])
        findings = (*changed, *gate.findings)
        return replace(gate, outcome=FitOutcome.MISFIT, sentence=text, findings=findings)

    def profiles(self, whole: OutputErrorFit, gate: Gate) -> dict[str, ProfileScan]:
        """Return the profiles of V_s, of the frictions that it leaves within the slip, and more."""
        return profiles(whole, visited_slip(self.system, whole, gate))

    def variants(self) -> Iterator[RigSystem]:
        """Yield the trials with other filters of the current."""
        for window_s in OTHER_WINDOWS_S:
            yield rig_system(self.parts, self.system.constants, self.system.start, window_s)


#: The fit of one group by itself, diagnosed, and what is needed to go on from it.
RigFit = DiagnosedFit[RigFamily]


def rig_family(
    trials: Sequence[LugreTrial],
    constants: LugreConstants,
    rig: RigConstants,
    settings: Settings | None = None,
) -> RigFamily:
    """Return ``trials`` for the pipeline of output error.

    The starts come from method A (slip in, traction out) and from the model's own start.

    Raises:
        DataError: the recordings cannot answer (wrong sign, no motion, no rest, too few trials).
    """
    settings = Settings() if settings is None else settings
    periods = [sampling_period_s(trial) for trial in trials]
    parts, rejected = sort_out(trials, periods, settings)
    refuse_alike(parts)
    used = [trial for trial, _ in parts]
    starts = _starts(used, constants, settings)
    system = rig_system(parts, rig, starts[0])
    known = np.array([unknown.parameter.start for unknown in system.shared[FRICTION:]])
    points = [np.concatenate([start, known]) for start in starts]
    points = [*points, *_other_radius(system, points[-1])]
    return family_of(system, parts, tuple(points), tuple(rejected))


def family_of(
    system: RigSystem,
    parts: Sequence[tuple[LugreTrial, slice]],
    starts: tuple[FloatArray, ...],
    rejected: tuple[TrialRejection, ...] = (),
) -> RigFamily:
    """Return the family of ``system``, which is of ``parts``, from shared parameters ``starts``."""
    return RigFamily(
        system=system,
        labels=tuple(trial.label for trial, _ in parts),
        period_s=system.period_s,
        block=max(1, round(SCORES_S / system.period_s)),
        starts=starts,
        parts=tuple(parts),
        rejected=rejected,
    )


def fit_group(
    trials: Sequence[LugreTrial],
    constants: LugreConstants,
    rig: RigConstants,
    settings: Settings | None = None,
) -> RigFit:
    """Return the fit of ``trials`` with its diagnosis; arguments as of :func:`rig_family`.

    Raises:
        DataError: as :func:`rig_family`, or the simulation of a trial leaves the numbers.
    """
    family = rig_family(trials, constants, rig, settings)
    return diagnosed(family, fitted(family))


def with_intervals(begun: RigFit) -> RigIdentification:
    """Return ``begun`` with all that its intervals are made of."""
    found = concluded(begun)
    system = found.family.system
    whole = RigIdentification(
        found.family, found.whole, found.gate, found.tests, found.shifts, found.assumptions,
        found.scans, found.variants, found.without,
        visited=visited_slip(system, found.whole, found.gate),
        load=system.constants.load_shares, beside=beside(found.scans),
    )  # fmt: skip
    if not whole.scans or effect_shown(whole.scans["ratio"], whole.doubt(HEIGHT)):
        return whole
    scans = without_effect(whole.scans)
    return replace(whole, scans=scans, beside=beside(scans))


def _is_by_trial(gate: Gate) -> bool:
    """Whether what explains most is something that each trial has of its own."""
    return any(item.name in BY_TRIAL for item in gate.explanations[:1])


def _late_together(gate: Gate) -> list[str]:
    """Return a sentence if sensors are late by the same: one cause is likelier then than each."""
    late = [item for item in gate.explanations if item.name in LATE_SENSORS]
    if len(late) < 2 or np.ptp([item.size for item in late]) > DELAY_S:
        return []
    if len(late) == len(LATE_SENSORS):
        return [
            "All sensors are late (or early) by the same against the current, so that it may be "
            "the current that is early (or late): these data do not tell the two apart. Look at "
            "the filter and the time stamps of the current monitor first."
        ]
    if all("encoder" in item.name for item in late):
        return ["Both encoders are late by the same: look at the counter or bus that reads both."]
    return []


def described(trial: LugreTrial) -> str:
    """Return which trial it is, and how large its signals are."""
    current, position = trial.motor_current_a, trial.carriage_position_m
    return (
        f"{trial.recording}: trial {trial.label} (current up to {np.max(np.abs(current)):.3g} A, "
        f"travel {np.ptp(position):.3g} m)"
    )


def _parts(trials: Sequence[LugreTrial], rig: RigConstants) -> list[TrialParts]:
    """Return the parts of ``trials`` that must have one friction."""
    return [
        TrialParts(
            "recordings", [trial.recording for trial in trials],
            "Something changed between them; identify each by itself (`rigd identify --group-by "
            "recording`).",
        ),
        TrialParts(
            "masses", [f"{trial.load * rig.mass.value:g} kg" for trial in trials],
            "Check the masses and the guide's friction; without `--joint` each is identified by "
            "itself.",
        ),
    ]  # fmt: skip


def _confounded(trials: Sequence[LugreTrial]) -> list[str]:
    """Return a sentence if the order of the trials is that of their currents."""
    currents = [float(np.max(np.abs(trial.motor_current_a))) for trial in trials]
    if len(trials) < MONOTONIC or abs(spearmanr(range(len(trials)), currents)[0]) < IN_ORDER:
        return []
    return [
        "The trials are in the order of their currents: what changes with time (wear, warming) "
        "cannot be told from what changes with speed (another law of friction). Play them with "
        "`order: random`, and an early one again at the end."
    ]


def rig_system(
    parts: Sequence[tuple[LugreTrial, slice]],
    rig: RigConstants,
    start: FloatArray,
    window_s: float = WINDOW_S,
) -> RigSystem:
    """Return the system of trials with the part of each that is simulated.

    ``start`` (6,) are friction parameters to begin with, ``window_s`` the filter of the current.
    """
    period_s = sampling_period_s(parts[0][0])
    window = _odd(window_s / period_s)
    driven = [driven_trial(trial, part, window, rig.wheel_radius.value) for trial, part in parts]
    return RigSystem(tuple(driven), rig, period_s, start)


def _starts(
    trials: Sequence[LugreTrial], constants: LugreConstants, settings: Settings
) -> list[FloatArray]:
    """Return friction parameters to start from: method A's optima, and some V_s."""
    plain = np.array([parameter.start for parameter in PARAMETERS])
    spread = []
    for speed in SPEEDS_M_S:
        point = plain.copy()
        point[V_S] = speed
        spread.append(point)
    alike = [trial for trial in trials if trial.load == 1.0]  # method A knows one mass
    try:
        sweep = process(alike, constants, settings.guards)
    except DataError:
        return spread  # method A needs more than this one
    model = LugreModel([trial.samples for trial in sweep.trials])
    rough = multi_start(
        model,
        starts=settings.starts,
        seed=settings.seed,
        relative_decrease=THRESHOLDS.min_decrease_rough,
    )
    found = _apart(fit(model, end.theta) for end in _apart(rough)[:BASINS])
    return [*(end.theta for end in found), *spread]


def _apart(ends: Iterable[Fit]) -> list[Fit]:
    """Return ``ends``, of those in one basin the first."""
    found: list[Fit] = []
    for end in ends:
        if all(np.max(np.abs(end.scaled - other.scaled)) > OTHER_BASIN for other in found):
            found.append(end)
    return found


def _other_radius(system: RigSystem, point: FloatArray) -> list[FloatArray]:
    """Return ``point`` with the wheel radius that travel over angle suggests, if it is another.

    Slip makes travel some per cent shorter; a diameter typed for a radius is a factor of two.
    """
    index = [unknown.parameter.name for unknown in system.shared].index("wheel_radius")
    stated = system.shared[index].parameter
    travel = sum(np.ptp(item.trial.carriage_position_m[item.part]) for item in system.trials)
    turned = sum(np.ptp(item.trial.wheel_angle_rad[item.part]) for item in system.trials)
    radius = (
        float(np.clip(travel / turned, stated.low, stated.high)) if turned > 0.0 else point[index]
    )
    if abs(radius / point[index] - 1.0) < OTHER_RADIUS:
        return []
    other = point.copy()
    other[index] = radius
    return [other]


def profiles(whole: OutputErrorFit, visited: tuple[float, float]) -> dict[str, ProfileScan]:
    """Return the profiles that are needed, in scaled coordinates.

    mu_c is g far above V_s, mu_s is g far below it: of a friction that the visited slip does not
    reach nothing is given, and its profile is not made. A scan that finds a better fit is the last.
    """
    count = len(whole.model.parameters)
    low, high = scaled_bounds(PARAMETERS)
    speed = float(whole.fit.theta[V_S])
    lines = {"V_s": (axis(count, V_S), V_S), "ratio": (axis(count, RATIO), RATIO)}
    if speed <= visited[1]:
        lines["mu_c"] = (axis(count, MU_C), MU_C)
    if speed >= visited[0]:
        lines["mu_s"] = (axis(count, MU_C) + axis(count, RATIO), MU_C)
    ridge = on_ridge(whole)
    theta = whole.fit.theta
    there = math.log(float(friction(theta[:FRICTION], np.array([visited[1]]))[0]))
    # Half of mu_c and twice mu_s may fit as well.
    far = {"mu_c": (MU_C, there - LN_2), "mu_s": (RATIO, there + LN_2)} if ridge else {}
    scans = {}
    for name, (direction, index) in lines.items():
        others, branch = whole.others, None
        if name in far:
            place, value = far[name]
            branch = unseen(theta, visited, place)
            point = branch(value)
            others = others if point is None else (*others, point)
        scans[name] = follow(
            whole.model, whole.fit, direction, whole.inverse,
            (float(low[index]), float(high[index])), others=others,
            none=0.0 if name == "ratio" else None,
            bend=bent if name == "V_s" and ridge else None,
            branch=branch,
        )  # fmt: skip
        if scans[name].better is not None:
            return scans
    return scans


def visited_slip(
    system: RigSystem, whole: OutputErrorFit, gate: Gate | None = None
) -> tuple[float, float]:
    """Return the slip range in m/s at which the bristle shows g.

    Raises:
        DataError: it slides in no trial, or hardly; with the sentence of ``gate`` if the model
            does not fit.
    """
    speeds = []
    for trial, states in enumerate(all_states(system, whole)):
        speed = np.abs(slip(system, whole, states))
        bent = np.abs(states[:, kernel.BRISTLE]) >= SLIDING * friction(
            whole.fit.theta[:FRICTION], speed
        )
        speeds.append(speed[bent & (system.trials[trial].jumps == 0.0)])
    visited = slid_range(np.concatenate(speeds), whole.fit.theta, system.period_s)
    if visited is None:
        if gate is not None and gate.outcome is FitOutcome.MISFIT:
            raise DataError(gate.sentence, hint="; ".join(gate.findings[1:]))
        raise DataError(HARDLY, hint="record trials with more current")
    return visited


def _odd(samples: float) -> int:
    count = max(3, round(samples))
    return count + 1 - count % 2
