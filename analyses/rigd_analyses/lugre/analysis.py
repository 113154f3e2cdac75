"""Declares the LuGre analysis to rigd: its needs, and the function that evaluates recordings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from rigd.analysis import Analysis, Evaluation, Needs, Options
from rigd_analyses.lugre.rig.constants import UNITS

if TYPE_CHECKING:
    from rigd.analysis.designing import Designed, DesignRequest
    from rigd.analysis.source import RecordedSweep
    from rigd.analysis.validation.result import Validation
    from rigd.analysis.validation.saved import SavedModel


class LugreAnalysis(Analysis):
    """LuGre friction of an omni-wheel that drives a carriage, floor by floor (lugre.md)."""

    needs = Needs(
        signals={
            "wheel_angle": "rad",
            "carriage_position": "m",
            "acceleration": "m/s^2",
            "motor_current": "A",
        },
        optional_signals={"carriage_held": "1"},
        constants=("mass", "wheel_radius", "guide_friction", "rolling_resistance", "gravity"),
        optional_constants=(
            "guide_friction_mass",  # that of the trials, if it is left out
            "guide_lift",  # 0 if left out, as much as the guide's friction at most
            *("torque_constant", "gear_ratio", "gear_efficiency"),
            *("no_load_torque", "no_load_viscous", "motor_inertia"),  # at the motor shaft
            # At the wheel; of its bearings the dry torque at `guide_friction_mass`.
            *("wheel_inertia", "bearing_torque"),
            "roller_transitions",  # per revolution of the wheel
        ),
        constant_units={**UNITS, "guide_friction_mass": "kg"},
        references=("V_s", "mu_c", "mu_s", "sigma_0", "sigma_1", "sigma_2"),
        trial_parameters=("current",),
    )
    options = (
        *("starts", "seed", "robust", "by_recording", "method", "law", "compare"),
        *("joint", "posterior"),
    )

    def evaluate(
        self, sweeps: Sequence[RecordedSweep], options: Options, notify: Callable[[str], None]
    ) -> Evaluation:
        """Return the LuGre parameters of each group of trials."""
        from rigd_analyses.lugre.evaluation import evaluate

        return evaluate(sweeps, options, notify)

    def validate(
        self,
        models: Sequence[SavedModel],
        sweeps: Sequence[RecordedSweep],
        group: str,
        notify: Callable[[str], None],
    ) -> Validation:
        """Return how ``sweeps`` agree with friction that was identified from others."""
        from rigd_analyses.lugre.validation.validate import validate

        return validate(models, sweeps, group, notify)

    def design(self, request: DesignRequest, notify: Callable[[str], None]) -> Designed:
        """Return tests of the rig for output error, chosen by the information that they give."""
        from rigd_analyses.lugre.design.design import design

        return design(request, notify)
