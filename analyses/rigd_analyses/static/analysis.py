"""Declares the analysis of a static friction law to rigd."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from rigd.analysis import Analysis, Evaluation, Options
from rigd_analyses.static.needs import NEEDS

if TYPE_CHECKING:
    from rigd.analysis.recordings.source import RecordedSweep


class StaticFrictionAnalysis(Analysis):
    """A static friction law, force over speed: Coulomb, Stribeck and viscous friction.

    Also torque over angular speed, or a coefficient of friction over either; units follow.
    """

    needs = NEEDS
    options = ("starts", "seed", "robust", "by_recording")

    def evaluate(
        self, sweeps: Sequence[RecordedSweep], options: Options, notify: Callable[[str], None]
    ) -> Evaluation:
        """Return the parameters of the law for each group of trials."""
        from rigd_analyses.static.evaluation import evaluate

        return evaluate(sweeps, options, notify)
