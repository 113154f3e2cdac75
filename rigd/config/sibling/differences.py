"""Lists what differs between a real rig file and its simulated sibling."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from rigd.config.quantities import rate_unit
from rigd.config.rig import DeviceConfig, RigConfig
from rigd.model.channels import Channel
from rigd.model.limits import Interlock, SetpointLimit
from rigd.model.units import format_difference, format_quantity, parse_unit
from rigd.sdk import SlowDriver

#: In place of what one of the files has not.
MISSING = "none"


@dataclass(frozen=True)
class Difference:
    """Something that two files of a rig state differently, as text: ``here`` in the real one."""

    what: str
    here: str
    there: str


def differences(rig: RigConfig, sibling: RigConfig) -> Iterator[Difference]:
    """Yield what differs, in the order: cycle, devices, interlocks, constants.

    Of the devices: when readings come, channels that one of them has not, units, ranges, limits
    and rates.
    """
    yield from _text("cycle", _hertz(rig), _hertz(sibling))
    for name in dict.fromkeys((*rig.devices, *sibling.devices)):
        yield from _device(name, rig.devices.get(name), sibling.devices.get(name))
    here, there = ({item.name: item for item in side.interlocks} for side in (rig, sibling))
    for name in dict.fromkeys((*here, *there)):
        unit = _unit(rig, sibling, here.get(name) or there[name])
        yield from _interlock(name, here.get(name), there.get(name), unit)
    for name in dict.fromkeys((*rig.constants, *sibling.constants)):
        values = [
            MISSING if name not in side.constants else format_quantity(
                side.constants[name].value, side.constants[name].unit.symbol
            )
            for side in (rig, sibling)
        ]  # fmt: skip
        yield from _text(f"constant {name}", *values)


def _text(what: str, here: str, there: str) -> Iterator[Difference]:
    if here != there:
        yield Difference(what, here, there)


def _hertz(rig: RigConfig) -> str:
    return format_quantity(1e9 / rig.period_ns, "Hz")


def _device(
    name: str, here: DeviceConfig | None, there: DeviceConfig | None
) -> Iterator[Difference]:
    if here is None or there is None:
        yield Difference(f"device {name}", _device_text(here), _device_text(there))
        return
    yield from _text(f"readings of {name}", pace(here), pace(there))
    for side, other, sides in (
        (here, there, ("measured", MISSING)),
        (there, here, (MISSING, "measured")),
    ):
        for channel in side.channels:
            if _find(other, channel.name) is None:
                yield Difference(f"channel {name}.{channel.name}", *sides)
    for channel in here.channels:
        found = _find(there, channel.name)
        if found is not None and not alike(found, channel):
            yield Difference(f"unit of {name}.{channel.name}", channel.unit, found.unit)
        elif found is not None:
            yield from _range(f"range of {name}.{channel.name}", channel, found)
    theirs = {item.name: item for item in there.setpoints}
    for setpoint in here.setpoints:
        full = f"{name}.{setpoint.name}"
        if setpoint.name not in theirs:  # of a controller that measures another channel
            yield Difference(f"setpoint {full}", "commanded", MISSING)
            continue
        yield from _range(f"range of the setpoint {full}", setpoint, theirs[setpoint.name])
        limits = here.limits[setpoint.name], there.limits[setpoint.name]
        yield from _limit(full, setpoint, *limits)


def pace(device: DeviceConfig) -> str:
    """Return when readings of a device come, for a person."""
    declared = device.declaration
    if declared.oldest_s > 0.0:
        return f"in blocks, up to {1e3 * declared.oldest_s:.3g} ms old"
    slow = issubclass(device.driver_class, SlowDriver) or not declared.every_cycle
    return "at a pace of their own" if declared.channels and slow else "in each cycle"


def alike(channel: Channel, other: Channel) -> bool:
    """Return whether two channels are the same kind of quantity; in SI they have one unit."""
    return parse_unit(channel.unit).same_kind(parse_unit(other.unit))


def _device_text(device: DeviceConfig | None) -> str:
    if device is None:
        return MISSING
    count = len(device.channels)
    return "1 channel" if count == 1 else f"{count} channels"


def _find(device: DeviceConfig, name: str) -> Channel | None:
    return next((item for item in device.channels if item.name == name), None)


def _range(what: str, here: Channel, there: Channel) -> Iterator[Difference]:
    sides = (_span(here.low, here.high, here.shown_in), _span(there.low, there.high, here.shown_in))
    yield from _text(what, *sides)


def _limit(
    name: str, setpoint: Channel, here: SetpointLimit, there: SetpointLimit
) -> Iterator[Difference]:
    unit = setpoint.shown_in
    sides = (_span(here.low, here.high, unit), _span(there.low, there.high, unit))
    yield from _text(f"limits of {name}", *sides)
    rates = (format_quantity(limit.rate, rate_unit(setpoint.unit)) for limit in (here, there))
    yield from _text(f"rate of {name}", *rates)
    rests = (format_quantity(limit.rest, unit) for limit in (here, there))
    yield from _text(f"rest of {name}", *rests)
    yield from _text(
        f"{name} at a stop", *("hold" if item.holds else "rest" for item in (here, there))
    )


def _interlock(
    name: str, here: Interlock | None, there: Interlock | None, unit: str
) -> Iterator[Difference]:
    if here is None or there is None:
        sides = (MISSING if item is None else item.action.word for item in (here, there))
        yield Difference(f"interlock {name}", *sides)
        return
    theirs = _rules(there, unit)
    for key, text in _rules(here, unit).items():
        yield from _text(f"interlock {name}, {key}", text, theirs[key])


def _rules(item: Interlock, unit: str) -> dict[str, str]:
    """Return all of an interlock that decides when it trips and what it does."""
    band = format_difference(item.band, unit)
    return {
        "source": item.source,
        "bounds": f"{_bound(item.low, unit)} .. {_bound(item.high, unit)}".strip(),
        "follows": MISSING if item.follows is None else f"{item.follows} within {band}",
        "while": item.only_while or "always",
        "delay": f"{item.delay_s:g} s",
        "deadband": format_difference(item.deadband, unit),
        "stale after": f"{1e3 * item.stale_after_s:g} ms",
        "latch": "yes" if item.latch else "no",
        "action": item.action.word,
    }


def _bound(value: float | str | None, unit: str) -> str:
    if isinstance(value, str):
        return value
    return "" if value is None or math.isinf(value) else format_quantity(value, unit)


def _span(low: float, high: float, unit: str) -> str:
    if low == -math.inf and high == math.inf:
        return "no bounds"
    return f"{_bound(low, unit)} .. {_bound(high, unit)}".strip()


def _unit(rig: RigConfig, sibling: RigConfig, interlock: Interlock) -> str:
    channel = rig.channel(interlock.source) or sibling.channel(interlock.source)
    return "1" if channel is None else channel.shown_in
