"""Identifies the floors of one rig in one fit: they share its constants, masses share friction."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from rigd.analysis import ConfigError, DataError, Options
from rigd.analysis.fitting.model import slopes
from rigd.analysis.joint_account import JointAccount
from rigd.analysis.output_error.estimator import OutputErrorFit
from rigd.analysis.output_error.joint_fit import Joint, SharedConstant, join
from rigd.analysis.parameters import Group, RefusedGroup, each_group
from rigd.analysis.recordings.source import RecordedSweep
from rigd.analysis.report.rounding import probability
from rigd.analysis.result import IdentificationResult, TrialRejection
from rigd_analyses.lugre.conclusion import conclude_group
from rigd_analyses.lugre.model import PARAMETERS
from rigd_analyses.lugre.needs import DRIVE
from rigd_analyses.lugre.quantities import BY_COVARIANCE, COULOMB, STATIC
from rigd_analyses.lugre.reading import (
    CONSTANTS,
    FRICTION_MASS,
    GUIDE_LIFT,
    MASS,
    SLIP_FORCE,
    as_stated,
)
from rigd_analyses.lugre.rig.family import RigFit
from rigd_analyses.lugre.rig.system import OF_THE_RIG
from rigd_analyses.lugre.slip_force.by_law import LUGRE

OF_THE_FLOOR = "rolling_resistance"


def check_joint(sweeps: Sequence[RecordedSweep], options: Options) -> None:
    """Refuse recordings and options that no joint fit can be made of.

    Raises:
        ConfigError: another method, or an option that needs one.
        DataError: the recordings are from different rigs, or state its constants differently.
    """
    other = [f"--method {SLIP_FORCE}"] if options.method == SLIP_FORCE else []
    other += ["--compare"] if options.compare else []
    other += ["--robust"] if options.robust else []
    other += [f"--law {options.law}"] if options.law not in ("", LUGRE) else []
    if other:
        raise ConfigError(
            "--joint: output error alone fits the constants of the rig",
            hint=f"leave out {' and '.join(other)}",
        )
    rigs = dict.fromkeys(sweep.info.rig for sweep in sweeps)
    if len(rigs) > 1:
        raise DataError(
            f"the recordings are from different rigs: {', '.join(rigs)}",
            hint="they share no constants: leave out --joint",
        )
    trials = [(sweep, trial) for sweep in sweeps for trial in sweep.trials]
    names = [name for name in (*CONSTANTS, *DRIVE) if name not in (MASS, OF_THE_FLOOR)]
    names += [name for name in (FRICTION_MASS, GUIDE_LIFT) if _all_give(sweeps, name)]
    for name in names:
        found = {as_stated(sweep, trial, name): sweep.path for sweep, trial in reversed(trials)}
        if len(found) > 1:
            listed = ", ".join(f"{text} in {path}" for text, path in found.items())
            raise DataError(
                f"{name} is {listed}",
                hint=f"correct it with `--set {name}=...`, or leave out --joint",
            )


def masses(sweeps: Sequence[RecordedSweep]) -> tuple[str, ...]:
    """Return the names of parameters that are the mass: they change no friction parameter."""
    found = (sweep.plan.constants.get(MASS) for sweep in sweeps)
    return tuple(dict.fromkeys(name for name in found if isinstance(name, str)))


def identify_together(
    groups: Sequence[Group],
    begun: Sequence[tuple[RigFit, list[TrialRejection]]],
    options: Options,
) -> tuple[list[tuple[Group, IdentificationResult]], list[RefusedGroup], JointAccount]:
    """Return the results of ``groups``, those that cannot answer, and what their joint fit is.

    ``begun`` are the fits of each group by itself (:func:`.reading.first_fit`). Groups that the
    model does not fit are identified each by itself; so are all if they disagree on a constant.

    Raises:
        DataError: the cost of a group is not finite where its first fit ended, or no group can
            answer.
    """
    first = [item for item, _ in begun]
    fitting = [k for k, item in enumerate(first) if item.fits]
    joint = Joint((), ())
    if fitting:
        alone = [first[k].whole for k in fitting]
        joint = join(alone, OF_THE_RIG, [first[k].family.block for k in fitting])
    wholes = {k: whole for k, whole in zip(fitting, joint.fits, strict=True)}
    labels = [group.label for group in groups]

    def concluded(group: Group) -> IdentificationResult:
        k = labels.index(group.label)
        item, lacking = begun[k]
        found = conclude_group(replace(item, whole=wholes.get(k, item.whole)))
        done = found.preprocessing
        done = replace(done, rejected=(*lacking, *done.rejected))
        return replace(found, preprocessing=done)

    found, refused = each_group(groups, concluded)
    results = {group.label: result for group, result in found}
    account = _account(labels, first, joint, fitting, results)
    if joint.differing:
        warnings = account.sentences[:1]
        found = [(g, replace(item, warnings=(*item.warnings, *warnings))) for g, item in found]
    return found, refused, account


def _account(
    labels: Sequence[str], first: Sequence[RigFit], joint: Joint, fitting: Sequence[int],
    results: Mapping[str, IdentificationResult],
) -> JointAccount:  # fmt: skip
    used = tuple(labels[k] for k in fitting)
    apart: list[str] = [
        f"{label} is identified by itself: the model does not fit it."
        for k, label in enumerate(labels)
        if k not in fitting and label in results
    ]
    apart += [
        text for label, item in zip(labels, first, strict=True) for text in _loads(label, item)
    ]
    if joint.differing:
        sentence = _differ(joint.differing[0], used, [first[k].whole for k in fitting])
        return JointAccount((), {}, {}, (sentence, *apart))
    if not joint.constants:
        text = "There are not two groups that the model fits: no constants are shared."
        return JointAccount((), {}, {}, (text, *apart) if len(labels) > 1 else tuple(apart))
    narrower = {
        labels[k]: dict(_shares(first[k].whole, whole, results[labels[k]]))
        for k, whole in zip(fitting, joint.fits, strict=True)
        if labels[k] in results
    }
    sentences = [
        f"{', '.join(used)} are fitted together: they share {len(joint.constants)} constants."
    ]
    for label, shares in narrower.items():
        listed = ", ".join(f"{name} {share:.2f}" for name, share in shares.items())
        sentences.append(f"standard errors of {label} over those by itself: {listed or 'none'}")
    return JointAccount(used, joint.constants_account(), narrower, (*sentences, *apart))


def _loads(label: str, item: RigFit) -> Iterator[str]:
    """Yield a sentence if trials of several masses have one friction."""
    mass = item.family.system.constants.mass.value
    found = dict.fromkeys(f"{mass * trial.trial.load:g} kg" for trial in item.family.system.trials)
    if len(found) > 1:
        yield f"{label}: one friction for all masses, {', '.join(found)}."


def _differ(constant: SharedConstant, labels: Sequence[str], fits: Sequence[OutputErrorFit]) -> str:
    place = [item.parameter.name for item in fits[0].model.system.shared].index(constant.name)
    moved = ", ".join(
        f"{label} {float(item.pulls[place]):+.2f}" for label, item in zip(labels, fits, strict=True)
    )
    return (
        f"Each group is identified by itself, and --joint is not heeded: they disagree on the "
        f"constant {constant.name} ({constant.wording}; {probability(constant.p_value)}). It is "
        f"moved, in its uncertainties: {moved}. Something changed between the recordings."
    )


def _shares(
    alone: OutputErrorFit, together: OutputErrorFit, result: IdentificationResult
) -> Iterator[tuple[str, float]]:
    """Yield the standard errors of what has a number, as shares of those of the group alone."""
    for quantity in (COULOMB, STATIC, *BY_COVARIANCE):
        if not result.parameter(quantity.name).identifiable:
            continue
        sds = []
        for fitted in (alone, together):
            theta = fitted.fit.theta[: len(PARAMETERS)]
            gradient = quantity.log_gradient(theta)[0] * slopes(PARAMETERS, theta)
            cov = fitted.covariance[: len(theta), : len(theta)]
            sds.append(float(np.sqrt(gradient @ cov @ gradient)))
        yield quantity.name, sds[1] / sds[0]


def _all_give(sweeps: Sequence[RecordedSweep], name: str) -> bool:
    return all(name in sweep.plan.constants for sweep in sweeps)
