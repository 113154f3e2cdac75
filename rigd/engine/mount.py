"""Assigns every channel and setpoint of a rig its index in the tables of the cycle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

from rigd.engine.stand_in import StandIn
from rigd.model.channels import STATUS_FIELD, Channel, Stream
from rigd.sdk import Driver, Link

#: What the cycle says about itself, once per cycle.
CYCLE_STREAM = Stream(
    "cycle",
    (
        Channel(
            "scheduled", "s", "when this cycle was due, since the run (or its resumed part) began"
        ),
        Channel("actual", "s", "when it did begin, on the same clock"),
        Channel("spent", "s", "how long it took; 0 in virtual time"),
        Channel("stale", "1", "devices whose row of this cycle repeats an earlier one"),
    ),
    doc="Timing of the control cycle itself",
    source="rigd",
)


@dataclass(frozen=True)
class Mount:
    """One device and its places: ``values`` in the table of readings, ``commands`` in the other."""

    name: str
    driver: Driver
    stream: Stream
    values: slice
    commands: slice


@dataclass(frozen=True)
class MountedRig:
    """The devices of a rig in a fixed order, with the tables the cycle works on.

    ``readings`` maps ``device.channel`` to its index in the values table, ``setpoints`` maps
    ``device.setpoint`` to its index in the command table, ``status`` maps ``device.status`` to the
    index of a status word in the values table.
    """

    mounts: tuple[Mount, ...]
    readings: Mapping[str, int]
    setpoints: Mapping[str, int]
    links: Mapping[str, Link] = field(default_factory=dict)
    status: Mapping[str, int] = field(default_factory=dict)

    @cached_property
    def streams(self) -> tuple[Stream, ...]:
        """All streams a run records: one per device, and the cycle's own."""
        return (*(mount.stream for mount in self.mounts), CYCLE_STREAM)

    @cached_property
    def device_of(self) -> tuple[int, ...]:
        """For every index of the values table, the index of its mount."""
        owners: list[int] = []
        for index, mount in enumerate(self.mounts):
            owners += [index] * (mount.values.stop - mount.values.start)
        return tuple(owners)


def mount(
    devices: Mapping[str, tuple[str, Driver]], links: Mapping[str, Link] | None = None
) -> MountedRig:
    """Return the rig made of ``devices``: name -> (driver name, driver instance).

    ``links`` are the connections they share, by name, in the order they are opened.

    A device's stream holds its readings, then the setpoint written in the same cycle as
    ``<name>_setpoint``, then its status word where it has one.
    """
    mounts: list[Mount] = []
    readings: dict[str, int] = {}
    setpoints: dict[str, int] = {}
    status: dict[str, int] = {}
    value_count = command_count = 0
    for name, (source, driver) in devices.items():
        echoes = tuple(
            replace(
                setpoint,
                name=f"{setpoint.name}_setpoint",
                doc=f"setpoint written in this cycle, after limits: {setpoint.doc}",
            )
            for setpoint in driver.setpoints
        )
        channels = (*driver.channels, *echoes)
        stream = Stream(name, channels, driver.title, driver.has_status, source)
        if isinstance(driver, StandIn):
            stream = driver.stream
        values = slice(value_count, value_count + len(driver.channels) + driver.has_status)
        commands = slice(command_count, command_count + len(driver.setpoints))
        for offset, channel in enumerate(driver.channels):
            readings[f"{name}.{channel.name}"] = value_count + offset
        if driver.has_status:
            status[f"{name}.{STATUS_FIELD}"] = values.stop - 1
        for offset, channel in enumerate(driver.setpoints):
            setpoints[f"{name}.{channel.name}"] = command_count + offset
        mounts.append(Mount(name, driver, stream, values, commands))
        value_count, command_count = values.stop, commands.stop
    return MountedRig(tuple(mounts), readings, setpoints, links or {}, status)
