"""Checks the interlocks of a rig, which are conditions on channels, in every cycle."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from rigd.model.limits import Interlock
from rigd.model.severity import Severity
from rigd.model.units import Quantity, parse_unit

#: A period of the mains (50 Hz; that of 60 Hz is shorter).
_MAINS_NS: Final = 20_000_000


@dataclass(frozen=True)
class Trip:
    """A trip of an interlock: its time, and its reason as text for the operator.

    ``message`` is the interlock's own text, or "" if it describes bounds but the value is unknown.
    """

    t_ns: int
    interlock: Interlock
    value: float
    reason: str
    message: str


@dataclass(frozen=True)
class _Rule:
    """An interlock bound to its places in the values table."""

    interlock: Interlock
    source: int
    stamp: int  # the place of its time
    unit: str
    low: float
    high: float
    low_from: int  # index of the channel that is the bound, or -1
    high_from: int
    follows: int  # index of the setpoint, or -1
    only_while: int  # index of the setpoint, or -1
    bound_stamps: tuple[int, ...]  # of the channels that are a bound
    delay_ns: int
    stale_ns: int


class InterlockBank:
    """Checks all interlocks of a rig and keeps the state of each.

    ``readings`` maps channel names to indices of the values table, ``units`` has their units,
    ``stamp_of`` the place of their times, ``setpoints`` the index of each setpoint.

    Raises:
        KeyError: an interlock names an unknown channel.
    """

    def __init__(
        self,
        interlocks: Sequence[Interlock],
        readings: Mapping[str, int],
        units: Mapping[str, str],
        stamp_of: Sequence[int],
        setpoints: Mapping[str, int] = MappingProxyType({}),
    ) -> None:
        self._rules = [
            _bind(interlock, readings, units, stamp_of, setpoints) for interlock in interlocks
        ]
        self._since: list[int | None] = [None] * len(interlocks)  # start of the violation
        self._inside: list[int | None] = [None] * len(interlocks)  # start of the return, if any
        self._tripped = [False] * len(interlocks)
        #: Of the last violation: value, bounds, age of the value and of the oldest of them.
        self._found = [(math.nan, math.nan, math.nan, 0, 0)] * len(interlocks)

    def check(
        self,
        t_ns: int,
        values: Sequence[float],
        stamps: Sequence[int],
        setpoints: Sequence[float] = (),
    ) -> list[Trip]:
        """Return the interlocks that trip in this cycle.

        ``stamps`` has the times of the values, in ns. A channel that is a bound must be
        as fresh as the channel that it bounds. ``setpoints`` are those written last.
        """
        trips: list[Trip] = []
        for index, rule in enumerate(self._rules):
            value = values[rule.source]
            low = rule.low if rule.low_from < 0 else values[rule.low_from]
            high = rule.high if rule.high_from < 0 else values[rule.high_from]
            if rule.follows >= 0 and (rule.only_while < 0 or setpoints[rule.only_while] > 0.5):
                band = rule.interlock.band
                low, high = setpoints[rule.follows] - band, setpoints[rule.follows] + band
            own_age_ns = age_ns = t_ns - stamps[rule.stamp]
            for bound in rule.bound_stamps:
                age_ns = max(age_ns, t_ns - stamps[bound])
            # NaN fails every comparison, as value and as bound, and so counts as a violation.
            if low <= value <= high and age_ns <= rule.stale_ns:
                if self._since[index] is not None and self._has_returned(index, t_ns):
                    self._recover(index, value, low, high)
                continue
            self._inside[index] = None
            self._found[index] = (value, low, high, own_age_ns, age_ns)
            since = self._since[index]
            if since is None:
                since = self._since[index] = t_ns
            # Data that cannot be trusted trip without delay.
            untrusted = age_ns > rule.stale_ns or math.isnan(value + low - high)
            if not self._tripped[index] and (untrusted or t_ns - since >= rule.delay_ns):
                self._tripped[index] = True
                reason = _reason(rule, value, low, high, own_age_ns, age_ns)
                given = (rule.interlock.low, rule.interlock.high, rule.interlock.follows)
                of_bounds = given != (None, None, None)
                message = "" if untrusted and of_bounds else rule.interlock.message
                trips.append(Trip(t_ns, rule.interlock, value, reason, message))
        return trips

    def _has_returned(self, index: int, t_ns: int) -> bool:
        """Return whether the value is back within its bounds, and does not only pass them.

        An open input picks up the mains, and passes the band around a setpoint twice per period.
        """
        if self._rules[index].follows < 0:
            return True
        began = self._inside[index]
        if began is None:
            began = self._inside[index] = t_ns
        return t_ns - began >= _MAINS_NS

    def _recover(self, index: int, value: float, low: float, high: float) -> None:
        """Clear a violation once the value is a deadband inside its bounds, unless latched."""
        interlock = self._rules[index].interlock
        inside = low + interlock.deadband <= value <= high - interlock.deadband
        if not self._tripped[index]:
            self._since[index] = None
        elif inside and not interlock.latch:
            self._tripped[index] = False
            self._since[index] = None

    def active(self, least: Severity = Severity.WARN) -> list[Interlock]:
        """Return the interlocks that are tripped, of at least this severity."""
        return [
            rule.interlock
            for rule, tripped in zip(self._rules, self._tripped, strict=True)
            if tripped and rule.interlock.action >= least
        ]

    def violated(self, least: Severity) -> list[tuple[Interlock, str]]:
        """Return the interlocks whose condition held at the last check, each with its reason.

        Also those whose delay has not passed.
        """
        return [
            (rule.interlock, _reason(rule, *found))
            for rule, since, found in zip(self._rules, self._since, self._found, strict=True)
            if since is not None and rule.interlock.action >= least
        ]

    def acknowledge(self, name: str) -> None:
        """Permit a latched interlock to clear; it trips again at once if its condition still holds.

        Raises:
            KeyError: unknown interlock.
        """
        for index, rule in enumerate(self._rules):
            if rule.interlock.name == name:
                self._tripped[index] = False
                self._since[index] = None
                return
        raise KeyError(name)


def _bind(
    interlock: Interlock,
    readings: Mapping[str, int],
    units: Mapping[str, str],
    stamp_of: Sequence[int],
    setpoints: Mapping[str, int],
) -> _Rule:
    source = readings[interlock.source]
    low, high = interlock.low, interlock.high
    bounds = {readings[bound] for bound in (low, high) if isinstance(bound, str)}
    return _Rule(
        interlock,
        source=source,
        stamp=stamp_of[source],
        unit=units[interlock.source],
        low=low if isinstance(low, int | float) else -math.inf,
        high=high if isinstance(high, int | float) else math.inf,
        low_from=readings[low] if isinstance(low, str) else -1,
        high_from=readings[high] if isinstance(high, str) else -1,
        follows=-1 if interlock.follows is None else setpoints[interlock.follows],
        only_while=-1 if interlock.only_while is None else setpoints[interlock.only_while],
        bound_stamps=tuple({stamp_of[bound] for bound in bounds}),
        delay_ns=round(interlock.delay_s * 1e9),
        stale_ns=round(interlock.stale_after_s * 1e9),
    )


def _reason(
    rule: _Rule, value: float, low: float, high: float, own_age_ns: int, age_ns: int
) -> str:
    source, unit = rule.interlock.source, parse_unit(rule.unit)
    if age_ns > rule.stale_ns:
        stale_name = source if own_age_ns > rule.stale_ns else f"a bound of {source}"
        return (
            f"{stale_name} is stale: its last row is {age_ns / 1e6:.0f} ms old, at most "
            f"{rule.stale_ns / 1e6:.0f} ms are allowed"
        )
    if math.isnan(value):
        return f"{source} is not a number (NaN)"
    if math.isnan(low) or math.isnan(high):
        return f"a bound of {source} is not a number (NaN)"
    if rule.follows >= 0:
        setpoint = Quantity((low + high) / 2, unit)
        band = Quantity((high - low) / 2, unit.difference())
        return (
            f"{source} {Quantity(value, unit)} does not follow its setpoint {setpoint}: more than "
            f"{band} apart for {rule.interlock.delay_s:g} s"
        )
    side, bound = ("above", high) if value > high else ("below", low)
    return f"{source} {Quantity(value, unit)} is {side} its limit {Quantity(bound, unit)}"
