"""Declares the analysis of lateral sweeps: its needs, and the function that evaluates them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from rigd.analysis import Analysis, Evaluation, Options
from rigd_analyses.lugre.lateral.needs import NEEDS

if TYPE_CHECKING:
    from rigd.analysis.recordings.source import RecordedSweep


class LateralAnalysis(Analysis):
    """Friction of an omni-wheel's passive rollers, from drives during lateral motion (lugre.md)."""

    needs = NEEDS
    options = ("by_recording", "model")

    def evaluate(
        self, sweeps: Sequence[RecordedSweep], options: Options, notify: Callable[[str], None]
    ) -> Evaluation:
        """Return the rollers' friction of each group of trials."""
        from rigd_analyses.lugre.lateral.evaluation import evaluate

        return evaluate(sweeps, options, notify)
