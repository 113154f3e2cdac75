"""Reads the controllers of a rig: each becomes a device with one setpoint."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

from rigd.computed.controllers.chain import sequence
from rigd.computed.controllers.driver import CONTROLLER, OWN, Controller, ControllerConfig
from rigd.computed.derived.driver import DerivedConfig
from rigd.config.document import Document, KeyPath
from rigd.config.problems import Problems, suggest
from rigd.config.quantities import check_inside, rate_unit, read_difference, read_quantity
from rigd.config.rig import DeviceConfig, RigConfig
from rigd.config.source import ControllerSource
from rigd.language.dimensions import alike, over, times
from rigd.model.channels import Channel
from rigd.model.limits import SetpointLimit
from rigd.model.units import (
    NO_DIMENSION,
    Dimension,
    format_quantity,
    parse_quantity,
    parse_unit,
    quotient,
)

#: Most of the rate of the cycle that the filter of a derivative may have, as for `lowpass`.
_FASTEST: Final = 0.25
_SECOND: Final = parse_unit("s").dimension


def add_controllers(
    document: Document, sources: Mapping[str, ControllerSource], rig: RigConfig, problems: Problems
) -> RigConfig:
    """Return ``rig`` with the controllers of ``sources``; problems are noted.

    Those that are commanded by others are read first: their limits are the others' limits.
    """
    reader = _Reader(document, problems)
    for name in sources:
        if name in rig.devices or name in ("cycle", "rig"):
            problems.add(
                document.key_place(("controllers", name)),
                f"{name} is {'a device of this rig' if name in rig.devices else 'taken'}",
                "choose another name for the controller",
            )
            return rig
    inside = {name: item.output for name, item in sources.items() if item.output in sources}
    order = sequence(inside)
    if order is None:
        circle = next(found for name in inside if (found := _circle(inside, name)))
        problems.add(
            document.place(("controllers", circle[0], "output")),
            f"controllers command one another in a circle: {' commands '.join(circle)}",
            "let one of them command a device",
        )
        return rig
    if not _one_each(reader, sources):
        return rig
    first = [name for name in sources if name not in order]
    devices = dict(rig.devices)
    for name in (*first, *reversed(order)):
        device = reader.controller(name, sources[name], replace(rig, devices=devices), sources)
        if device is None:
            return rig
        devices[name] = device
    return replace(rig, devices=devices)


def _circle(inside: Mapping[str, str], name: str) -> list[str]:
    """Return the circle that leads from ``name`` back to it; empty if there is none."""
    seen = [name]
    while (following := inside.get(seen[-1])) is not None and following not in seen:
        seen.append(following)
    return [*seen, name] if following == name else []


def _one_each(reader: _Reader, sources: Mapping[str, ControllerSource]) -> bool:
    """Return whether no two controllers command the same setpoint; problems are noted."""
    owners: dict[str, str] = {}
    for name, source in sources.items():
        if source.output in owners:
            reader.note(
                (name, "output"),
                f"{source.output} is commanded by {owners[source.output]} already",
                "two controllers on one setpoint work against one another: keep one of them",
            )
        owners.setdefault(source.output, name)
    return len(owners) == len(sources)


@dataclass
class _Reader:
    document: Document
    problems: Problems

    def note(self, path: KeyPath, message: str, hint: str | None = None) -> None:
        place = self.document.place(("controllers", *path))
        self.problems.add(place, message, hint)

    def controller(
        self,
        name: str,
        source: ControllerSource,
        rig: RigConfig,
        sources: Mapping[str, ControllerSource],
    ) -> DeviceConfig | None:
        """Return the controller ``name`` as a device; None with its problems noted."""
        before = len(self.problems.found)
        measured = self._channel((name, "measured"), source.measured, rig)
        commanded = self._output(name, source, rig, sources)
        if measured is None or commanded is None:
            return None
        output, channel, limit = commanded
        self._check_measured(name, source.measured, measured, rig)
        low, high = self._output_limits(name, source, output, channel.unit, limit)
        if source.relay is None:
            gains = self._gains(name, source, channel.unit, measured.unit)
        else:
            gains = self._relay(name, source, channel.unit, measured.unit, high - low)
        filter_s = self._filter(name, source, rig.period_ns * 1e-9)
        own = self._limits(name, source, measured)
        for key, want in (("feed_forward", channel.unit), ("schedule", "1")):
            other = getattr(source, key)
            found = None if other is None else self._channel((name, key), other, rig)
            if found is not None and not alike(_dimension(found.unit), _dimension(want)):
                self.note(
                    (name, key), f"{other} is in {found.unit}, expected {want}",
                    "a derived channel can convert it",
                )  # fmt: skip
        self._check_ages(name, source, rig)
        if len(self.problems.found) > before or own is None:
            return None
        used = (source.measured, output, source.feed_forward, source.schedule)
        config = ControllerConfig(
            name=name, measured=source.measured, unit=measured.unit, output=output,
            output_unit=channel.unit, low=low, high=high,
            needs=frozenset(item.partition(".")[0] for item in used if item),
            **gains, filter_s=filter_s,
            weight=source.setpoint_weight, forward=source.feed_forward, schedule=source.schedule,
            stale_s=source.stale_after, frozen_s=source.frozen_after,
            frozen_always=source.frozen == "always", stuck_s=source.stuck_after,
        )  # fmt: skip
        declaration = Controller.declare(config)
        short = declaration.setpoints[0].name
        return DeviceConfig(name, CONTROLLER, Controller, config, declaration, {short: own})

    def _channel(self, path: KeyPath, name: str, rig: RigConfig) -> Channel | None:
        """Return a channel that a controller may use: measured, or derived from measured ones."""
        device = rig.devices.get(name.partition(".")[0])
        if device is not None and device.driver_class is Controller:
            self.note(
                path, f"{name} is computed by a controller, not measured",
                "name the channel of a device, or a derived channel",
            )  # fmt: skip
            return None
        channel = rig.channel(name)
        if channel is None:
            known = [
                f"{item.name}.{each.name}"
                for item in rig.devices.values()
                if item.driver_class is not Controller
                for each in item.channels
            ]
            self.note(path, f"unknown channel {name!r}", suggest(name, known))
        return channel

    def _check_measured(self, name: str, measured: str, channel: Channel, rig: RigConfig) -> None:
        config = rig.devices[measured.partition(".")[0]].config
        if isinstance(config, DerivedConfig) and not config.graph.uses.get(measured):
            self.note(
                (name, "measured"), f"{measured} is computed from no measured channel",
                "a controller needs a reading of what its output moves",
            )  # fmt: skip
        if channel.name in OWN:
            self.note(
                (name, "measured"),
                f"the controller has a channel {channel.name!r} of its own",
                f"give {measured} another name by a derived channel",
            )

    def _output(
        self,
        name: str,
        source: ControllerSource,
        rig: RigConfig,
        sources: Mapping[str, ControllerSource],
    ) -> tuple[str, Channel, SetpointLimit] | None:
        """Return what the controller commands: its full name, channel and limits."""
        owner, _, short = source.output.partition(".")
        device, full = rig.devices.get(owner), source.output
        if owner in sources and short:
            self.note((name, "output"), f"{full} belongs to the controller {owner}",
                      f"write 'output: {owner}'")  # fmt: skip
            return None
        if source.output in sources and device is not None:  # another controller, by its name
            full = f"{source.output}.{device.setpoints[0].name}"
        channel = rig.setpoint(full)
        if device is None or channel is None:
            known = {*rig.settable, *sources} - {name}
            message = f"unknown setpoint {full!r}"
            if rig.channel(full) is not None:
                message = f"{full} is measured, not commanded"
            self.note((name, "output"), message, suggest(full, known))
            return None
        return full, channel, device.limits[channel.name]

    def _gains(
        self, name: str, source: ControllerSource, output: str, measured: str
    ) -> dict[str, float]:
        per = quotient(output, measured)
        ratio = over(_dimension(output), _dimension(measured))
        kinds = {
            "kp": (per, ratio),
            "ki": (quotient(output, f"{measured} s"), over(ratio, _SECOND)),
            "kd": (quotient(f"{output} s", measured), times(ratio, _SECOND)),
        }
        gains = dict.fromkeys(kinds, 0.0)
        for key, (unit, dimension) in kinds.items():
            text = getattr(source, key)
            if text is not None:
                gains[key] = self._gain((name, key), text, unit, dimension)
        if source.hysteresis is not None:
            self.note((name, "hysteresis"), "'hysteresis' is that of a relay", "remove it")
        given = [gain for gain in gains.values() if gain and not math.isnan(gain)]
        if not any(gains.values()):
            self.note(
                (name,), "the controller has no gain",
                "give 'kp', 'ki' or both, or a 'relay' to find them (docs/controllers.md)",
            )  # fmt: skip
        elif min(given, default=0.0) < 0.0 < max(given, default=0.0):
            signs = ", ".join(f"{key} {getattr(source, key)}" for key in gains if gains[key])
            self.note(
                (name,), f"the gains have different signs: {signs}",
                "all are positive if more output raises the measured value, else all are negative",
            )  # fmt: skip
        return gains

    def _relay(
        self, name: str, source: ControllerSource, output: str, measured: str, room: float
    ) -> dict[str, float]:
        """Return the relay and its hysteresis, for an output that can move by ``room``."""
        for key in ("kp", "ki", "kd", "filter", "feed_forward", "schedule"):
            if getattr(source, key) is not None:
                self.note((name, key), f"{key!r} has no effect beside 'relay'",
                          "give the relay to find gains, or gains")  # fmt: skip
        path: KeyPath = ("controllers", name)
        relay = read_difference(
            self.document, (*path, "relay"), source.relay or "", output, self.problems
        )
        if relay == 0.0:
            self.note((name, "relay"), "a relay of 0 does not move the output")
        elif 2 * abs(relay) > room:
            self.note(
                (name, "relay"),
                f"the output moves by {format_quantity(2 * abs(relay), output)} between the two "
                f"sides of the relay, and its limits leave {format_quantity(room, output)}",
                "give a smaller relay",
            )
        hysteresis = 0.0
        if source.hysteresis is None:
            self.note((name, "relay"), "key 'hysteresis' is missing: noise would pass for a swing",
                      f"give two to three times the noise of {source.measured}")  # fmt: skip
        else:
            hysteresis = read_difference(
                self.document, (*path, "hysteresis"), source.hysteresis, measured, self.problems
            )
            if hysteresis < 0.0:
                self.note((name, "hysteresis"), f"{source.hysteresis} is below 0")
        return {"relay": relay, "hysteresis": hysteresis}

    def _gain(self, path: KeyPath, text: str, unit: str, dimension: Dimension) -> float:
        try:
            given = parse_quantity(text).as_difference()
        except ValueError as error:
            self.note(path, str(error))
            return math.nan
        if alike(given.unit.dimension, dimension):
            return given.value
        found = f"has no unit: write '{text} {unit}'" if given.unit.dimension == NO_DIMENSION else (
            f"is in {given.unit}, expected {unit}"
        )  # fmt: skip
        self.note(path, f"{text} {found}")
        return math.nan

    def _filter(self, name: str, source: ControllerSource, period_s: float) -> float:
        """Return the time constant of the filter of the derivative, in s."""
        if source.filter is None:
            if source.kd is not None:
                message = "key 'filter' is missing: without it a derivative is noise"
                self.note((name, "kd"), message, "such as 'filter: 50 Hz'")
            return 0.0
        path = ("controllers", name, "filter")
        if source.kd is None:
            self.problems.add(
                self.document.key_place(path), "'filter' is that of the derivative",
                "give 'kd', or remove it; 'lowpass' of a derived channel filters what is measured",
            )  # fmt: skip
            return 0.0
        hertz = read_quantity(self.document, path, source.filter, "Hz", self.problems)
        most = _FASTEST / period_s
        if hertz <= 0:
            self.note((name, "filter"), f"filter {source.filter} must be above 0")
        elif hertz > most:
            self.note(
                (name, "filter"),
                f"a filter of {hertz:g} Hz is too fast for a cycle of {1 / period_s:g} Hz: at most "
                f"{most:g} Hz",
            )
        return 1 / (2 * math.pi * hertz) if hertz > 0 else math.nan

    def _output_limits(
        self, name: str, source: ControllerSource, output: str, unit: str, limit: SetpointLimit
    ) -> tuple[float, float]:
        if source.output_limits is None:
            return limit.low, limit.high
        values = []
        for index, text in enumerate(source.output_limits):
            path = ("controllers", name, "output_limits", index)
            value = read_quantity(self.document, path, text, unit, self.problems)
            values.append(
                check_inside(self.document, path, value, (limit.low, limit.high), unit,
                             f"{output} in this file", self.problems)
            )  # fmt: skip
        low, high = values
        if low >= high:
            self.note((name, "output_limits"), f"low {source.output_limits[0]} is not below high "
                      f"{source.output_limits[1]}", "swap the two")  # fmt: skip
        return low, high

    def _limits(
        self, name: str, source: ControllerSource, measured: Channel
    ) -> SetpointLimit | None:
        """Return the limits of the setpoint; by default it rests next to 0 within them."""
        unit, given = measured.unit, source.limits
        low, high, rate = measured.low, measured.high, math.inf
        rest = None
        if given is not None:
            path: KeyPath = ("controllers", name, "limits")
            low = read_quantity(self.document, (*path, "low"), given.low, unit, self.problems)
            high = read_quantity(self.document, (*path, "high"), given.high, unit, self.problems)
            low, high = (
                check_inside(
                    self.document, (*path, key), value, (measured.low, measured.high), unit,
                    f"what {source.measured} measures", self.problems,
                )
                for key, value in (("low", low), ("high", high))
            )  # fmt: skip
            if low >= high:
                self.note((name, "limits", "low"), f"low {given.low} is not below high "
                          f"{given.high}", "swap the two")  # fmt: skip
            if given.rate is not None:
                rate = read_quantity(
                    self.document, (*path, "rate"), given.rate, rate_unit(unit), self.problems
                )
                if rate <= 0:
                    self.note((name, "limits", "rate"), f"rate {given.rate} must be above 0")
            if given.rest is not None:
                rest = read_quantity(
                    self.document, (*path, "rest"), given.rest, unit, self.problems
                )
                rest = check_inside(
                    self.document, (*path, "rest"), rest, (low, high), unit,
                    f"the setpoint of {name} in this file", self.problems,
                )  # fmt: skip
        elif not (math.isfinite(low) and math.isfinite(high)):
            self.note(
                (name,), f"the setpoint of {name} has no limits, and {source.measured} no range",
                f"add 'limits: {{low: ..., high: ..., rate: ...}}' in {unit}",
            )  # fmt: skip
            return None
        return SetpointLimit(low, high, rate, min(max(0.0, low), high) if rest is None else rest)

    def _check_ages(self, name: str, source: ControllerSource, rig: RigConfig) -> None:
        """Check that readings that come on time are never stale."""
        period_s = rig.period_ns * 1e-9
        for item in (source.measured, source.feed_forward, source.schedule):
            if item is None:
                continue
            slow = rig.slow_device_in(item)
            if slow is not None and "stale_after" not in source.model_fields_set:
                self.note(
                    (name,),
                    f"{item} is from {slow}, whose readings come at a pace of its own: when does "
                    "it count as lost?",
                    "give 'stale_after', longer than the time between two readings",
                )
            least_s = max(2 * period_s, rig.oldest_s(item) + period_s)
            if source.stale_after < least_s:
                self.note(
                    (name, "stale_after"),
                    f"stale_after {source.stale_after:g} s is too short: a reading of {item} in "
                    f"normal operation is up to {1e3 * least_s:g} ms old",
                    f"give at least {math.ceil(1e3 * least_s)} ms",
                )


def _dimension(unit: str) -> Dimension:
    return parse_unit(unit).dimension
