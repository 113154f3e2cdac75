"""Builds the check that the channels of the rig agree with the operator's answer to a prompt.

The check is a program that the control cycle plays; the setpoints stay at rest.
"""

from __future__ import annotations

from collections.abc import Mapping

from rigd.model.units import format_quantity
from rigd.procedure.conditions.condition_text import describe_until, describe_values
from rigd.procedure.program import (
    Agreement,
    Answer,
    Comparison,
    Condition,
    CycleProgram,
    Prompt,
    Segment,
    StatusCondition,
)


def check_of(prompt: Prompt, answer: Answer) -> CycleProgram | None:
    """Return the program that ends when channels agree with ``answer``; None without a check.

    It commands nothing: the setpoints stay at rest.
    """
    if not prompt.until and prompt.agrees is None:
        return None
    shown: tuple[Condition | StatusCondition, ...] = ()
    if prompt.agrees is not None:
        shown = inside(prompt.agrees, float(answer), prompt.unit)
        shown += () if prompt.agrees.stable is None else (prompt.agrees.stable,)
    until = tuple((*row, *shown) for row in prompt.until or ((),))
    return CycleProgram((Segment(prompt.name, until=until, timeout_s=prompt.timeout_s),))


def objection_to(prompt: Prompt, answer: Answer, values: Mapping[str, float]) -> str:
    """Return the reason against ``answer`` if its check ran out of time.

    ``values`` are the last values of the channels of the check.
    """
    check = check_of(prompt, answer)
    if check is None:
        raise ValueError(f"the answer to {prompt.name!r} has no check")
    found, answered, expected = describe_values(check.segments[0].until, values), "", []
    if prompt.agrees is not None:
        number = float(answer)
        answered = f"the answer was {format_quantity(number, prompt.unit)}, but "
        low, high = (format_quantity(item, prompt.unit) for item in band(prompt.agrees, number))
        expected.append(f"{low} to {high}")
    if prompt.until:
        expected.append(describe_until(prompt.until))
    return (
        f"prompt {prompt.name!r}: {answered}{found} (checked for {prompt.timeout_s:g} s, expected "
        f"{' and '.join(expected)})"
    )


def band(agrees: Agreement, answer: float) -> tuple[float, float]:
    """Return the lowest and the highest value that agree with ``answer``, in SI."""
    within = agrees.within * abs(answer) if agrees.is_share else agrees.within
    return answer - within, answer + within


def inside(agrees: Agreement, answer: float, unit: str) -> tuple[Condition, ...]:
    """Return the conditions for agreement with ``answer``; ``unit`` is the displayed unit."""
    low, high = band(agrees, answer)
    return (
        Condition(agrees.channel, Comparison.ABOVE, low, for_s=agrees.for_s, unit=unit),
        Condition(agrees.channel, Comparison.BELOW, high, for_s=agrees.for_s, unit=unit),
    )
