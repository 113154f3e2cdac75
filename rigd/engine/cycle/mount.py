"""Assigns every channel and setpoint of a rig its index in the tables of the cycle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

from rigd.computed.derived.driver import Derived
from rigd.engine.cycle.stand_in import StandIn
from rigd.model.channels import ECHO, STATUS_FIELD, Channel, Stream
from rigd.sdk import Declaration, Driver, Link

#: The cycle's own stream, one row per cycle.
CYCLE_STREAM = Stream(
    "cycle",
    (
        Channel(
            "scheduled",
            "s",
            "time when this cycle was due, since the start of the run (or of its resumed part)",
        ),
        Channel("actual", "s", "time when it began, on the same clock"),
        Channel("spent", "s", "its duration; 0 in virtual time"),
        Channel("stale", "1", "number of devices whose row of this cycle repeats an earlier row"),
    ),
    doc="Timing of the control cycle itself",
    source="rigd",
)


@dataclass(frozen=True)
class Mount:
    """A device and its places: ``values`` in the table of readings, ``commands`` in the other."""

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
    def derived(self) -> tuple[str, ...]:
        """The names of the derived channels, group by group."""
        configs = (item.driver.config for item in self.mounts if isinstance(item.driver, Derived))
        groups = next((config.graph.groups() for config in configs), {})
        return tuple(name for names in groups.values() for name in names)

    @cached_property
    def stamp_of(self) -> tuple[int, ...]:
        """For every index of the values table, where its time stands in the table of times.

        That has the times of the rows of all mounts, then for each of the derived channels the time
        of the oldest reading in it.
        """
        owners: list[int] = []
        for index, mount in enumerate(self.mounts):
            owners += [index] * (mount.values.stop - mount.values.start)
        for place, name in enumerate(self.derived):
            if name in self.readings:  # a part of a rig computes all groups, and may have some
                owners[self.readings[name]] = len(self.mounts) + place
        return tuple(owners)


def mount(
    devices: Mapping[str, tuple[str, Driver]], links: Mapping[str, Link] | None = None
) -> MountedRig:
    """Return the rig made of ``devices``: name -> (driver name, driver instance).

    ``links`` are their shared connections by name, in the order of opening.
    """
    mounts: list[Mount] = []
    readings: dict[str, int] = {}
    setpoints: dict[str, int] = {}
    status: dict[str, int] = {}
    value_count = command_count = 0
    for name, (source, driver) in devices.items():
        declared = driver.declaration
        stream = recorded_stream(name, source, driver.title, declared)
        if isinstance(driver, StandIn):
            stream = driver.stream
        values = slice(value_count, value_count + len(declared.channels) + declared.has_status)
        commands = slice(command_count, command_count + len(declared.setpoints))
        for offset, channel in enumerate(declared.channels):
            readings[f"{name}.{channel.name}"] = value_count + offset
        if declared.has_status:
            status[f"{name}.{STATUS_FIELD}"] = values.stop - 1
        for offset, channel in enumerate(declared.setpoints):
            setpoints[f"{name}.{channel.name}"] = command_count + offset
        mounts.append(Mount(name, driver, stream, values, commands))
        value_count, command_count = values.stop, commands.stop
    return MountedRig(tuple(mounts), readings, setpoints, links or {}, status)


def recorded_stream(name: str, source: str, title: str, declared: Declaration) -> Stream:
    """Return the recorded stream of the device ``name`` of the driver ``source``.

    It contains the readings, then the setpoints written in the same cycle as ``<name>_setpoint``,
    then the status word if there is one.
    """
    echoes = tuple(
        replace(
            setpoint,
            name=f"{setpoint.name}{ECHO}",
            doc=f"setpoint written in this cycle, after limits: {setpoint.doc}",
        )
        for setpoint in declared.setpoints
    )
    return Stream(name, (*declared.channels, *echoes), title, declared.has_status, source)
