"""Declares the analysis of lateral sweeps: its needs, and the function that evaluates them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from rigd.analysis import Analysis, Evaluation, Needs, Options
from rigd_analyses.lugre.analysis import LugreAnalysis

if TYPE_CHECKING:
    from rigd.analysis.source import RecordedSweep

DRIVE = (
    *("torque_constant", "gear_ratio", "gear_efficiency", "no_load_torque", "no_load_viscous"),
    *("motor_inertia", "wheel_inertia", "bearing_torque", "roller_transitions"),
)
GEOMETRY = (
    *("guide_lever", "guide_height", "guide_half_span", "row_distance", "mass_offset"),
    *("bearing_spacing", "bearing_overhang"),
)
ROLLERS = ("mu_R_dry", "mu_R_vis")


class LateralAnalysis(Analysis):
    """Friction of an omni-wheel's passive rollers, from drives during lateral motion (lugre.md)."""

    needs = Needs(
        signals={**LugreAnalysis.needs.signals, "lateral_speed": "m/s"},
        optional_signals=LugreAnalysis.needs.optional_signals,
        constants=(*LugreAnalysis.needs.constants, *DRIVE, *GEOMETRY),
        optional_constants=("guide_friction_mass", "guide_lift", *ROLLERS),
        constant_units={
            **LugreAnalysis.needs.constant_units,
            **dict.fromkeys(GEOMETRY, "m"),
            **{"mu_R_dry": "1", "mu_R_vis": "s/m"},
        },
        trial_parameters=("current", "lateral_speed"),
    )
    options = ("by_recording", "model")

    def evaluate(
        self, sweeps: Sequence[RecordedSweep], options: Options, notify: Callable[[str], None]
    ) -> Evaluation:
        """Return the rollers' friction of each group of trials."""
        from rigd_analyses.lugre.lateral.evaluation import evaluate

        return evaluate(sweeps, options, notify)
