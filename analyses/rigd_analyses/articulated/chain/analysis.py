"""Declares the analysis of a chain of modules: its needs, and the function that evaluates."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from rigd.analysis import Analysis, Evaluation, Options
from rigd_analyses.articulated.chain.needs import NEEDS

if TYPE_CHECKING:
    from rigd.analysis.recordings.source import RecordedSweep
    from rigd.analysis.validation.result import Validation
    from rigd.analysis.validation.saved_models import SavedModel


class ChainAnalysis(Analysis):
    """Contacts of each module of a robot of 1 to 8, any of which drive, while they grip."""

    needs = NEEDS

    def evaluate(
        self, sweeps: Sequence[RecordedSweep], options: Options, notify: Callable[[str], None]
    ) -> Evaluation:
        """Return the contacts' parameters from all trials in which no contact slides."""
        from rigd_analyses.articulated.chain.evaluation import evaluate

        return evaluate(sweeps, options, notify)

    def validate(
        self,
        models: Sequence[SavedModel],
        sweeps: Sequence[RecordedSweep],
        group: str,
        notify: Callable[[str], None],
    ) -> Validation:
        """Return how recordings agree with the contacts of a model."""
        from rigd_analyses.articulated.chain.validation import validate

        return validate(models, sweeps, group, notify)
