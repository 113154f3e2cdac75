"""Describes conditions and the values of their channels as text, for messages."""

from __future__ import annotations

import math
from collections.abc import Mapping

from rigd.model.units import format_quantity
from rigd.procedure.program import Condition, StatusCondition, TrialLimit, Until, Window


def describe_condition(condition: Condition | StatusCondition, threshold: str | None = None) -> str:
    """Return ``condition`` as procedures write it, such as ``|belt.speed| < 0.003 m/s for 0.2 s``.

    ``threshold`` replaces its own threshold if several conditions are described together.
    """
    held = f" for {condition.for_s:g} s" if condition.for_s else ""
    if isinstance(condition, StatusCondition):
        return f"{condition.device} {'is' if condition.wanted else 'is not'} {condition.word}{held}"
    channel = f"|{condition.channel}|" if condition.magnitude else condition.channel
    bound = threshold or format_quantity(condition.threshold, condition.unit)
    return f"{channel} {condition.comparison.value} {bound}{held}"


def describe_until(until: Until) -> str:
    """Return the end condition of a segment, as procedures write it."""
    return ", or ".join(" and ".join(map(describe_condition, row)) for row in until)


def describe_values(until: Until, values: Mapping[str, float]) -> str:
    """Return the values of the channels of ``until``: ``scale.mass is 4.02 kg, scale is stable``.

    ``values`` has the values by channel, NaN if there was no value.
    """
    return ", ".join(
        dict.fromkeys(_describe_value(item, values[item.channel]) for row in until for item in row)
    )


def describe_window(window: Window) -> str:
    """Return a part of a trial in words: ``the last 2 s of step 'pull'``."""
    text = "the steps" if window.step is None else f"step {window.step!r}"
    if window.last_s is not None:
        text = f"the last {window.last_s:g} s of {text}"
    elif window.end_s != math.inf:
        text = f"{window.begin_s:g} s to {window.end_s:g} s of {text}"
    if window.since:
        count = "" if window.nth == 1 else f" begins for time {window.nth}"
        text += f" from {describe_until(window.since)}{count}"
    if window.until:
        text += f" to {describe_until(window.until)}"
    if window.holds:
        text += f" while {describe_until(window.holds)}"
    return text


def describe_left(limit: TrialLimit, value: float) -> str:
    """Return how ``value`` of its channel is outside of ``limit``."""
    if value != value:
        return f"{limit.channel} has no value, and the trial has a limit of it"
    side, bound = ("below", limit.low) if value < limit.low else ("above", limit.high)
    return (
        f"{limit.channel} is {format_quantity(value, limit.unit)}, {side} the trial's limit of "
        f"{format_quantity(bound, limit.unit)}"
    )


def _describe_value(condition: Condition | StatusCondition, value: float) -> str:
    if isinstance(condition, Condition):
        return f"{condition.channel} is {format_quantity(value, condition.unit)}"
    if value != value:
        return f"{condition.device} gave no status"
    is_so = "is" if int(value) & condition.mask else "is not"
    return f"{condition.device} {is_so} {condition.word}"
