"""Declares the LuGre analysis to rigd: its needs, and the function that evaluates recordings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from rigd.analysis import Analysis, Evaluation, Options
from rigd_analyses.lugre.needs import NEEDS

if TYPE_CHECKING:
    from rigd.analysis.design.command import Designed, DesignRequest
    from rigd.analysis.recordings.source import RecordedSweep
    from rigd.analysis.validation.result import Validation
    from rigd.analysis.validation.saved_models import SavedModel


class LugreAnalysis(Analysis):
    """LuGre friction of an omni-wheel that drives a carriage, floor by floor (lugre.md)."""

    needs = NEEDS
    options = (
        *("starts", "seed", "robust", "by_recording", "method", "law", "compare"),
        "joint",
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
