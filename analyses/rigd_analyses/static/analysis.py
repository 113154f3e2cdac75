"""Declares the analysis of a static friction law to rigd."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from rigd.analysis import Analysis, Evaluation, Needs, Options

if TYPE_CHECKING:
    from rigd.analysis.recordings.source import RecordedSweep


class StaticFrictionAnalysis(Analysis):
    """A static friction law, force over speed: Coulomb, Stribeck and viscous friction."""

    needs = Needs(
        signals={"force": "N", "speed": "m/s"},
        references=("F_c", "F_s", "v_s", "k_v"),
    )
    options = ("starts", "seed", "robust", "by_recording")

    def evaluate(
        self, sweeps: Sequence[RecordedSweep], options: Options, notify: Callable[[str], None]
    ) -> Evaluation:
        """Return the parameters of the law for each group of trials."""
        from rigd_analyses.static.evaluation import evaluate

        return evaluate(sweeps, options, notify)
