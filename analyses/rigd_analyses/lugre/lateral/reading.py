"""Converts recordings of lateral sweeps to the arrays that their identification needs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from rigd.analysis import DataError
from rigd.analysis.parameters import Trials
from rigd.analysis.recordings.source import RecordedSweep, TrialInfo
from rigd_analyses.lugre.lateral.constants import LateralConstants, LateralTrial
from rigd_analyses.lugre.lateral.family import find_lateral
from rigd_analyses.lugre.lateral.needs import GEOMETRY, ROLLERS
from rigd_analyses.lugre.lateral.result import LateralResult, result
from rigd_analyses.lugre.lateral.saved_friction import Carried
from rigd_analyses.lugre.reading import arrays, by_current, rig_constants, sort_out, uncertainties
from rigd_analyses.lugre.trials.known_constants import Known
from rigd_analyses.lugre.trials.trial import LugreTrial

#: Uncertainty of a constant that states none: a caliper at a length of centimetres, a ruler at
#: the height; the lever is the small difference of two arms, and the share is of its value.
UNSTATED_U_M = {
    "guide_height": 1e-3,
    "guide_half_span": 5e-4,
    "row_distance": 5e-4,
    "mass_offset": 1e-3,
}
UNSTATED_LEVER = 0.1
UNSTATED_ROLLERS = 0.15  #: of a friction that is stated: what the paper's Table IV corresponds to
#: Constants that all trials of a group share.
SHARED = (*GEOMETRY, *ROLLERS)


def identify(trials: Trials, friction: Carried | None = None) -> LateralResult:
    """Return the rollers' friction from trials recorded under the same conditions.

    ``friction`` is that along the guide, if another identification has found it.

    Raises:
        DataError: a signal or constant is missing or not possible, constants differ between
            recordings, or the data cannot answer.
    """
    usable, unusable = sort_out(trials, _named)
    straight, constants = arrays(usable, _named)
    rig = rig_constants(usable, constants)
    lateral = lateral_constants(usable)
    found = find_lateral(
        [
            _lateral_trial(sweep, info, trial)
            for (sweep, info), trial in zip(usable, straight, strict=True)
        ],
        rig,
        lateral,
        friction=friction,
    )
    rejected = (*unusable, *found.family.rejected)
    return result(replace(found, family=replace(found.family, rejected=rejected)))


def lateral_constants(trials: Trials) -> LateralConstants:
    """Return what all ``trials`` have in common of the coupling, with standard uncertainties.

    Raises:
        DataError: a constant is missing, not possible, or one or its uncertainty differs between
            trials.
    """
    sweep, trial = trials[0]
    given = [name for name in SHARED if name in GEOMETRY or name in sweep.plan.constants]
    values = {name: sweep.constant(trial, name) for name in given}
    for other, further in trials:
        for name in SHARED:
            stated = other.constant(further, name) if name in other.plan.constants else None
            if stated != values.get(name):
                raise DataError(
                    f"{name} is {values.get(name)} in trial {trial.number} of {sweep.path} and "
                    f"{stated} in trial {further.number} of {other.path}",
                    hint="they cannot be fitted together: add what changed to `group_by`",
                )

    stated_u = uncertainties(trials, given)

    def known(name: str, default: float) -> Known:
        u = stated_u[name]
        return Known(values[name], default if u is None else u)

    return LateralConstants(
        lever=known("guide_lever", UNSTATED_LEVER * abs(values["guide_lever"])),
        height=known("guide_height", UNSTATED_U_M["guide_height"]),
        half_span=known("guide_half_span", UNSTATED_U_M["guide_half_span"]),
        row_distance=known("row_distance", UNSTATED_U_M["row_distance"]),
        mass_offset=known("mass_offset", UNSTATED_U_M["mass_offset"]),
        bearing_spacing=values["bearing_spacing"],
        bearing_overhang=values["bearing_overhang"],
        dry=_roller("mu_R_dry", values, known),
        viscous=_roller("mu_R_vis", values, known),
    )


def _roller(
    name: str, values: Mapping[str, float], known: Callable[[str, float], Known]
) -> Known | None:
    return known(name, UNSTATED_ROLLERS * abs(values[name])) if name in values else None


def _lateral_trial(sweep: RecordedSweep, info: TrialInfo, trial: LugreTrial) -> LateralTrial:
    asked = info.parameters.get("lateral_speed")
    if not isinstance(asked, int | float):
        raise DataError(
            f"{sweep.path}: trial {info.number} has no parameter 'lateral_speed'",
            hint="the tables compare trials by the lateral speed that was asked for",
        )
    return LateralTrial(trial, sweep.signals(info)[1]["lateral_speed"], abs(float(asked)))


def _named(sweep: RecordedSweep, info: TrialInfo) -> str:
    """Return what a person calls the trial: ``0.6 A, 0.2 m/s, positive``."""
    words = [text for text in info.parameters.values() if isinstance(text, str)]
    return ", ".join([by_current(sweep, info), sweep.parameter(info, "lateral_speed"), *words])
