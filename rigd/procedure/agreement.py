"""What channels must show after a prompt was answered, as a program for the cycle."""

from __future__ import annotations

from collections.abc import Mapping

from rigd.model.units import format_quantity
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
from rigd.procedure.standing import describe_standing, describe_until


def check_of(prompt: Prompt, answer: Answer) -> CycleProgram | None:
    """Return the program that ends once ``answer`` is borne out, or None where nothing is checked.

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


def objection_to(prompt: Prompt, answer: Answer, stood: Mapping[str, float]) -> str:
    """Return what speaks against ``answer`` where its check ran out of time.

    ``stood`` is where the channels of the check stood then.
    """
    check = check_of(prompt, answer)
    if check is None:
        raise ValueError(f"nothing speaks against an answer to {prompt.name!r}: it has no check")
    where, said, expected = describe_standing(check.segments[0].until, stood), "", []
    if prompt.agrees is not None:
        number = float(answer)
        said = f"the answer was {format_quantity(number, prompt.unit)}, but "
        low, high = (format_quantity(item, prompt.unit) for item in band(prompt.agrees, number))
        expected.append(f"{low} to {high}")
    if prompt.until:
        expected.append(describe_until(prompt.until))
    return (
        f"prompt {prompt.name!r}: {said}{where} "
        f"(looked at for {prompt.timeout_s:g} s, expected {' and '.join(expected)})"
    )


def band(agrees: Agreement, answer: float) -> tuple[float, float]:
    """Return the lowest and the highest value that agree with ``answer``, in SI."""
    within = agrees.within * abs(answer) if agrees.is_share else agrees.within
    return answer - within, answer + within


def inside(agrees: Agreement, answer: float, unit: str) -> tuple[Condition, ...]:
    """Return what says that the channel shows ``answer``; ``unit`` is the one people read."""
    low, high = band(agrees, answer)
    return (
        Condition(agrees.channel, Comparison.ABOVE, low, for_s=agrees.for_s, unit=unit),
        Condition(agrees.channel, Comparison.BELOW, high, for_s=agrees.for_s, unit=unit),
    )
