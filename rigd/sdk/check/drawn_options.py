"""Draws the options of a driver at random, from the ranges that its Config declares.

What the author gives to the suite and what the peer gives (its address) stays as it is. Of the
others those are drawn that have a default and a range of values: quantities, choices, true or
false. Numbers without a unit are addresses and counts, which the simulated device must share.
"""

from __future__ import annotations

import math
import random
from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from enum import Enum
from typing import TYPE_CHECKING, Any, Final, Literal, get_args, get_origin

from pydantic.fields import FieldInfo

from rigd.model.units import format_quantity
from rigd.sdk.driver import DriverConfig
from rigd.sdk.options.quantities import In

if TYPE_CHECKING:
    from rigd.sdk.check.subject import Subject

#: A quantity is drawn between its default over this and its default times this, in its range.
SPREAD: Final = 8.0
#: Share of the options that are drawn; the others keep their defaults.
SHARE: Final = 0.7
#: Times between readings that are tried, in s, and for how long; the device may be read so many
#: times more often, and so many times more seldom, as its answer takes a while and this machine may
#: stall.
PERIODS_S: Final = (0.025, 0.3)
COUNTED_S: Final = 0.6
INTERVALS: Final = 6
OFTEN_PART: Final = 1.2
SELDOM_PART: Final = 0.4


def drawn_options(
    config_class: type[DriverConfig],
    fixed: Collection[str],
    rng: random.Random,
    end: int | None = None,
) -> Mapping[str, Any]:
    """Return options at random as a rig file gives them, without those of ``fixed``.

    With ``end`` all quantities are at the low (0) or high (-1) ends of their ranges.
    """
    return {
        name: value
        for name, value in _values(config_class, rng, end)
        if name not in fixed and (end is not None or rng.random() < SHARE)
    }


def intervals(subject: Subject) -> Iterator[tuple[Subject, float]]:
    """Yield the driver with a long and a short time between readings, and that time in s.

    The device is that of the author: others of its make may answer more slowly.
    The option is called `period` or `interval`, has a unit of time, and is not given by the author.
    """
    given = () if isinstance(subject.options, DriverConfig) else subject.options
    for name in {"period", "interval"} & subject.driver_class.Config.model_fields.keys() - {*given}:
        for value_s in PERIODS_S:
            other = replace(subject, more={name: f"{value_s:g} s"}, varies=False)
            with suppress(ValueError):  # it is beyond its bounds, or no time
                other.declare()
                yield other, value_s


def counted_s(apart_s: float) -> float:
    """Return for how long readings are counted that are to be ``apart_s`` apart."""
    return max(COUNTED_S, INTERVALS * apart_s)


def too_often(count: int, for_s: float, apart_s: float) -> Iterator[str]:
    """Yield that a driver that is to read every ``apart_s`` reads more often, or too seldom."""
    times = for_s / apart_s
    if not SELDOM_PART * times - 1 <= count <= OFTEN_PART * times + 2:
        yield f"it reads {count} times in {for_s:.2g} s, and is to read every {apart_s:g} s"


def _values(
    config_class: type[DriverConfig], rng: random.Random, end: int | None
) -> Iterator[tuple[str, Any]]:
    for key, field in config_class.model_fields.items():
        if not field.is_required():
            for value in _value(field, rng, end):
                yield field.alias or key, value


def _value(field: FieldInfo, rng: random.Random, end: int | None) -> Iterator[Any]:
    """Yield a value of a field; nothing, if it has no range."""
    kind, default = field.annotation, field.get_default(call_default_factory=True)
    if get_origin(kind) is Literal:
        yield rng.choice(get_args(kind))
    elif kind is bool:
        yield rng.random() < 0.5
    elif isinstance(kind, type) and issubclass(kind, Enum):
        yield rng.choice(list(kind)).value
    elif kind is float and isinstance(default, float) and default and math.isfinite(default):
        for item in field.metadata:
            if isinstance(item, In):
                yield format_quantity(_number(field, default, rng, end), item.unit, 4)


def _number(field: FieldInfo, default: float, rng: random.Random, end: int | None) -> float:
    """Return a number of the sign of its default: within its bounds, or at that ``end``."""
    low, high = sorted((default / SPREAD, default * SPREAD))
    inside = 1e-3 * abs(default)
    for item in field.metadata:
        low = max(low, getattr(item, "ge", low), getattr(item, "gt", -math.inf) + inside)
        high = min(high, getattr(item, "le", high), getattr(item, "lt", math.inf) - inside)
    if end is not None:
        return (low, high)[end]
    if low * high <= 0:
        return rng.uniform(low, high)
    between = math.log(abs(low)) + rng.random() * math.log(high / low)
    return math.copysign(math.exp(between), default)
