"""Evaluates recordings of a chain: the trials in which no contact slides are fitted together."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from rigd.analysis import DataError, Options
from rigd.analysis.fitting.fit import fit
from rigd.analysis.output_error.pipeline import identify
from rigd.analysis.output_error.whitened_residuals import OutputErrorModel, noise_at
from rigd.analysis.parameters import Fitted, Group, ParameterEvaluation, Trials, complete_groups
from rigd.analysis.recordings.source import RecordedSweep
from rigd.analysis.result import FloatArray, TrialRejection
from rigd_analyses.articulated.chain.family import chain_family
from rigd_analyses.articulated.chain.layout import layout_of
from rigd_analyses.articulated.chain.result import result
from rigd_analyses.articulated.chain.system import ChainSystem
from rigd_analyses.articulated.checks import check_markers
from rigd_analyses.articulated.evaluation import (
    LABEL,
    certain_grip,
    positive_constant,
    unused,
)
from rigd_analyses.articulated.reading import RobotTrial, robot_trials
from rigd_analyses.articulated.search import refuse_wrong_way, way_share
from rigd_analyses.articulated.thresholds import ROBOT

ROUNDS: Final = 2  #: of choosing trials without sliding and fitting them roughly
ITERATIONS: Final = 30  #: of such a fit
FIRST_S: Final = 8.0  #: of each trial that such a fit takes
FOLDED_RAD: Final = np.radians(80.0)  #: of a hinge: circles bend it by 60 degrees at most
BENT_MOST: Final = 0.98  #: quantile of a trial's frames: single ones show another marker
SLIDES: Final = "a contact may slide: it carries {share:.2f} times its load, {grip:g} is certain"


def evaluate(
    sweeps: Sequence[RecordedSweep], options: Options, notify: Callable[[str], None]
) -> ParameterEvaluation:
    """Return the contacts' parameters from all trials in which they grip.

    Raises:
        DataError: a recording has no complete trial, lacks what the plan states of modules and
            motors, constants differ between recordings, or the data cannot answer.
    """
    trials = [trial for group in complete_groups(sweeps, options, notify) for trial in group.trials]
    grip = certain_grip(trials)
    system, folded = checked(chain_system(trials))
    system, point, sliding = gripping(system, grip, notify)
    found = result(identify(chain_family(system, point, (*folded, *sliding))), grip)
    found = replace(found, warnings=(*found.warnings, *unused(trials)))
    fitted = Fitted(Group(LABEL, trials), found)
    return ParameterEvaluation.of(sweeps, [fitted], options)


def chain_system(
    trials: Trials, contacts: Mapping[str, tuple[float, float]] | None = None
) -> ChainSystem:
    """Return the system of ``trials``; ``contacts`` are known with relative uncertainties.

    Raises:
        DataError: the plan contradicts itself or the recordings, constants differ between these, or
            a signal is missing or too short.
    """
    layout = layout_of(trials)
    arrays = tuple(robot_trials(trials, layout.signals))
    keys = {key for keys in layout.keys for key in keys if key}
    constants = {
        name: (
            positive_constant(trials, name),
            max(sweep.uncertainty(trial, name) or 0.0 for sweep, trial in trials),
        )
        for name in sorted({*keys, "gravity", "rotor_inertia"})
    }
    gears = [
        positive_constant(trials, layout.key(motor.module, "gear_ratio")) for motor in layout.motors
    ]
    return ChainSystem(arrays, constants, layout, np.array(gears), contacts or {})


def checked(system: ChainSystem) -> tuple[ChainSystem, tuple[TrialRejection, ...]]:
    """Return the trials in which the robot does not fold, and those in which it does.

    Raises:
        DataError: a marker is not seen, or is another's; the robot folds in each trial; or it goes
            another way than its wheels turn.
    """
    pulls = all(item.module == 0 for item in system.layout.motors)
    check_markers(system.trials, pulls=pulls)
    folded = {k: why for k, item in enumerate(system.trials) if (why := _folded(item))}
    rejected = tuple(TrialRejection(system.trials[k].label, why) for k, why in folded.items())
    if len(folded) == len(system.trials):
        raise DataError(
            f"the robot folds in each trial: {rejected[0].label}: {rejected[0].reason}",
            hint="a driven module pushes those ahead of it: let it turn slower than these, and "
            "drive wider circles",
        )
    system = system.of([k for k in range(len(system.trials)) if k not in folded])
    motor = system.layout.motors[0]
    key = system.layout.key(motor.module, "wheel_radius")
    radius, ratio = system.constants[key][0], float(system.gears[0])
    first = [k for k, item in enumerate(system.layout.motors) if item.module == motor.module]
    share = way_share(system.trials, radius / ratio, first, 3 * motor.module)
    refuse_wrong_way(share, radius, ratio)
    return system, rejected


def _folded(item: RobotTrial) -> str:
    """Return at which hinge the robot folds in a trial, and how far; empty if at none."""
    for k, name in enumerate(item.modules[:-1]):
        bent = np.abs(item.poses[:, 3 * k + 2] - item.poses[:, 3 * k + 5])
        most = float(np.quantile(bent, BENT_MOST))
        if most > FOLDED_RAD:
            return (
                f"the hinge behind the {name} module is bent by {np.degrees(most):.0f} degrees, "
                "as far as to a stop, which the model does not have"
            )
    return ""


def gripping(
    system: ChainSystem, grip: float, notify: Callable[[str], None]
) -> tuple[ChainSystem, FloatArray, tuple[TrialRejection, ...]]:
    """Return the trials in which no contact slides, a point (p,) near their fit, and the others.

    Raises:
        DataError: a contact may slide in each trial.
    """
    point = np.array([item.parameter.start for item in system.shared])
    chosen: list[int] = []
    shares: list[float] = []
    for _ in range(ROUNDS):
        shares = [system.share(k, point) for k in range(len(system.trials))]
        before, chosen = chosen, [k for k, share in enumerate(shares) if share <= grip]
        if not chosen:
            break
        if chosen != before:
            notify(f"{len(chosen)} of {len(shares)} trials without sliding are fitted")
            part = replace(system, trials=tuple(system.trials[k].first(FIRST_S) for k in chosen))
            point = _rough(part, point)
    shares = [system.share(k, point) for k in range(len(system.trials))]
    chosen = [k for k, share in enumerate(shares) if share <= grip]
    if not chosen:
        raise DataError(
            f"a contact carries more than {grip:g} times its load in each trial",
            hint="record slower circles, and straight runs with a ramp; if the contacts grip "
            "better, state a higher certain_grip",
        )
    rejected = tuple(
        TrialRejection(item.label, SLIDES.format(share=share, grip=grip))
        for item, share in zip(system.trials, shares, strict=True)
        if share > grip
    )
    return system.of(chosen), point, rejected


def _rough(system: ChainSystem, point: FloatArray) -> FloatArray:
    """Return the shared parameters (p,) of a rough fit from ``point``."""
    local = [item.parameter.start for item in system.local]
    theta = np.concatenate([point, np.tile(local, len(system.trials))])
    model = OutputErrorModel(system, noise_at(system, theta))
    ended = fit(model, theta, max_iterations=ITERATIONS, relative_decrease=ROBOT.min_decrease_first)
    return ended.theta[: len(system.shared)]
