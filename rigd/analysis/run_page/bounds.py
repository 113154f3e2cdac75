"""Reads the bounds of a run from the rig and procedure files that its recording contains."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from rigd.config.binding import bind
from rigd.config.document import parse_document
from rigd.config.problems import Problems
from rigd.config.source import RigSource
from rigd.model.channels import Stream
from rigd.model.errors import ConfigError
from rigd.model.units import parse_unit
from rigd.record import Recording
from rigd.sdk import In

#: What is written behind the name of a setpoint in a recording.
SETPOINT: Final = "_setpoint"


@dataclass(frozen=True)
class Bound:
    """One value that ``channel`` (``device.channel``) must not pass, in its display unit."""

    channel: str
    value: float
    upper: bool
    by: str  #: what holds it: ``limit``, ``limit of the trial``, ``interlock over_current``
    hard: bool  #: whether an interlock holds it
    delay_s: float = 0.0  #: for how long it may be passed

    def passed(self, least: float, greatest: float) -> bool:
        """Return whether values from ``least`` to ``greatest`` passed it, although none may."""
        return self.delay_s == 0.0 and (greatest > self.value if self.upper else least < self.value)


@dataclass(frozen=True)
class Bounds:
    """The bounds of a run, and the text to show if they are not known."""

    known: tuple[Bound, ...] = ()
    problem: str = ""

    def of(self, channel: str) -> tuple[Bound, ...]:
        """Return the bounds of ``device.channel``."""
        return tuple(item for item in self.known if item.channel == channel)


def bounds_of(recording: Recording) -> Bounds:
    """Return the bounds in the attached files; drivers need not be installed.

    A bound that another channel or a swept parameter gives has no one value and is left out.
    """
    texts = {
        name: attachment.data.decode(errors="replace")
        for name, attachment in recording.attachments.items()
    }
    if "rig.yaml" not in texts:
        return Bounds(problem="the recording carries no rig file: limits are not drawn")
    units = _units(recording.streams)
    try:
        document = parse_document(texts["rig.yaml"], Path("rig.yaml"))
        problems = Problems()
        rig = bind(document, RigSource, problems)
        problems.raise_any()
        trial = _of_trial(texts.get("procedure.yaml"), units)
    except ConfigError as error:
        return Bounds(problem=f"limits are not drawn: {error.message}")
    if rig is None:
        return Bounds(problem="limits are not drawn: the rig file cannot be used")
    return Bounds((*_limits(rig, units), *trial, *_interlocks(rig, units)))


def recorded_during(recording: Recording) -> frozenset[str]:
    """Return the steps that some stream was recorded during, if it was not always."""
    names: set[str] = set()
    for item in _record(recording).values():
        during = item.get("during", ())
        names.update([during] if isinstance(during, str) else map(str, during or ()))
    return frozenset(names)


def recorded_in_parts(recording: Recording) -> frozenset[str]:
    """Return the streams that were recorded during steps, or in captures, alone."""
    record = _record(recording)
    return frozenset(name for name, item in record.items() if {"during", "when"} & item.keys())


def _record(recording: Recording) -> dict[str, Mapping[str, Any]]:
    """Return by stream what its procedure asks to record, where it is more than every n-th row."""
    attached = recording.attachments.get("procedure.yaml")
    if attached is None:
        return {}
    try:
        document = parse_document(attached.data.decode(errors="replace"), Path("procedure.yaml"))
    except ConfigError:
        return {}
    record = document.get(("record",))
    if not isinstance(record, Mapping):
        return {}
    return {str(name): item for name, item in record.items() if isinstance(item, Mapping)}


def _limits(rig: RigSource, units: Mapping[str, str]) -> Iterator[Bound]:
    for device, item in rig.devices.items():
        for name, limit in item.limits.items():
            channel = f"{device}.{name}{SETPOINT}"
            yield from _pair(channel, limit.low, limit.high, "limit", units)


def _interlocks(rig: RigSource, units: Mapping[str, str]) -> Iterator[Bound]:
    for interlock in rig.interlocks:
        by = f"interlock {interlock.name}"
        for bound in _pair(interlock.source, interlock.low, interlock.high, by, units):
            after = f"{by} after {interlock.delay:g} s" if interlock.delay else by
            yield replace(bound, by=after, hard=True, delay_s=interlock.delay)


def _of_trial(text: str | None, units: Mapping[str, str]) -> list[Bound]:
    """Return the limits of a trial that the procedure gives as plain quantities."""
    if text is None:
        return []
    limits = parse_document(text, Path("procedure.yaml")).get(("trial", "limits"))
    if not isinstance(limits, Mapping):
        return []
    return [
        bound
        for channel, limit in limits.items()
        if isinstance(limit, Mapping)
        for bound in _pair(
            str(channel), limit.get("low"), limit.get("high"), "limit of the trial", units
        )
    ]


def _pair(
    channel: str, low: object, high: object, by: str, units: Mapping[str, str]
) -> Iterator[Bound]:
    unit = units.get(channel)
    if unit is None:
        return  # it was not recorded
    for text, upper in ((low, False), (high, True)):
        if text is None:
            continue
        try:
            value = parse_unit(unit).from_si(In(unit).read(str(text)))
        except ValueError:
            continue  # another channel or a parameter gives it
        yield Bound(channel, value, upper, by, hard=False)


def _units(streams: Mapping[str, Stream]) -> dict[str, str]:
    return {
        f"{stream.name}.{channel.name}": channel.shown_in
        for stream in streams.values()
        for channel in stream.channels
    }
