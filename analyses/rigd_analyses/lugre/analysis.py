"""The LuGre analysis as rigd finds it: what it needs, and the way to its numerics."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from rigd.analysis import Analysis, Evaluation, Needs, Options

if TYPE_CHECKING:
    from rigd.analysis.source import RecordedSweep


class LugreAnalysis(Analysis):
    """LuGre friction of an omni-wheel that drives a carriage, floor by floor (lugre.md)."""

    needs = Needs(
        signals={
            "wheel_angle": "rad",
            "carriage_position": "m",
            "acceleration": "m/s^2",
            "motor_current": "A",
        },
        constants=("mass", "wheel_radius", "guide_friction", "rolling_resistance", "gravity"),
        optional_constants=("guide_friction_mass",),
        references=("V_s", "mu_c", "mu_s", "sigma_0", "sigma_1", "sigma_2"),
        trial_parameters=("current",),
    )
    options = ("starts", "seed", "robust", "by_recording")

    def evaluate(
        self, sweeps: Sequence[RecordedSweep], options: Options, tell: Callable[[str], None]
    ) -> Evaluation:
        """Return the LuGre parameters of each group of trials."""
        from rigd_analyses.lugre.evaluation import evaluate

        return evaluate(sweeps, options, tell)
