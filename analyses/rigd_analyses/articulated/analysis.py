"""Declares the analysis of the articulated robot: its needs, and the function that evaluates."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from rigd.analysis import Analysis, Evaluation, Needs, Options

if TYPE_CHECKING:
    from rigd.analysis.source import RecordedSweep
    from rigd.analysis.validation.result import Validation
    from rigd.analysis.validation.saved import SavedModel

MOTORS = ("right_speed", "left_speed")
TORQUES = ("right_torque", "left_torque")
POSES = ("front_x", "front_y", "front_heading", "rear_x", "rear_y", "rear_heading")


class ArticulatedAnalysis(Analysis):
    """Contacts of a two-module robot with slipping wheels, from motors and a camera."""

    needs = Needs(
        signals={
            **dict.fromkeys(MOTORS, "rad/s"),
            **dict.fromkeys(TORQUES, "N m"),
            **{name: "rad" if name.endswith("heading") else "m" for name in POSES},
        },
        constants=(
            *("wheel_radius", "half_track", "half_wheelbase", "hinge_distance", "gear_ratio"),
            *("rotor_inertia", "body_mass", "body_inertia", "wheel_mass", "wheel_inertia"),
            *("gravity", "certain_grip"),
        ),
        constant_units={
            **dict.fromkeys(("wheel_radius", "half_track", "half_wheelbase"), "m"),
            **dict.fromkeys(("body_mass", "wheel_mass"), "kg"),
            **dict.fromkeys(("rotor_inertia", "body_inertia", "wheel_inertia"), "kg m^2"),
            **{"hinge_distance": "m", "gear_ratio": "1", "gravity": "m/s^2", "certain_grip": "1"},
        },
        references=("k_lon", "k_lat", "k_roll", "mu_s", "mu_d"),
    )

    def evaluate(
        self, sweeps: Sequence[RecordedSweep], options: Options, notify: Callable[[str], None]
    ) -> Evaluation:
        """Return the contacts' parameters from all trials of all recordings together."""
        from rigd_analyses.articulated.evaluation import evaluate

        return evaluate(sweeps, options, notify)

    def validate(
        self,
        models: Sequence[SavedModel],
        sweeps: Sequence[RecordedSweep],
        group: str,
        notify: Callable[[str], None],
    ) -> Validation:
        """Return how recordings agree with the contacts of a model."""
        from rigd_analyses.articulated.validation import validate

        return validate(models, sweeps, group, notify)
