"""What the analysis of the pendulum needs; every check of a procedure imports this."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from rigd.analysis import Analysis, Evaluation, Needs, Options

if TYPE_CHECKING:
    from rigd.analysis.recordings.source import RecordedSweep


class PendulumAnalysis(Analysis):
    """Coulomb and viscous friction of a pendulum that swings freely."""

    needs = Needs(
        signals={"angle": "rad", "held": "1"},
        constants=("inertia", "weight_moment"),
        constant_units={"inertia": "kg m^2", "weight_moment": "N m"},
        trial_parameters=("start",),
        references=("coulomb", "viscous"),
    )
    options = ("starts", "seed", "robust", "by_recording")

    def evaluate(
        self, sweeps: Sequence[RecordedSweep], options: Options, notify: Callable[[str], None]
    ) -> Evaluation:
        """Return the friction of each group of trials."""
        from rigd_pendulum.evaluation import evaluate

        return evaluate(sweeps, options, notify)
