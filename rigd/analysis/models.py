"""The models that `identify: {model: …}` may name, and what each needs. Imports nothing heavy."""

from __future__ import annotations

import difflib
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from rigd.model.errors import ConfigError, Place
from rigd.model.units import parse_unit
from rigd.procedure.program import IdentifyPlan

if TYPE_CHECKING:
    from rigd.config.rig import RigConfig


@dataclass(frozen=True)
class ModelNeeds:
    """Names that a plan must give, and the trial parameters that method and labels rest on.

    ``optional`` are constants that a plan may give, ``optional_signals`` signals. ``module`` offers
    ``evaluate``, an :data:`~rigd.analysis.evaluation.Evaluator`.
    """

    module: str
    signals: tuple[str, ...]
    constants: tuple[str, ...]
    parameters: tuple[str, ...]  #: of the model, for the reference
    trial_parameters: tuple[str, ...]
    optional: tuple[str, ...] = ()
    optional_signals: tuple[str, ...] = ()
    units: Mapping[str, str] = field(default_factory=dict)  #: of signals, of the kind of this one
    calibrated: tuple[str, ...] = ()  #: values that the rig's calibration must have
    calibrated_with: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  #: of a signal
    calibrated_if_known: tuple[str, ...] = ()  #: values that are used where known
    measures: tuple[str, ...] = ()  #: values that such a recording calibrates

    def calibration(self, plan: IdentifyPlan) -> tuple[str, ...]:
        """Return the calibrated values that evaluating ``plan`` rests on."""
        further = (self.calibrated_with.get(signal, ()) for signal in plan.signals)
        return (*self.calibrated, *(name for names in further for name in names))


#: Of the approach-angle rig: volts, which a calibration turns into quantities, and the scale.
_RAW: Final = {
    "gauge_a": "V",
    "gauge_b": "V",
    "wheel_angle": "V",
    "platform_position": "V",
    "normal_force": "V",
    "load": "kg",
}

MODELS: Final = {
    "lugre": ModelNeeds(
        module="rigd_analyses.lugre.reading",
        signals=("wheel_angle", "carriage_position", "acceleration", "motor_current"),
        units={
            "wheel_angle": "rad",
            "carriage_position": "m",
            "acceleration": "m/s^2",
            "motor_current": "A",
        },
        constants=("mass", "wheel_radius", "guide_friction", "rolling_resistance", "gravity"),
        parameters=("V_s", "mu_c", "mu_s", "sigma_0", "sigma_1", "sigma_2"),
        trial_parameters=("current",),
        optional=("guide_friction_mass",),
    ),
    "approach-angle": ModelNeeds(
        module="rigd_analyses.approach_angle.evaluation",
        signals=("gauge_a", "gauge_b", "wheel_angle", "platform_position", "relay", "load"),
        constants=("angle", "wheel_radius", "wheel_inertia", "platform_mass", "gravity"),
        parameters=("maximum",),
        trial_parameters=("set", "load", "voltage"),
        optional_signals=("normal_force",),
        units=_RAW,
        calibrated=(
            "torque_scale",
            "wheel_scale",
            "platform_scale",
            "load_scale",
            "effective_radius",
            "bearing_constant",
            "bearing_viscous",
            "bearing_load",
            "rolling_resistance",
            "roller_drag",
            "rail_constant",
            "rail_load",
            "rail_viscous",
        ),
        calibrated_with={"normal_force": ("normal_force_scale", "normal_force_zero")},
        calibrated_if_known=("load_rise",),
    ),
    "torque-calibration": ModelNeeds(
        module="rigd_analyses.approach_angle.calibration.evaluation",
        signals=("gauge_a", "gauge_b"),
        units=_RAW,
        constants=(
            "arm",
            "arm_uncertainty",
            "mass_uncertainty",
            "gravity",
            "gravity_uncertainty",
            "alignment_uncertainty",
            "poisson",
        ),
        parameters=(),
        trial_parameters=("mass",),
        measures=("torque_scale",),
    ),
    "scale-calibration": ModelNeeds(
        module="rigd_analyses.approach_angle.calibration.evaluation",
        signals=("load",),
        units=_RAW,
        constants=("weight_uncertainty", "division"),
        parameters=(),
        trial_parameters=("weight",),
        measures=("load_scale",),
    ),
    "friction-calibration": ModelNeeds(
        module="rigd_analyses.approach_angle.calibration.evaluation",
        signals=("gauge_a", "gauge_b", "wheel_angle", "platform_position"),
        units=_RAW,
        constants=("platform_mass", "platform_mass_uncertainty", "gravity", "wheel_inertia"),
        parameters=(),
        trial_parameters=("test",),
        calibrated=("torque_scale", "wheel_scale", "platform_scale", "rail_load"),
        measures=("bearing_constant", "bearing_viscous", "rail_constant", "rail_viscous"),
    ),
    "rise-calibration": ModelNeeds(
        module="rigd_analyses.approach_angle.calibration.evaluation",
        signals=("load", "platform_position"),
        units=_RAW,
        constants=("division",),
        parameters=(),
        trial_parameters=("load",),
        calibrated=("platform_scale",),
        measures=("load_rise",),
    ),
}


