"""Finds measures of a procedure that the trials of a dry run cannot give."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from rigd.procedure.conditions.condition_text import describe_until
from rigd.procedure.measures import events_of
from rigd.procedure.program import Comparison, CompiledProcedure, Condition, CycleProgram


def missing_measures(
    procedure: CompiledProcedure, peaks: Mapping[str, tuple[float, float]]
) -> Iterator[str]:
    """Yield a sentence for each measure that gives no number: why.

    ``peaks`` has the lowest and the highest value of each channel, in SI; a channel that is not in
    it may have any value.
    """
    steps = [step for trial in procedure.trials for step in trial.steps]
    played = {
        segment.name
        for step in steps
        if isinstance(step, CycleProgram)
        for segment in step.segments
    }
    for measure in procedure.measures:
        step = measure.window.step
        if step is not None and step not in played:
            yield f"measure {measure.name}: step {step!r} plays in no trial"
            continue
        for event in events_of(measure):
            if not any(all(_may_hold(item, peaks) for item in row) for row in event):
                yield (
                    f"measure {measure.name}: {describe_until(event)} never holds, so trial "
                    f"{procedure.trials[0].number} gives no number"
                )
                break


def _may_hold(condition: Condition, peaks: Mapping[str, tuple[float, float]]) -> bool:
    """Return whether the condition holds somewhere between the peaks of its channel."""
    if condition.channel not in peaks:
        return True
    low, high = peaks[condition.channel]
    if condition.magnitude:
        low, high = max(low, -high, 0.0), max(-low, high)
    if condition.comparison is Comparison.ABOVE:
        return high > condition.threshold
    return low < condition.threshold
