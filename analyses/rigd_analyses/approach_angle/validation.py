"""Validates the friction of one campaign on the runs of another: friction, and motion.

The model of a set is its curve mu(v) of F_r/N over the sliding speed v. A run of other recordings,
in which the wheel slides, is compared with it twice, by sensors that do not depend on each other:

- friction: F_r/N of the gauges in each block against mu(v) at the sliding speed of the block;
- speed: the motion of the platform that mu(v) makes, from the speed with which the sliding begins,
  against its potentiometer. Only the speed of the wheel enters (angle.md section 1):

      m dV/dt = mu(v) N cos(alpha) - F_a sin(alpha) - F_rail,    v = R_eff w - V cos(alpha)

Each limit is three times what noise, the spread of runs about the curve, the model and the rig are
uncertain by. The verdict on a set is by its runs, of which chance lets 0.3 % fail, and by the mean
of what they show relative to the model, which is better known than any run. If both campaigns have
one calibration, what is wrong with it is in both and cancels.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.stats import binom

from rigd.analysis import DataError
from rigd.analysis.recordings.source import RecordedSweep
from rigd.analysis.result import TrialRejection
from rigd.analysis.validation.result import (
    Deviation,
    GroupValidation,
    ModelOutcome,
    OutputTrace,
    ValidatedTrial,
    Validation,
)
from rigd.analysis.validation.saved_models import SavedModel
from rigd_analyses.approach_angle.better.settings import BetterSettings
from rigd_analyses.approach_angle.campaign.campaign import analyse_campaign
from rigd_analyses.approach_angle.evaluation import known_runs, settings_of
from rigd_analyses.approach_angle.paper.settings import PaperSettings
from rigd_analyses.approach_angle.raw.known_quantities import calibration_of
from rigd_analyses.approach_angle.raw.run_data import FloatArray, KnownRun, Severity
from rigd_analyses.approach_angle.result import CampaignResult
from rigd_analyses.approach_angle.run_result import RunResult
from rigd_analyses.approach_angle.shared.balance import EXCLUDED_SHARE, MOUNTING_U
from rigd_analyses.approach_angle.shared_error import CHANCE

TITLE: Final = "Validation of friction over the approach angle"
FRICTION, SPEED = "friction", "speed"
COVERAGE: Final = 3.0  #: standard uncertainties of a limit
#: A limit of the mean beyond this, relative, does not tell one floor or wheel from another.
USEFUL_LIMIT: Final = 0.25
STATEMENTS: Final = (
    "F_r/N of the gauges, in blocks of 20 ms in which the wheel slides, is compared with the curve "
    "of the model at the same sliding speed.",
    "The curve, with the measured speed of the wheel, drives the platform from the speed at which "
    "the sliding begins; the modelled speed is compared with that of its potentiometer. Torque "
    "does not enter.",
    "A run passes if neither is off by more than three times what noise, the spread between runs, "
    "the model and the rig are uncertain by. A set is rejected if more runs fail than chance lets, "
    "or if their mean is off by more than three times what it is uncertain by.",
)


@dataclass(frozen=True, eq=False)
class CurveModel:
    """The friction of one set as a campaign left it; uncertainties are relative, k = 1."""

    name: str
    speed_m_s: FloatArray
    mu: FloatArray
    maximum_u: float
    between_runs_u: float  #: that part of ``maximum_u`` which the runs themselves show
    scatter: float  #: of one run about the curve

    @staticmethod
    def of(saved: SavedModel, name: str) -> CurveModel | None:
        """Return the model of the set ``name``; None if ``saved`` has no maximum of it.

        Raises:
            ConfigError: the file is not as `rigd identify` writes it.
        """
        keys = ("sets", name)
        if saved.get(*keys, "maximum", "value") is None:
            return None
        grid = saved.get(*keys, "curve", "sliding_speed_m_per_s")
        shape = (len(grid) if isinstance(grid, list) else 0,)
        value = saved.number(*keys, "maximum", "value")
        terms = saved.get(*keys, "budget", "terms")
        last = len(terms) - 1 if isinstance(terms, list) else 0
        return CurveModel(
            name,
            saved.numbers(*keys, "curve", "sliding_speed_m_per_s", shape=shape),
            saved.numbers(*keys, "curve", "mu", shape=shape),
            0.5 * saved.number(*keys, "maximum", "U_k2") / value,
            saved.number(*keys, "statistical_u_k1") / value,
            saved.number(*keys, "budget", "terms", last, "relative_u_k1", "better"),
        )

    def at(self, speed_m_s: FloatArray | float) -> FloatArray:
        """Return F_r/N at sliding speeds; beyond the curve, that of its end."""
        speed = np.maximum(speed_m_s, self.speed_m_s[0])
        return np.asarray(np.interp(np.log(speed), np.log(self.speed_m_s), self.mu))


def validate(
    models: Sequence[SavedModel],
    sweeps: Sequence[RecordedSweep],
    group: str,
    notify: Callable[[str], None],
) -> Validation:
    """Return how the campaign ``sweeps`` agrees with the saved one; ``group`` names its set.

    Raises:
        ConfigError: the model is not usable, or has no such set.
        DataError: a recording lacks a signal or constant, or in no run the wheel slides.
    """
    (saved,) = models
    if group and CurveModel.of(saved, group) is None:
        sets = saved.get("sets")
        there = ", ".join(sets) if isinstance(sets, dict) else "none"
        raise saved.error(f"--group {group}: no such set", ("sets",), hint=f"it has {there}")
    calibrations = {sweep.path: calibration_of(sweep, None) for sweep in sweeps}
    known = known_runs(sweeps, calibrations)
    notify(f"{len(known)} runs by the model {saved.path.name}")
    settings = settings_of(sweeps)
    result = analyse_campaign(known, None, PaperSettings(limits=settings.limits), settings)
    hashes = {str(item.used.sha256) for item in calibrations.values()}
    made_with = saved.get("calibrations")
    same = isinstance(made_with, list) and hashes == {
        str(item.get("sha256")) for item in made_with if isinstance(item, dict)
    }
    groups = validated(
        lambda name: CurveModel.of(saved, group or name), known, result, settings, same=same
    )
    if not groups:
        raise DataError(
            f"in no run of a set that {saved.path.name} has a maximum of the wheel slides",
            hint="use higher voltages or lower loads, or `--group SET`",
        )
    findings = [error.sentence for error in result.shared]
    if any(saved.made_from(sweep.path) for sweep in sweeps):
        findings.append("The model was identified from these recordings: it predicts nothing new.")
    return Validation(
        "approach-angle", TITLE,
        tuple(_with(item, findings) for item in groups), (FRICTION, SPEED), STATEMENTS,
        method="speed of the wheel in, friction and speed of the platform out",
    )  # fmt: skip


def _with(item: GroupValidation, findings: Sequence[str]) -> GroupValidation:
    return GroupValidation(
        item.label, item.model, item.outcome, item.sentence, item.trials,
        findings=(*item.findings, *findings), left_out=item.left_out,
    )  # fmt: skip


def validated(
    model_of: Callable[[str], CurveModel | None],
    known: Sequence[KnownRun],
    result: CampaignResult,
    settings: BetterSettings,
    *,
    same: bool,
) -> list[GroupValidation]:
    """Return each set of ``result`` that has a model and runs that slide.

    ``same``: the model was made with the calibration of these runs.
    """
    groups = []
    for found in result.sets:
        model = model_of(found.name)
        if model is None:
            continue
        trials, shifts, left_out = [], [], []
        for k, run in zip(known, result.runs, strict=True):
            if run.run.set_name != found.name:
                continue
            reason = _unusable(run, settings)
            if reason:
                left_out.append(TrialRejection(run.run.label, reason))
                continue
            trial, shift = _trial(model, k, run, settings)
            trials.append(trial)
            shifts.append(shift)
        if not trials:
            continue
        scatter = max(model.scatter, float(np.std(shifts)))
        u = scatter / math.sqrt(len(trials))
        if same:
            u = math.hypot(u, model.between_runs_u, MOUNTING_U)
        else:
            own = 0.0 if found.budget is None else found.budget.systematic
            u = math.hypot(u, model.maximum_u, own, MOUNTING_U)
        outcome, sentence = _verdict(trials, float(np.mean(shifts)), u)
        groups.append(
            GroupValidation(
                found.name, model.name, outcome, sentence, tuple(trials), left_out=tuple(left_out)
            )
        )
    return groups


def _unusable(run: RunResult, settings: BetterSettings) -> str:
    """Return why a run is left out; "" if it is used."""
    for flag in run.flags:
        if flag.severity is Severity.EXCLUDED:
            return flag.reason
    if np.count_nonzero(run.better.blocks.sliding) <= settings.min_sliding_blocks:
        return "the wheel does not slide steadily"
    return ""


def _trial(
    model: CurveModel, known: KnownRun, run: RunResult, settings: BetterSettings
) -> tuple[ValidatedTrial, float]:
    """Return one run beside the model, and by how much its F_r/N is larger, relative."""
    blocks = run.better.blocks
    used = blocks.sliding
    modelled, measured = model.at(blocks.sliding_speed_m_s[used]), blocks.mu[used]
    rest = measured - modelled
    level = float(np.mean(modelled))
    noise = float(np.std(np.diff(rest))) / math.sqrt(2.0)
    spread = math.hypot(model.maximum_u, model.scatter)
    friction = Deviation(
        FRICTION, "1", _rms(rest), _rms(rest), _rms(measured),
        COVERAGE * math.hypot(noise, level * spread, run.better.mu_u),
    )  # fmt: skip
    t_s, platform, predicted = _motion(model, known, run, settings)
    error = platform - predicted
    normal = float(np.mean(blocks.normal_force_n[used]))
    balance_u = run.better.force_residual_limit / settings.balance_coverage
    force_u = normal * math.hypot(level * spread, balance_u)
    mass, cos = known.rig.platform_mass_kg, math.cos(known.run.alpha_rad)
    push_u = 0.0 if run.better.balance is None else run.better.balance.push_u_n
    ends_u = push_u * settings.block_s * used.size / mass
    grown = force_u * cos / mass * _rms(t_s - t_s[0])
    speed = Deviation(
        SPEED, "m/s", _rms(error), _rms(error), _rms(platform),
        COVERAGE * math.hypot(ends_u, grown),
    )  # fmt: skip
    low, high = float(model.speed_m_s[0]), float(model.speed_m_s[-1])
    slid = blocks.sliding_speed_m_s[used]
    beyond = int(np.count_nonzero((slid < low) | (slid > high)))
    note = f"{beyond} of {slid.size} blocks slide beyond the speeds of the model" if beyond else ""
    item = run.run
    trial = ValidatedTrial(
        item.label, item.recording,
        {"set": item.set_name, "load": f"{item.announced_load_kg:g} kg",
         "voltage": f"{item.voltage_v:g} V"},
        (friction, speed), t_s,
        (
            OutputTrace(FRICTION, "1", np.interp(t_s, blocks.t_s[used], measured),
                        np.interp(t_s, blocks.t_s[used], modelled)),
            OutputTrace(SPEED, "m/s", platform, predicted),
        ),
        note,
    )  # fmt: skip
    return trial, float(np.mean(rest)) / level


def _motion(
    model: CurveModel, known: KnownRun, run: RunResult, settings: BetterSettings
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return times, measured and modelled speed of the platform while the wheel slides, (n,)."""
    curves, blocks, rig = run.better.curves, run.better.blocks, known.rig
    if curves is None:
        raise ValueError(f"{run.run.label} has blocks and no speeds")
    at = np.flatnonzero(blocks.sliding)
    end = int(at[0] + np.argmin(np.append(blocks.sliding[at[0] :], False)))
    half = 0.5 * settings.block_s
    inside = (curves.t_s >= blocks.t_s[at[0]] - half) & (curves.t_s <= blocks.t_s[end - 1] + half)
    t_s, platform = curves.t_s[inside], curves.platform_speed_m_s[inside]
    rim = rig.effective_radius.value * rig.wheel_radius_m * curves.wheel_speed_rad_s[inside]
    normal = np.interp(t_s, blocks.t_s, blocks.normal_force_n)
    sin, cos = math.sin(known.run.alpha_rad), math.cos(known.run.alpha_rad)
    axial = rig.roller_drag.value * normal
    speed = np.empty_like(platform)
    speed[0] = platform[0]
    for k in range(t_s.size - 1):
        force = float(model.at(rim[k] - speed[k] * cos)) * normal[k]
        rails = rig.rail_constant.value + rig.rail_viscous.value * speed[k]
        rails += rig.rail_load.value * (
            abs(normal[k] - rig.platform_mass_kg * rig.gravity) + abs(force * sin + axial[k] * cos)
        )
        push = force * cos - axial[k] * sin - rails
        speed[k + 1] = speed[k] + push / rig.platform_mass_kg * (t_s[k + 1] - t_s[k])
    return t_s, platform, speed


def _verdict(trials: Sequence[ValidatedTrial], mean: float, u: float) -> tuple[ModelOutcome, str]:
    """Return the outcome of a set, and a sentence on it.

    ``mean`` is by how much F_r/N of the runs is larger than that of the model, ``u`` the standard
    uncertainty of it; both are relative. The model is rejected if the mean exceeds its limit, or if
    more runs fail than chance explains.
    """
    failed = sum(not trial.passes for trial in trials)
    chance = float(binom.sf(failed - 1, len(trials), EXCLUDED_SHARE)) if failed else 1.0
    limit = COVERAGE * u
    finding = (
        f"F_r/N is {mean:+.1%} from the model in the mean of {len(trials)} runs, at most "
        f"{limit:.1%} is explained; {failed} runs are beyond their own limits"
    )
    if abs(mean) > limit or chance < CHANCE:
        return ModelOutcome.REJECTED, f"{finding}: the friction is another one, or the rig is."
    if limit > USEFUL_LIMIT:
        return ModelOutcome.UNTESTED, f"{finding}: that does not tell one floor from another."
    return ModelOutcome.CONFIRMED, f"{finding}."


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
