"""Declares the approach-angle analysis to rigd: what the analysis needs, and how rigd calls it.

The analysis computes the friction coefficients of an omni-wheel whose rolling direction is at an
angle (the approach angle) to the direction of movement. The class names the recorded signals, the
constants, the published values (the maximum of the friction coefficient), the parameters of a trial
(one recorded movement) and the calibrated values of the rig that the analysis uses. All recordings
that rigd passes to ``evaluate`` are one campaign: they are evaluated together.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from rigd.analysis import Analysis, Evaluation, Options
from rigd_analyses.approach_angle.needs import NEEDS
from rigd_analyses.approach_angle.values import CALIBRATABLE

if TYPE_CHECKING:
    from rigd.analysis.recordings.source import RecordedSweep, TrialInfo
    from rigd.analysis.validation.result import Validation
    from rigd.analysis.validation.saved_models import SavedModel


class ApproachAngleAnalysis(Analysis):
    """Friction of a wheel over its approach angle: the paper's method and a corrected one.

    All recordings are one campaign.
    """

    needs = NEEDS
    calibratable = CALIBRATABLE
    options = ("calibration",)

    def check_trial(self, sweep: RecordedSweep, trial: TrialInfo) -> Sequence[str]:
        """Return the reasons of the flags that leave a run out, by itself."""
        from rigd_analyses.approach_angle.trial_check import check_trial

        return check_trial(sweep, trial)

    def evaluate(
        self, sweeps: Sequence[RecordedSweep], options: Options, notify: Callable[[str], None]
    ) -> Evaluation:
        """Return the result of the recordings of one campaign."""
        from rigd_analyses.approach_angle.evaluation import evaluate

        return evaluate(sweeps, options, notify)

    def validate(
        self,
        models: Sequence[SavedModel],
        sweeps: Sequence[RecordedSweep],
        group: str,
        notify: Callable[[str], None],
    ) -> Validation:
        """Return how a campaign agrees with the friction of another one."""
        from rigd_analyses.approach_angle.validation import validate

        return validate(models, sweeps, group, notify)
