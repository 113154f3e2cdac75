"""Makes the plan of a filter of slip from options, constants and a saved model."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from rigd.analysis import DataError
from rigd.analysis.validation.saved_models import SavedModel, read_models
from rigd.computed.observers import model as observers
from rigd.computed.observers.model import Filter, ObserverPlan
from rigd.sdk import WrongEntries
from rigd_analyses.lugre.model import friction, friction_gradient
from rigd_analyses.lugre.trials.known_constants import Known, RigConstants
from rigd_analyses.lugre.validation.friction import friction_of

if TYPE_CHECKING:
    from rigd.computed.observers.memory import Memory
    from rigd_analyses.lugre.slip.observer import SlipOptions

SLOPE_M_S2: Final = 0.02  #: of the floor, times gravity: 0.1 degrees
CURRENT_ZERO_A: Final = 3e-3
FADING_S: Final = 1.0  #: time constant of pushes and torques that are not in the model
#: While something else moves the carriage it may push this much: a belt of 80 N on 4 kg has 20.
HELD_M_S2: Final = 30.0
HELD_NOISE: Final = 3e-5  #: m^2/s^3, of the carriage's speed while it is held
JUMP_SDS: Final = 8.0  #: standard deviations of the monitor that a jump of the current exceeds
LEAST_JUMP_A: Final = 0.03
ZERO_DRIFT: Final = 1e-8  #: (m/s^2)^2/s, of the accelerometer: 1 cm/s^2 in three hours
SPEED_NOISE: Final = 1e-7  #: m^2/s^3, of the carriage's speed
RATE_STEP: Final = 2.0  #: fastest rate times step, at most; Runge-Kutta is stable to 2.78
SMOOTH_M_S: Final = 1e-3  #: speed over which dry friction turns its sign
LEAST_U: Final = 0.002  #: relative: no friction is known better
SLIPS_M_S: Final = np.geomspace(5e-3, 0.1, 12)  #: at which the uncertainty of friction is taken
#: Standard deviations at the beginning: wheel angle, carriage speed, wheel speed, bristles, zero of
#: the accelerometer, push of the rollers' transitions, what the sensor alone feels of them.
AT_REST: Final = (1e-3, 2e-3, 0.04, 0.03)
ZERO_M_S2: Final = 0.05
TRANSITIONS: Final = (0.5, 0.5, 0.3, 0.3)
SETTINGS: Final = ("preprocessing", "settings")
#: Constants of the recursion that output error corrects, with their places in it.
CORRECTED: Final = {
    "drive_gain": 6, "no_load": 7, "wheel_viscous": 8, "wheel_inertia": 9, "guide_friction": 10,
    "rolling_resistance": 11, "wheel_radius": 14,
}  # fmt: skip


@dataclass(frozen=True)
class SlipPlan(ObserverPlan):
    """A filter of slip, in SI: see :mod:`rigd_analyses.lugre.slip.kernel` for the places."""

    q: tuple[float, ...]  #: parameters (20,) of the recursion
    fixed: tuple[float, ...]
    deviations: tuple[float, ...]  #: of the state at the beginning, (13,) or (9,)
    noise: tuple[float, float]  #: standard deviations of angle and acceleration

    def filter(self, memory: Memory) -> Filter:
        """Return the filter on ``memory``."""
        from rigd_analyses.lugre.slip.filter import SlipFilter  # it loads numba

        return SlipFilter(memory, self.q, self.fixed, self.deviations, self.noise)


@dataclass(frozen=True)
class _Law:
    """Friction (6,) with its relative uncertainty, and what else the model file has."""

    theta: tuple[float, ...]
    u: float
    corrected: Mapping[str, float]
    noise: Mapping[str, float]


def plan(
    options: SlipOptions, constants: Mapping[str, observers.Known], period_s: float
) -> SlipPlan:
    """Return the plan.

    Raises:
        WrongEntries: a constant is none that a rig can have, or a noise is missing.
        ConfigError: the model file cannot be read or used.
    """
    known = _constants(constants)
    law = _law(options)
    drive = known.drive_gain
    q = np.zeros(20)
    q[:6] = law.theta
    q[6:12] = (
        drive.value, known.no_load.value, known.viscous.value, known.inertia.value,
        known.guide_friction.value, known.rolling_resistance.value,
    )  # fmt: skip
    q[14] = known.wheel_radius.value
    for name, value in law.corrected.items():
        q[CORRECTED[name]] = value
    mass, normal = known.mass.value, known.normal_force_n
    current, acceleration, count = (
        _noise(options, law, name)
        for name in ("current_noise", "acceleration_noise", "angle_count")
    )
    # What a model has corrected by its recordings is no longer as uncertain as the rig file says.
    guide_u, roll_u, no_load_u = (
        0.0 if name in law.corrected else getattr(known, name).u
        for name in ("guide_friction", "rolling_resistance", "no_load")
    )
    push = options.unknown_push or math.hypot(guide_u / mass, roll_u * normal / mass, SLOPE_M_S2)
    torque = options.unknown_torque or math.hypot(no_load_u / drive.value, CURRENT_ZERO_A)
    rate = q[7] * q[14] / (SMOOTH_M_S * q[9]) + q[14] ** 2 * normal * (q[4] + q[5]) / q[9]
    fixed = (
        mass, normal, known.roller_transitions,
        float(max(1, math.ceil(period_s * float(rate) / RATE_STEP))),
        current, max(JUMP_SDS * current, LEAST_JUMP_A), push, FADING_S, torque, FADING_S,
        HELD_M_S2, HELD_NOISE, ZERO_DRIFT, SPEED_NOISE,
    )  # fmt: skip
    deviations: tuple[float, ...] = (
        *AT_REST,
        push,
        torque,
        ZERO_M_S2,
        law.u,
        drive.u / drive.value,
    )
    if known.roller_transitions > 0.0:
        deviations = (*deviations, *TRANSITIONS)
    return SlipPlan(tuple(q.tolist()), fixed, deviations, (count / math.sqrt(12.0), acceleration))


def _constants(given: Mapping[str, observers.Known]) -> RigConstants:
    values: dict[str, Known | float] = {}
    for field in fields(RigConstants):
        known = given.get(field.name, observers.Known(0.0))
        plain = field.name == "roller_transitions"
        values[field.name] = known.value if plain else Known(known.value, known.u)
    try:
        return RigConstants(**values)  # type: ignore[arg-type]
    except DataError as error:
        raise WrongEntries([(("constants",), error.message)]) from error


def _law(options: SlipOptions) -> _Law:
    law = options.friction
    if law is not None:
        ratio = math.log(law.mu_s / law.mu_c)
        theta = (law.V_s, law.mu_c, ratio, law.sigma_0, law.sigma_1, law.sigma_2)
        return _Law(theta, law.u, {}, {})
    saved = _saved(options)
    found = friction_of(saved)
    steady = friction(found.theta, SLIPS_M_S) + found.theta[5] * SLIPS_M_S
    slopes = friction_gradient(found.theta, SLIPS_M_S)
    slopes[:, 5] = SLIPS_M_S
    spread = np.linalg.norm(slopes @ found.roots, axis=1) / steady
    u = float(np.max(spread, initial=LEAST_U)) if found.uncertain else 0.02
    for other in found.alternatives:
        away = friction(other, SLIPS_M_S) + other[5] * SLIPS_M_S
        u = max(u, float(np.max(np.abs(away / steady - 1.0))) / 2.0)
    corrected, noise = {}, {}
    for name in CORRECTED:
        if saved.get(*SETTINGS, f"fitted {name}") is not None:
            corrected[name] = saved.number(*SETTINGS, f"fitted {name}")
    for option, name in (
        ("current_noise", "current_noise_a"),
        ("acceleration_noise", "acceleration_noise_m_s2"),
        ("angle_count", "angle_count_rad"),
    ):
        if saved.get(*SETTINGS, name) is not None:
            noise[option] = saved.number(*SETTINGS, name)
    return _Law(tuple(found.theta.tolist()), u, corrected, noise)


def _saved(options: SlipOptions) -> SavedModel:
    path = options.model_file or Path()  # the options have this, or friction
    models = read_models(path)
    there = ", ".join(model.group or "one without a name" for model in models)
    if options.group is not None:
        models = tuple(model for model in models if model.group == options.group)
    if len(models) != 1:
        key = "model_file" if options.group is None else "group"
        wrong = "several models" if models else f"no model {options.group}"
        text = f"{path.name} has {wrong}: give `group`, one of {there}"
        raise WrongEntries([((key,), text)])
    if models[0].model != "lugre":
        text = f"{path.name} holds a model {models[0].model}, must be lugre"
        raise WrongEntries([(("model_file",), text)])
    return models[0]


def _noise(options: SlipOptions, law: _Law, name: str) -> float:
    given = getattr(options, name)
    found = law.noise.get(name) if given is None else given
    if found is None:
        text = f"the model does not state {name}: give it beside `model_file`"
        raise WrongEntries([((), text)])
    if not (math.isfinite(found) and found > 0.0):
        raise WrongEntries([(("model_file",), f"its {name} is {found:g}, must be above 0")])
    return float(found)
