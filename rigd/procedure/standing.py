"""Where channels stood, in words: what a condition that was not met waited for."""

from __future__ import annotations

from collections.abc import Mapping

from rigd.model.units import format_quantity
from rigd.procedure.program import Condition, StatusCondition, Until


def describe_standing(until: Until, stood: Mapping[str, float]) -> str:
    """Return where the channels of ``until`` stood: ``scale.mass is 4.02 kg, scale is stable``.

    ``stood`` holds the values by channel, NaN where there was none.
    """
    return ", ".join(dict.fromkeys(_told(one, stood[one.channel]) for row in until for one in row))


def _told(condition: Condition | StatusCondition, value: float) -> str:
    if isinstance(condition, Condition):
        return f"{condition.channel} is {format_quantity(value, condition.unit)}"
    if value != value:
        return f"{condition.device} gave no status"
    is_so = "is" if int(value) & condition.mask else "is not"
    return f"{condition.device} {is_so} {condition.word}"