def needs_of(
    plan: IdentifyPlan,
    place: Place | None = None,
    trial_parameters: Collection[str] | None = None,
    rig: RigConfig | None = None,
) -> ModelNeeds:
    """Return what the model of ``plan`` needs, once the plan gives all of it and nothing else.

    ``place`` is where the plan stands in its file, for the error; ``trial_parameters`` are those
    that the trials have, ``rig`` the one whose channels are the signals, where that is known.

    Raises:
        ConfigError: no such model; a signal, constant or reference that is missing or unknown; or
            a signal of another kind than the model works from.
    """
    if plan.model not in MODELS:
        raise ConfigError(
            f"identify: there is no model {plan.model!r}",
            hint=_nearest(plan.model, MODELS),
            place=place,
        )
    needs = MODELS[plan.model]
    for kind, given, wanted in (
        ("signal", plan.signals, needs.signals),
        ("constant", plan.constants, needs.constants),
    ):
        missing = [name for name in wanted if name not in given]
        if missing:
            raise ConfigError(
                f"identify: model {plan.model} needs the {kind} {', '.join(missing)}",
                hint=f"give it under `identify: {kind}s:` in the procedure",
                place=place,
            )
    for kind, given_names, known in (
        ("signal", plan.signals, needs.signals + needs.optional_signals),
        ("constant", plan.constants, needs.constants + needs.optional),
        ("reference", [name.rpartition(".")[2] for name in plan.reference], needs.parameters),
    ):
        for name in given_names:
            if name not in known:
                raise ConfigError(
                    f"identify: model {plan.model} has no {kind} {name!r}",
                    hint=_nearest(name, known),
                    place=place,
                )
    for name in needs.trial_parameters:
        if trial_parameters is not None and name not in trial_parameters:
            raise ConfigError(
                f"identify: model {plan.model} needs trials with a parameter {name!r}",
                hint=_nearest(name, trial_parameters),
                place=place,
            )
    if rig is not None:
        for name, unit in needs.units.items():
            _check_unit(name, unit, plan.signals.get(name, ""), rig, place)
    return needs


def _check_unit(signal: str, unit: str, written: str, rig: RigConfig, place: Place | None) -> None:
    channel = rig.channel(written)
    if channel is None or parse_unit(channel.unit).same_kind(parse_unit(unit)):
        return
    raw = rig.channel(f"{written}_raw")
    raise ConfigError(
        f"identify: the signal {signal} is {written}, in {channel.unit}; the model works from "
        f"{unit}",
        hint="" if raw is None else f"did you mean '{written}_raw'?",
        place=place,
    )


def _nearest(name: str, known: Iterable[str]) -> str:
    names = list(known)
    close = difflib.get_close_matches(name, names, n=1)
    return f"did you mean {close[0]!r}?" if close else "there are: " + ", ".join(names)
