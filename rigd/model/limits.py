"""Defines the limits of setpoints, and the interlocks (conditions on channels), as plain data."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum, auto
from typing import Final

from rigd.model.severity import Severity

#: Rounding brings a computed value beyond a bound by less than this share of the larger bound.
_ROUNDING: Final = 1e-9


def rounded_to(low: float, value: float, high: float) -> float:
    """Return ``value``, or the bound beyond which it lies by no more than rounding makes."""
    inside = min(max(value, low), high)
    size = max(abs(low) if math.isfinite(low) else 0.0, abs(high) if math.isfinite(high) else 0.0)
    return inside if abs(value - inside) <= _ROUNDING * size else value


@dataclass(frozen=True)
class SetpointLimit:
    """Bounds of one setpoint, in its unit; ``rate`` is per second.

    ``rest`` is the value to which a stop takes the setpoint (within ``rate``): 0 A for a motor, 1
    for a clutch that holds when engaged. With ``holds`` it is only the value at the begin: a stop,
    a pause and a prompt keep the value that is reached, as of an oven.
    """

    low: float
    high: float
    rate: float = math.inf
    rest: float = 0.0
    holds: bool = False


class Priority(IntEnum):
    """How urgently a person must look at the rig (IEC 62682, 4 classes)."""

    LOW = auto()
    MEDIUM = auto()
    HIGH = auto()
    CRITICAL = auto()


@dataclass(frozen=True)
class Interlock:
    """A condition on a channel, checked every cycle.

    Trips when ``source`` leaves [``low``, ``high``] for ``delay_s``, is NaN, or is older than
    ``stale_after_s`` (the last two at once). ``low`` and ``high`` are constants in the channel's
    unit or names of other channels. With ``follows`` they are ``band`` around that setpoint as it
    was last written, as long as the setpoint ``only_while``, if there is one, is above one half. It
    clears once the value is ``deadband`` inside again; with ``latch`` only after a person
    acknowledged it.
    """

    name: str
    source: str
    low: float | str | None = None
    high: float | str | None = None
    follows: str | None = None
    band: float = 0.0
    only_while: str | None = None
    delay_s: float = 0.0
    deadband: float = 0.0
    stale_after_s: float = 0.05
    latch: bool = False
    priority: Priority = Priority.MEDIUM
    action: Severity = Severity.STOP  #: from WARN to ESTOP
    message: str = ""
