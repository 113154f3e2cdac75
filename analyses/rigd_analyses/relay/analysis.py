"""Declares the analysis of a relay to rigd: its signals may have any unit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from rigd.analysis import ANY_UNIT, Analysis, Evaluation, Needs, Options

if TYPE_CHECKING:
    from rigd.analysis.recordings.source import RecordedSweep


class RelayAnalysis(Analysis):
    """Gains of a controller, from the swing that a relay in its place makes."""

    needs = Needs(signals={"measured": ANY_UNIT, "output": ANY_UNIT, "relay": ANY_UNIT})

    def evaluate(
        self, sweeps: Sequence[RecordedSweep], options: Options, notify: Callable[[str], None]
    ) -> Evaluation:
        """Return the gains that the recording of a relay gives, or why it gives none."""
        from rigd.analysis.calibration.evaluation import evaluated
        from rigd.analysis.calibration.reading import steps_of
        from rigd_analyses.relay.gains import gains_of

        steps = steps_of(sweeps, None)
        return evaluated(steps, gains_of(steps.sweep))
