"""Finds measures of a procedure that the trials of a dry run cannot give."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from rigd.procedure.conditions.condition_text import describe_until
from rigd.procedure.program import Comparison, CompiledProcedure, Condition, CycleProgram


def unmeasured(
    procedure: CompiledProcedure, peaks: Mapping[str, tuple[float, float]]
) -> Iterator[str]:
    """Yield why no number of a measure comes, one sentence each.

    ``peaks`` are the lowest and highest value of each channel, those without any left out.
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
        for event in (measure.since, measure.when):
            if event and not any(all(_may_hold(item, peaks) for item in row) for row in event):
                yield (
                    f"measure {measure.name}: {describe_until(event)} never holds, so trial "
                    f"{procedure.trials[0].number} gives no number"
                )
                break


def _may_hold(condition: Condition, peaks: Mapping[str, tuple[float, float]]) -> bool:
    if condition.channel not in peaks:
        return True
    low, high = peaks[condition.channel]
    if condition.magnitude:
        low, high = max(low, -high, 0.0), max(-low, high)
    if condition.comparison is Comparison.ABOVE:
        return high > condition.threshold
    return low < condition.threshold
