"""Describes conditions and the values of their channels in words."""

from __future__ import annotations

from collections.abc import Mapping

from rigd.model.units import format_quantity
from rigd.procedure.program import Condition, StatusCondition, Until


def describe_condition(condition: Condition | StatusCondition, threshold: str | None = None) -> str:
    """Return ``condition`` as procedures write it, such as ``|belt.speed| < 0.003 m/s for 0.2 s``.

    ``threshold`` replaces its own, where several conditions are told as one.
    """
    held = f" for {condition.for_s:g} s" if condition.for_s else ""
    if isinstance(condition, StatusCondition):
        return f"{condition.device} {'is' if condition.wanted else 'is not'} {condition.word}{held}"
    channel = f"|{condition.channel}|" if condition.magnitude else condition.channel
    bound = threshold or format_quantity(condition.threshold, condition.unit)
    return f"{channel} {condition.comparison.value} {bound}{held}"


def describe_until(until: Until) -> str:
    """Return what ends a segment, as procedures write it."""
    return ", or ".join(" and ".join(map(describe_condition, row)) for row in until)


def describe_standing(until: Until, stood: Mapping[str, float]) -> str:
    """Return where the channels of ``until`` stood: ``scale.mass is 4.02 kg, scale is stable``.

    ``stood`` holds the values by channel, NaN where there was none.
    """
    return ", ".join(
        dict.fromkeys(_told(item, stood[item.channel]) for row in until for item in row)
    )


def _told(condition: Condition | StatusCondition, value: float) -> str:
    if isinstance(condition, Condition):
        return f"{condition.channel} is {format_quantity(value, condition.unit)}"
    if value != value:
        return f"{condition.device} gave no status"
    is_so = "is" if int(value) & condition.mask else "is not"
    return f"{condition.device} {is_so} {condition.word}"
