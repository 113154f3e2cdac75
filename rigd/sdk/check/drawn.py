"""Draws the options of a driver at random, from the ranges that its Config declares.

What the author gives to the suite and what the peer gives (its address) stays as it is. Of the
others those are drawn that have a default and a range of values: quantities, choices, true or
false. Numbers without a unit are addresses and counts, which the simulated device must share.
"""

from __future__ import annotations

import math
import random
from collections.abc import Collection, Iterator, Mapping
from enum import Enum
from typing import Any, Final, Literal, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt
from pydantic.fields import FieldInfo

from rigd.model.units import format_quantity
from rigd.sdk.driver import DriverConfig
from rigd.sdk.quantities import In

#: A quantity is drawn between its default over this and its default times this, in its range.
SPREAD: Final = 8.0
#: Share of the options that are drawn; the others keep their defaults.
SHARE: Final = 0.7


def drawn_options(
    config_class: type[DriverConfig], fixed: Collection[str], rng: random.Random
) -> Mapping[str, Any]:
    """Return options at random as a rig file gives them, without those of ``fixed``."""
    return {
        name: value
        for name, value in _values(config_class, rng)
        if name not in fixed and rng.random() < SHARE
    }


def _values(config_class: type[DriverConfig], rng: random.Random) -> Iterator[tuple[str, Any]]:
    for key, field in config_class.model_fields.items():
        if not field.is_required():
            for value in _value(field, rng):
                yield field.alias or key, value


def _value(field: FieldInfo, rng: random.Random) -> Iterator[Any]:
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
                yield format_quantity(_number(field, default, rng), item.unit, 4)


def _number(field: FieldInfo, default: float, rng: random.Random) -> float:
    """Return a number of the sign of its default: within its bounds, or at one of them."""
    ends = sorted((default / SPREAD, default * SPREAD))
    low, high = ends
    for item in field.metadata:
        match item:
            case Ge(ge=bound):
                low = max(low, float(bound))  # type: ignore[arg-type]
            case Gt(gt=bound):
                low = max(low, float(bound) + 1e-3 * abs(default))  # type: ignore[arg-type]
            case Le(le=bound):
                high = min(high, float(bound))  # type: ignore[arg-type]
            case Lt(lt=bound):
                high = min(high, float(bound) - 1e-3 * abs(default))  # type: ignore[arg-type]
    if low * high <= 0:
        return rng.uniform(low, high)
    between = math.log(abs(low)) + rng.random() * math.log(high / low)
    return math.copysign(math.exp(between), default)
