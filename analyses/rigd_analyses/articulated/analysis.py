"""Declares the analysis of the articulated robot: its needs, and the function that evaluates."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from rigd.analysis import Analysis, Evaluation, Options
from rigd_analyses.articulated.needs import NEEDS

if TYPE_CHECKING:
    from rigd.analysis.recordings.source import RecordedSweep
    from rigd.analysis.validation.result import Validation
    from rigd.analysis.validation.saved_models import SavedModel


class ArticulatedAnalysis(Analysis):
    """Contacts of a two-module robot with slipping wheels, from motors and a camera."""

    needs = NEEDS

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
